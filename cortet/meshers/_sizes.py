"""Smaller cell sizes given by a field, at the surface of a region, or in the voxels of a volume."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.formats.volumes import Volume, is_volume, read_labels, read_named
from cortet.geometry.nesting import sheets
from cortet.meshers._remesh import GROWTH, SHORTEST
from cortet.meshers.mesher import Facts, Sources
from cortet.meshes import FloatArray, TriSurface, region_names

_REMEDY = "where finer cells are wanted, choose a smaller cell size"
#: most voxels that may require smaller cells
_MOST_VOXELS = 5_000_000


def checked(
    sizes: Mapping[str, float | None], surface: TriSurface, cell_size: float
) -> tuple[Sources, dict[str, Volume]]:
    """The voxels of the volumes in `sizes`, in the coordinates of a surface; and these volumes.

    Parameters
    ----------
    sizes : `generate.sizes`
    surface : in mm, in its frame, with its inner surfaces
    """
    names = region_names(surface.inner)
    for name, size in sizes.items():
        if is_volume(name):
            continue
        if name not in names:
            raise InputError(
                f"generate.sizes: the mesh has no region {name}",
                remedy=f"name one of {', '.join(names)}, or a volume as FILE:LABELS",
            )
        if size is None:
            raise InputError(f"generate.sizes: the region {name} has no size", remedy="give one in mm")
        _check(np.array([size]), cell_size, name)
    volumes = {text: _volume_of(text, size) for text, size in sizes.items() if is_volume(text)}
    sources = _sources_of(sizes, volumes, surface, cell_size)
    return sources, {text: volume for text, (volume, _) in volumes.items()}


def _volume_of(text: str, size: float | None) -> tuple[Volume, list[int]]:
    """The volume that a size is given for, and its labels that have the size; no labels for a volume of sizes."""
    if size is not None:
        return read_labels(text)
    volume = read_named(text)
    if volume.kind != "numbers":
        raise InputError(
            f"holds {volume.kind}, not cell sizes in mm", file=volume.file, remedy="name labels: FILE:5,6=MM"
        )
    return volume, []


def _sources_of(
    sizes: Mapping[str, float | None],
    volumes: Mapping[str, tuple[Volume, list[int]]],
    surface: TriSurface,
    cell_size: float,
) -> Sources:
    """The voxels of volumes, each with the labels that count, in the coordinates of a surface."""
    points, wanted = [np.zeros((0, 3))], [np.zeros(0)]
    for text, (volume, keys) in volumes.items():
        size = sizes[text]
        if size is None:
            values = np.asarray(volume.values, float)
            chosen = np.isfinite(values) & (values > 0) & (values < cell_size)
            mine = values[chosen]
        else:
            chosen = np.isin(volume.values, keys)
            mine = np.full(int(chosen.sum()), float(size))
        _check(mine, cell_size, text)
        if len(mine) > _MOST_VOXELS:
            raise InputError(
                f"{len(mine)} voxels ask for smaller cells, more than {_MOST_VOXELS}",
                file=volume.file,
                remedy="choose a smaller cell size, or give a coarser volume",
            )
        voxels = np.argwhere(chosen)
        points.append(voxels @ volume.affine[:3, :3].T + volume.affine[:3, 3])
        wanted.append(mine)
    back = np.linalg.inv(surface.frame.to_scanner)
    return Sources(np.concatenate(points) @ back[:3, :3].T + back[:3, 3], np.concatenate(wanted))


def sizes_on(surface: TriSurface, settings: Generate, facts: Facts) -> list[FloatArray] | None:
    """The cell size at each vertex of each surface, (n,) mm, infinite where none is given; None if none is anywhere."""
    every = sheets(surface)
    if settings.size_field is None and not settings.sizes and not len(facts.sources.points):
        return None
    found = (
        [np.full(len(one.points), np.inf) for one in every]
        if settings.size_field is None
        else _by_field(surface, settings.size_field, facts.cell_size)
    )
    names = region_names(surface.inner)
    for name, size in settings.sizes.items():
        if name in names and size is not None:
            number = names.index(name)
            found[number] = np.minimum(found[number], size)
    return [np.minimum(size, _near(facts.sources, one.points)) for size, one in zip(found, every, strict=True)]


def _near(sources: Sources, points: FloatArray) -> FloatArray:
    """The smallest size that any source, graded from its position, requires at each point (n, 3): (n,) mm."""
    found = np.full(len(points), np.inf)
    steps = np.round(np.log2(sources.sizes) * 8)  # one tree for sizes that differ by less than 9 %
    for step in np.unique(steps):
        mine = steps == step
        distance, _ = KDTree(sources.points[mine]).query(points)
        found = np.minimum(found, sources.sizes[mine].min() + GROWTH * distance)
    return found


def _by_field(surface: TriSurface, name: str, cell_size: float) -> list[FloatArray]:
    """Values of a field of sizes on each surface, (n,) mm; infinite on a surface without the field."""
    every = sheets(surface)
    if not any(name in one.point_data for one in every):
        known = ", ".join(surface.point_data) or "none"
        raise InputError(
            f"generate.size_field: the surface has no field {name} (it has: {known})",
            remedy="name a field of the surface, or give it: `--field NAME=FILE`, in a sheet by a column `field_NAME`",
        )
    found = []
    for one in every:
        values = np.asarray(one.point_data.get(name, np.full(len(one.points), np.inf)), np.float64)
        least = SHORTEST * cell_size
        bad = ~(values >= least) if values.ndim == 1 else np.ones(1, np.bool_)
        if bad.any():
            what = f"{np.count_nonzero(bad)} values that are not cell sizes of at least {least:g} mm ({SHORTEST:g} h)"
            shown = f", the first {values[bad.argmax()]} at vertex {bad.argmax()}"
            raise InputError(
                f"generate.size_field: {name} has {what}{shown}", remedy=f"give one size in mm per vertex; {_REMEDY}"
            )
        found.append(values)
    return found


def _check(sizes: FloatArray, cell_size: float, name: str) -> None:
    """Raise InputError for sizes that are below the smallest of this cell size."""
    least = SHORTEST * cell_size
    if len(sizes) and not sizes.min() >= least:
        raise InputError(
            f"generate.sizes: {name} asks for cells of {sizes.min():g} mm, less than {least:g} mm ({SHORTEST:g} h)",
            remedy=_REMEDY,
        )
