"""The number and the name of each region, and of each named part of the surface: the same in every format.

Regions count from 1, from the outside in, as the cell data `region` of a mesh does. Without inner surfaces `cortex` is
1 and `core` is 2; `core` is 1 where there is no cortex. Parts of the surface have numbers above 100, so that no number
means two things: 101 to 103 are those of `SURFACE`, and 110 + n is the interface around region n. Where a region has a
number above 99, such as a label of a volume, the next power of ten replaces 100.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.surface_sets import INTERFACE, SURFACE, interface_sets
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh

T = TypeVar("T")

#: name of the only region of a mesh without any
TISSUE = "tissue"
#: numbers of faces are above this one, those of interfaces by so much more
_FACES, _INTERFACES = 100, 10
#: numbers of regions are below this one: a field of a Nastran file has eight characters, which those of faces fill
TOO_LARGE = 10**7


def region_numbers(mesh: TetMesh) -> IntArray:
    """The number of the region of each tetrahedron: (m,) int32.

    It is the cell data `region`, if these are whole numbers. Else the sets of tetrahedra are regions, in their order,
    that share none with an earlier one and do not hold everything; what is left is one more region.
    """
    given = mesh.cell_data.get(REGION)
    if given is not None and given.ndim == 1 and np.isfinite(given).all() and (given == np.round(given)).all():
        outside = (given <= -TOO_LARGE) | (given >= TOO_LARGE)
        if outside.any():
            what = f"the region number {given[outside][0]:.0f} has more than seven digits"
            raise InputError(what, remedy="number the regions from 1 on")
        return given.astype(np.int32)
    number = np.zeros(len(mesh.cells), np.int32)
    for cells in mesh.sets.cells.values():
        if len(cells) and len(cells) < len(number) and not number[cells].any():
            number[cells] = number.max() + 1
    number[number == 0] = number.max(initial=0) + 1
    return number


def regions(mesh: TetMesh) -> dict[str, int]:
    """Name -> number of each region, ascending; the name is that of the first set of exactly its tetrahedra."""
    number = region_numbers(mesh)
    numbers, count = np.unique(number, return_counts=True)
    names: dict[int, str] = {}
    size = dict(zip(numbers.tolist(), count.tolist(), strict=True))
    for name, cells in mesh.sets.cells.items():
        own = int(number[cells[0]]) if len(cells) else 0
        if own not in names and len(cells) == size.get(own) and (number[cells] == own).all():
            names[own] = name
    alone = TISSUE if len(numbers) == 1 and not mesh.sets.cells else None
    return {names.get(one) or alone or f"region_{one}": one for one in numbers.tolist()}


def face_tags(mesh: TetMesh) -> dict[str, int]:
    """Name -> number of each part of the surface that the mesh has, then of each interface."""
    known = regions(mesh)
    largest = max(known.values(), default=1)
    first = _FACES if largest < _FACES else 10 ** len(str(largest))
    tags = {name: first + number for number, name in enumerate(SURFACE, start=1) if name in mesh.sets.faces}
    strange = largest
    for name in interface_sets(mesh):
        inside = known.get(name.removesuffix(INTERFACE))
        strange += inside is None
        tags[name] = first + _INTERFACES + (inside or strange)
    return tags


def without_tissue(groups: Mapping[str, T]) -> dict[str, T]:
    """The groups of a file by name; none where the only one is that of a mesh without regions."""
    return {} if [*groups] == [TISSUE] else dict(groups)


def with_names(mesh_sets: MeshSets, number: NDArray[Any], names: Mapping[str, int]) -> MeshSets:
    """The sets, with one of the tetrahedra of each number in front."""
    named = {name: np.flatnonzero(number == tag).astype(np.int32) for name, tag in without_tissue(names).items()}
    return MeshSets(
        mesh_sets.nodes,
        mesh_sets.faces,
        {name: cells for name, cells in named.items() if len(cells)} | mesh_sets.cells,
    )
