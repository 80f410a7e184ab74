"""Volumes on a mesh: the label, number or tensor that an image has inside each tetrahedron."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, place_mm
from cortet.formats.hashing import sha256
from cortet.formats.volumes import Volume, label_table, matrices, read_named, six, to_scanner, volume_file, volume_of
from cortet.geometry.coverage import coverage
from cortet.geometry.limits import NAME
from cortet.geometry.mending import measurable
from cortet.geometry.nesting import joined
from cortet.geometry.voxels import in_voxels, labels_inside, means_inside
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, CoordinateFrame, FloatArray, IntArray, TetMesh, TriSurface, is_brain

if TYPE_CHECKING:
    from nibabel.spatialimages import SpatialImage

VERSION: int = 3

logger = logging.getLogger(__name__)

#: field of the principal direction of a tensor, which CARP's fibre files use
FIBRE = "fibre"
#: reserved names
_TAKEN = (REGION, FIBRE, "q")
#: labels are misplaced if they cover less than this share of what they could cover of the inside
_LEAST_COVERED = 0.5
#: signs of x, y and z in LPS, compared with RAS
_LPS = np.array([-1, -1, 1])
_REMEDY = (
    "give a volume of this brain in the space of the surface; "
    "the volume or the surface may be shifted, flipped, or in LPS"
)
#: a warning is given if more than this share of a brain lies where a volume is 0 or holds no number
_BARE = 0.05
#: label 0 is the outside, not a tissue, if less than this share of a mesh has it
_OUTSIDE = 0.1
#: eigenvalues of a tensor below this share of its largest one are raised to it, since a logarithm needs them
_LEAST_EIGENVALUE = 1e-6


class Background(NamedTuple):
    """How much of a brain lies where a volume is 0 or has no value."""

    #: name of the volume
    volume: str
    fraction: float
    sentence: str

    @property
    def large(self) -> bool:
        """Whether the certificate says it."""
        return self.fraction > _BARE


def read_volumes(given: Mapping[str, str | Path | SpatialImage | Volume]) -> dict[str, Volume]:
    """The volumes of `NAME -> FILE`, `NAME -> FILE:KIND` or `NAME -> image`; those that were read stay as they are."""
    for name in given:
        text = name if isinstance(name, str) else ""
        if not re.fullmatch(NAME, text) or text.lower() in _TAKEN:
            raise InputError(
                f"{name!r} cannot be the name of a volume",
                remedy=f"use letters and digits, a letter first, and none of {', '.join(_TAKEN)}",
            )
    return {name: _volume(name, one) for name, one in given.items()}


def _volume(name: str, given: Any) -> Volume:
    if isinstance(given, Volume):
        return given
    if isinstance(given, str | Path):
        return read_named(str(given))
    if hasattr(given, "affine") and hasattr(given, "dataobj"):  # nibabel's SpatialImage
        return volume_of(given)
    what = f"the volume {name} is a {type(given).__name__}, which does not state the location of its voxels"
    raise InputError(what, remedy="give a file, or a NiBabel image")


def backgrounds(volumes: Mapping[str, Volume], surface: TriSurface) -> list[Background]:
    """How much of a brain lies in the background of each volume; a warning is logged where it is large.

    Parameters
    ----------
    surface : of the brain, or with brains inside it; in mm, in its frame; coordinates need not be finite
    """
    if not volumes:
        return []
    brain = _brain(surface)
    for volume in volumes.values():
        _require_cover(volume, brain)
    return [_background(name, volume, brain) for name, volume in volumes.items()]


def _brain(surface: TriSurface) -> TriSurface:
    """The brain of a surface, or the brains inside it, in the space of volumes."""
    inside = [one for name, one in surface.inner.items() if is_brain(name)] or [surface]
    brain = joined([measurable(one) for one in inside])
    return replace(brain, points=to_scanner(brain.points, surface.frame), inner={})


def with_volumes(
    mesh: TetMesh,
    volumes: Mapping[str, Volume],
    *,
    frame: CoordinateFrame | None = None,
    background: Sequence[Background] = (),
) -> tuple[TetMesh, list[dict[str, Any]]]:
    """The mesh with a cell field for each volume; and the rows of `formats.volumes.TISSUE_COLUMNS`.

    Each tetrahedron gets the label, a whole number, with the largest share in it. If less than a tenth of the mesh has
    no label, 0 is the outside, and a tetrahedron gets it only if it has no other. Numbers are means. Tensors are
    log-Euclidean means (Arsigny et al., Magnetic Resonance in Medicine 56, 2006), (m, 6): xx, yy, zz, xy, yz, xz; the
    direction of the first one's largest eigenvalue is the field `fibre`, (m, 3).

    Parameters
    ----------
    frame : of the surface that the mesh was made from; it maps to the space of the volumes
    background : `backgrounds` of the volumes, for the table
    """
    if not volumes:
        return mesh, []
    points = to_scanner(mesh.points, frame or CoordinateFrame())
    q, size = quality(mesh.points, mesh.cells), signed_volumes(mesh.points, mesh.cells)
    fields: dict[str, NDArray[Any]] = {}
    rows: list[dict[str, Any]] = []
    for name, volume in volumes.items():
        if name in mesh.point_data or name in mesh.cell_data:
            what = f"the mesh already has a field {name}"
            raise InputError(what, file=volume.file, remedy="give the volume another name")
        bare = next((one.fraction for one in background if one.volume == name), None)
        about = {"volume": name, "kind": volume.kind, "background": bare}
        if volume.kind == "labels":
            found = labels_inside(points, mesh.cells, volume.values, volume.affine)
            label, share = found.label, found.share
            if np.average(found.zero, weights=size) < _OUTSIDE:
                label, share = found.other, np.where(found.other_share > 0, found.other_share, found.zero)
            fields[name] = label
            rows += [about | row for row in _tissues(label, share, volume.names, size, q)]
        else:
            values = _logarithms(volume.values) if volume.kind == "tensors" else volume.values
            means, without = means_inside(points, mesh.cells, values, volume.affine)
            if volume.kind == "tensors":
                means, first = _from_logarithms(means, frame or CoordinateFrame())
                fields.setdefault(FIBRE, first)
            fields[name] = means
            whole = {"tetrahedra": len(q), "volume_ml": float(size.sum()) / 1000, "q_max": float(q.max())}
            rows.append(about | whole | {"without_value": int(without.sum())})
    return replace(mesh, cell_data={**mesh.cell_data, **fields}), rows


def label_names(volumes: Mapping[str, Volume]) -> dict[str, dict[int, str]]:
    """Names of the labels of each volume of labels, for `sets.named_sets`."""
    return {name: volume.names for name, volume in volumes.items() if volume.kind == "labels"}


def sources(files: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """What the sidecar of a mesh says about the files `NAME -> FILE` or `NAME -> FILE:KIND` of its volumes."""
    return {
        name: {"file": file, "sha256": sha256(volume_file(file))}
        | ({"names": str(table), "names_sha256": sha256(table)} if (table := label_table(volume_file(file))) else {})
        for name, file in files.items()
    }


def _tissues(
    label: IntArray, share: NDArray[Any], names: Mapping[int, str], size: FloatArray, q: FloatArray
) -> Iterator[dict[str, Any]]:
    """A row for each label that a mesh has."""
    for key in np.unique(label).tolist():
        mine = label == key
        yield {
            "label": key,
            "name": names.get(key) or (None if key else "no label"),
            "tetrahedra": int(mine.sum()),
            "volume_ml": float(size[mine].sum()) / 1000,
            "q_max": float(q[mine].max()),
            "share": float(np.average(share[mine], weights=size[mine])),
        }


def _outside(volume: Volume, points: FloatArray) -> FloatArray:
    """How far points (n, 3) are outside a volume, mm: (n,); 0 within it."""
    shape = np.array(volume.values.shape[:3])
    widths = np.linalg.norm(volume.affine[:3, :3], axis=0)
    where = in_voxels(volume.affine, points)
    return np.asarray((np.maximum(np.maximum(-0.5 - where, where - shape + 0.5), 0) * widths).max(axis=1))


def _covers(volume: Volume, brain: TriSurface) -> tuple[float, float]:
    """The share of a brain where a volume holds a value, and the largest share that it could cover."""
    values = volume.values if volume.kind == "tensors" else volume.values[..., None]
    held = np.isfinite(values).all(axis=3) & values.any(axis=3)
    return coverage(brain, held, volume.affine)


def _remedy(volume: Volume, brain: TriSurface) -> str:
    """What to do about a surface and a volume in different locations; LPS first, if that would align them."""
    turned = replace(brain, points=brain.points * _LPS)
    if _outside(volume, turned.points).max() <= volume.voxel:
        covered, possible = _covers(volume, turned)
        if covered > _LEAST_COVERED * possible:
            return f"the surface is in LPS, it seems: negate its x and y; or {_REMEDY}"
    return _REMEDY


def _require_cover(volume: Volume, brain: TriSurface) -> None:
    """Raise InputError if a surface extends beyond a volume by more than the width of a voxel."""
    shape, out = np.array(volume.values.shape[:3]), _outside(volume, brain.points)
    if out.max() <= np.linalg.norm(volume.affine[:3, :3], axis=0).max():
        return
    corners = np.array(np.meshgrid(*([-0.5, n - 0.5] for n in shape))).reshape(3, -1).T
    corners = corners @ volume.affine[:3, :3].T + volume.affine[:3, 3]
    what = (
        f"{(out > 0).mean():.1%} of the surface's vertices lie outside the volume, by up to {out.max():.1f} mm; the "
        f"volume reaches from {place_mm(corners.min(axis=0))} to {place_mm(corners.max(axis=0))}"
    )
    raise InputError(what, file=volume.file, remedy=_remedy(volume, brain))


def _background(name: str, volume: Volume, brain: TriSurface) -> Background:
    """How much of a brain has no label, or no number other than 0; InputError if most labels lie beside it."""
    covered, possible = _covers(volume, brain)
    if volume.kind == "labels" and covered <= _LEAST_COVERED * possible:
        what = f"its labels cover {covered:.0%} of the brain; correctly aligned, they could cover {possible:.0%}"
        raise InputError(what, file=volume.file, remedy=_remedy(volume, brain))
    fraction = max(0.0, 1 - covered)
    what = f"{name}: {fraction:.1%} of the brain lies where {volume.file or 'the volume'} is 0 or holds no "
    background = Background(name, fraction, what + ("label" if volume.kind == "labels" else "number"))
    if background.large:
        logger.warning(background.sentence)
    return background


def _logarithms(tensors: NDArray[Any]) -> NDArray[np.float64]:
    """Matrix logarithms of tensors (i, j, k, 6); NaN where there is none, or no eigenvalue is above 0."""
    flat = tensors.reshape(-1, 6)
    result = np.full(flat.shape, np.nan)
    held = np.flatnonzero(np.isfinite(flat).all(axis=1))
    values, vectors = np.linalg.eigh(matrices(flat[held]))
    positive = values[:, -1] > 0
    held, values, vectors = held[positive], values[positive], vectors[positive]
    logs = np.log(np.maximum(values, _LEAST_EIGENVALUE * values[:, -1:]))
    result[held] = six(np.einsum("nij,nj,nkj->nik", vectors, logs, vectors))
    return result.reshape(tensors.shape)


def _from_logarithms(means: FloatArray, frame: CoordinateFrame) -> tuple[FloatArray, FloatArray]:
    """Tensors (m, 6) from logarithms (m, 6), in the axes of the surface, and their principal directions (m, 3)."""
    left, _, right = np.linalg.svd(frame.to_scanner[:3, :3])
    turn = (left @ right).T
    values, vectors = np.linalg.eigh(matrices(means))
    vectors = turn @ vectors
    first = vectors[:, :, 2]
    largest = np.take_along_axis(first, np.abs(first).argmax(axis=1)[:, None], axis=1)
    return six(np.einsum("nij,nj,nkj->nik", vectors, np.exp(values), vectors)), first * np.sign(largest)
