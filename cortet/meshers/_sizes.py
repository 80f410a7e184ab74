"""Smaller cell sizes given by a field, at the surface of a region, or around contacts of electrodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.geometry.nesting import sheets
from cortet.meshers._remesh import GROWTH, SHORTEST
from cortet.meshes import FloatArray, TriSurface, region_names

#: cells that the radius of a contact is divided into: edges are up to 1.25 times as long, so it has three of them
CELLS_OF_RADIUS = 3.75
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


def size_of_contacts(contacts: FloatArray, cell_size: float) -> FloatArray:
    """The cell size at contacts (k, 4), (k,) mm: a third of the radius, but not too small for this cell size."""
    return np.clip(contacts[:, 3] / CELLS_OF_RADIUS, SHORTEST * cell_size, cell_size)


def sizes_on(
    surface: TriSurface, settings: Generate, cell_size: float, contacts: FloatArray
) -> list[FloatArray] | None:
    """The cell size at each vertex of each surface, (n,) mm, infinite where none is given; None if none is anywhere.

    Parameters
    ----------
    contacts : as `mesher.Facts` has them
    """
    if settings.size_field is None and not settings.sizes and not len(contacts):
        return None
    found = (
        [np.full(len(one.points), np.inf) for one in sheets(surface)]
        if settings.size_field is None
        else _by_field(surface, settings.size_field, cell_size)
    )
    asked = [settings.sizes.get(region, np.inf) for region in region_names(surface.inner)]
    found = [np.minimum(of_field, size) for of_field, size in zip(found, asked, strict=True)]
    for contact, size in zip(contacts, size_of_contacts(contacts, cell_size), strict=True):
        for of_one, one in zip(found, sheets(surface), strict=True):
            beyond = np.linalg.norm(one.points - contact[:3], axis=1) - contact[3]
            np.minimum(of_one, size + GROWTH * np.maximum(beyond, 0), out=of_one)
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
