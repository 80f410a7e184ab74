"""Smaller cell sizes given by a field, or at the surface of a region."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.geometry.nesting import sheets
from cortet.meshers._remesh import SHORTEST
from cortet.meshes import FloatArray, TriSurface, region_names

_REMEDY = "for finer cells, choose a smaller cell size"


def require_sizes(sizes: Mapping[str, float], surface: TriSurface, cell_size: float) -> None:
    """Raise InputError for the size of a region that the mesh lacks, or below the smallest of this cell size.

    Parameters
    ----------
    sizes : `generate.sizes`
    surface : with its inner surfaces
    """
    names, least = region_names(surface.inner), SHORTEST * cell_size
    for name, size in sizes.items():
        if name not in names:
            raise InputError(f"generate.sizes: the mesh has no region {name}", remedy=f"name one of {', '.join(names)}")
        if size < least:
            raise InputError(
                f"generate.sizes: {name} asks for cells of {size:g} mm, less than {least:g} mm ({SHORTEST:g} h)",
                remedy=_REMEDY,
            )


def sizes_on(surface: TriSurface, settings: Generate, cell_size: float) -> list[FloatArray] | None:
    """The cell size at each vertex of each surface, (n,) mm, infinite where none is given; None if none is anywhere."""
    if settings.size_field is None and not settings.sizes:
        return None
    found = (
        [np.full(len(one.points), np.inf) for one in sheets(surface)]
        if settings.size_field is None
        else _by_field(surface, settings.size_field, cell_size)
    )
    asked = [settings.sizes.get(region, np.inf) for region in region_names(surface.inner)]
    return [np.minimum(of_field, size) for of_field, size in zip(found, asked, strict=True)]


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
