"""Named inner surfaces, from files of surfaces or from labels of volumes."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cortet.errors import InputError
from cortet.formats.gifti import read_surface
from cortet.formats.placement import placed
from cortet.formats.volumes import Volume, is_volume, read_labels, volume_file
from cortet.geometry.label_surface import AS_THEY_ARE, Handles, LabelSurface, label_surfaces
from cortet.meshes import TriSurface, single_precision
from cortet.solver_files.volumes import require_in_place

logger = logging.getLogger(__name__)


class InnerSurfaces(NamedTuple):
    """Inner surfaces that were read or made."""

    surfaces: dict[str, TriSurface]
    #: the file that each comes from
    files: dict[str, str]
    #: which surfaces were made from labels, in words
    told: list[str]


def inner_surfaces(
    given: Mapping[str, str],
    outer: TriSurface,
    to_mm: Sequence[Sequence[float]] | None = None,
    *,
    finite: bool = True,
    handles: Handles = AS_THEY_ARE,
) -> InnerSurfaces:
    """The inner surfaces of `NAME -> FILE`, a surface, or `NAME -> VOLUME:5,6`, labels.

    Several components of labels are NAME1, NAME2 and so on, the largest first.

    Parameters
    ----------
    outer : the surface around them, as it was read; surfaces from labels get its frame and unit
    to_mm : matrix of `formats.placement.matrix` for `outer`
    finite : whether coordinates must be finite
    handles : what is done about the handles of labels
    """
    found = InnerSurfaces({}, {}, [])
    for name, file in given.items():
        if is_volume(file):
            made, told = _of_labels(name, file, outer, to_mm, handles)
            found.told.extend(told)
        else:
            made = {name: read_surface(file, finite=finite)}
        for own, surface in made.items():
            if own in found.surfaces:
                raise InputError(f"two inner surfaces would have the name {own}", file=file, remedy="use another name")
            found.surfaces[own], found.files[own] = surface, volume_file(file)
    return found


def _of_labels(
    name: str,
    text: str,
    outer: TriSurface,
    to_mm: Sequence[Sequence[float]] | None,
    handles: Handles,
) -> tuple[dict[str, TriSurface], list[str]]:
    """The surfaces of labels, in the coordinates of `outer`, by name; and what they are."""
    volume, keys = read_labels(text)
    to_scanner = np.array(to_mm) if to_mm is not None else outer.frame.to_scanner
    moved = placed(replace(outer, inner={}), to_scanner.tolist())
    if np.isfinite(moved.points).all():
        require_in_place({name: volume}, moved)
    made, told = surfaces_of_labels(name, volume, keys, handles)
    back = np.linalg.inv(to_scanner).tolist()
    return {own: single_precision(replace(placed(part, back), frame=outer.frame)) for own, part in made.items()}, told


def surfaces_of_labels(
    name: str, volume: Volume, keys: Sequence[int], handles: Handles = AS_THEY_ARE
) -> tuple[dict[str, TriSurface], list[str]]:
    """The closed surface of each component of labels, mm in the frame of the volume, by name; and what they are.

    Several components are NAME1, NAME2 and so on, the largest first.
    """
    if 0 in keys:
        raise InputError("label 0 is the background", file=Path(volume.file), remedy="name other labels")
    mask = np.isin(volume.values, keys)
    parts, specks = label_surfaces(mask, volume.affine, handles=handles)
    labels = ", ".join(map(str, keys))
    if not parts:
        raise InputError(
            f"label {labels} has {sum(specks)} voxels in {len(specks)} pieces, too few for a surface",
            file=Path(volume.file),
            remedy="omit the surface, or give a finer volume",
        )
    names = [name] if len(parts) == 1 else [f"{name}{number}" for number in range(1, len(parts) + 1)]
    if any(mask.take(end, axis).any() for axis in range(3) for end in (0, -1)):
        what = "%s: label %s reaches the border of the image, where its surface is flat"
        logger.warning(what, volume.file or name, labels)
    told = [_told(own, part, labels) for own, part in zip(names, parts, strict=True)]
    if specks:
        told.append(f"{name}: {len(specks)} pieces of at most {max(specks)} voxels were left out")
    return {own: part.surface for own, part in zip(names, parts, strict=True)}, told


def _told(name: str, part: LabelSurface, labels: str) -> str:
    """What a surface of labels is, in one line."""
    words = [
        f"{name}: {len(part.surface.points)} vertices around label {labels}, {part.volume / 1000:.3f} mL, "
        f"at most {part.furthest:.2f} voxels from its boundary"
    ]
    if part.changed:
        words.append(f"{_handles(part.handles)} cut or closed by changing {part.changed} voxels")
    if part.left:
        words.append(f"{_handles(part.left)} left")
    words += [f"{part.filled} voxels of cavities filled"] if part.filled else []
    return "; ".join(words)


def _handles(count: int) -> str:
    return f"{count} handle{'' if count == 1 else 's'}"
