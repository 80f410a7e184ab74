"""Names of fields and sets on the way to another format: which become ASCII, and which are left out."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from cortet.formats.surface_sets import CORE
from cortet.formats.tags import region_numbers
from cortet.formats.untrusted import safely_named
from cortet.meshes import REGION, MeshSets, TetMesh
from cortet.solver_files.sets import set_name

#: formats whose files are plain ASCII
ASCII = ("abaqus", "febio", "nastran", "carp", "carp_binary")

_T = TypeVar("_T")


def in_ascii(mesh: TetMesh, solver: str) -> tuple[TetMesh, list[str]]:
    """The mesh with names in ASCII, and the changed names in words: `dïcke` becomes `dicke`, for Abaqus `a b` `a_b`."""
    plain: Callable[[Mapping[str, Any]], dict[str, Any]] = _for_abaqus if solver == "abaqus" else _plain
    sets = MeshSets(*(plain(named) for named in (mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells)))
    made = replace(mesh, point_data=plain(mesh.point_data), cell_data=plain(mesh.cell_data), sets=sets)
    changes = [
        f"{old} is called {new}"
        for before, after in zip(_named(mesh), _named(made), strict=True)
        for old, new in zip(before, after, strict=True)
        if old != new
    ]
    return made, list(dict.fromkeys(changes))


def left_out(mesh: TetMesh, back: TetMesh) -> list[str]:
    """Which fields and sets of a mesh are missing when its file is read back, in words.

    A field of several components may have become one field per component, named `<field>_1` and so on.
    """
    whats = ("fields of the nodes", "fields of the tetrahedra", "sets of nodes", "sets of faces", "sets of tetrahedra")
    told = []
    for what, before, after in zip(whats, _named(mesh), _named(back), strict=True):
        lost = [name for name in before if name not in after and f"{name}_1" not in after]
        lost = [name for name in lost if name != REGION]  # every format has the numbers
        if before is mesh.sets.cells and after and _is_of_regions(mesh, CORE):
            lost = [name for name in lost if name != CORE]
        one = after and what in whats[3:]
        why = "an element has one number, and is in one set" if one else f"the format has no {what}"
        told += [f"left out, as {why}: {', '.join(lost)}"] if lost else []
        volumes = [name for name in mesh.cell_data if any(one.startswith(f"{name}_") for one in lost)]
        if before is mesh.sets.cells and after and volumes:
            told.append(f"`cortet convert --tags {volumes[0]}` writes labels of {volumes[0]} in place of the regions")
    return told


def _is_of_regions(mesh: TetMesh, name: str) -> bool:
    """Whether a set of tetrahedra is made of whole regions, which tell it."""
    number = region_numbers(mesh)
    own = number[mesh.sets.cells.get(name, np.empty(0, np.int32))]
    return int(np.count_nonzero(np.isin(number, own))) == len(own)


def _named(mesh: TetMesh) -> tuple[Mapping[str, object], ...]:
    return mesh.point_data, mesh.cell_data, mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells


def _for_abaqus(values: Mapping[str, _T]) -> dict[str, _T]:
    """The same values by names that differ in more than case, of the letters that Abaqus takes."""
    result: dict[str, _T] = {}
    for name, value in _plain(values).items():
        result[set_name(name, result)] = value
    return result


def _plain(values: Mapping[str, _T]) -> dict[str, _T]:
    if all(name.isascii() for name in values):
        return dict(values)
    plain = (unicodedata.normalize("NFKD", name.replace("ß", "ss")) for name in values)
    return safely_named(zip((name.encode("ascii", "ignore").decode() for name in plain), values.values(), strict=True))
