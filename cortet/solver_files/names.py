"""Fields and sets on the way to a format: which names and numbers it holds, and what is left out."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.tags import face_tags, regions
from cortet.formats.untrusted import safely_named
from cortet.measure.layers import THICKNESS
from cortet.meshes import REGION, MeshSets, TetMesh
from cortet.solver_files.sets import set_name

#: formats whose files are plain ASCII
ASCII = ("abaqus", "febio", "nastran", "carp")

#: growth that was measured up to an age: one of these and the age in weeks, with _ for the point
GROWTH_FIELD, CORE_GROWTH_FIELD = "growth_to_", "core_growth_to_"
_GROWTH = re.compile(re.escape(GROWTH_FIELD) + r"(\d+(?:[._]\d+)?)")

_T = TypeVar("_T")


def writable(mesh: TetMesh, solver: str) -> tuple[TetMesh, list[str]]:
    """The mesh with numbers and names that the files of a solver hold, and the changed names in words.

    Truth values become 1 and 0, half precision becomes single, and (n, 3, 3) tensors nine components. An unknown
    thickness of the cortex, NaN, becomes 0 unless the format is for viewers. Names have no slashes or tabs and at most
    80 letters; where files are in ASCII, `dïcke` becomes `dicke`, for Abaqus `a b` `a_b`.
    """
    sets = MeshSets(*(_renamed(named, solver) for named in (mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells)))
    of_nodes, of_cells = (
        _renamed({name: _real(name, values, solver) for name, values in fields.items()}, solver)
        for fields in (mesh.point_data, mesh.cell_data)
    )
    made = replace(mesh, point_data=of_nodes, cell_data=of_cells, sets=sets)
    changes = [
        f"{old} was renamed to {new}"
        for before, after in zip(_named(mesh), _named(made), strict=True)
        for old, new in zip(before, after, strict=True)
        if old != new
    ]
    return made, list(dict.fromkeys(changes))


def held(mesh: TetMesh, holds: Collection[str], *, groups: bool) -> TetMesh:
    """The part of the fields and sets of a mesh that a format holds.

    Parameters
    ----------
    holds : as `Format.holds`
    groups : as `Format.has_groups`
    """
    named = regions(mesh) | face_tags(mesh) if groups else {}

    def kept(kind: str, values: Mapping[str, Any], known: Collection[str] = ()) -> dict[str, Any]:
        return {name: some for name, some in values.items() if kind in holds or name in known}

    sets = MeshSets(
        kept("nodes", mesh.sets.nodes), kept("faces", mesh.sets.faces, named), kept("cells", mesh.sets.cells, named)
    )
    point_data, cell_data = kept("point_data", mesh.point_data), kept("cell_data", mesh.cell_data, holds)
    return replace(mesh, point_data=point_data, cell_data=cell_data, sets=sets)


def left_out(mesh: TetMesh, back: TetMesh) -> list[str]:
    """Which fields and sets of a mesh are missing in what its file holds, in words."""
    whats = ("fields of the nodes", "fields of the tetrahedra", "sets of nodes", "sets of faces", "sets of tetrahedra")
    told = []
    for what, before, after in zip(whats, _named(mesh), _named(back), strict=True):
        lost = [name for name in before if name not in after]
        lost = [name for name in lost if name != REGION]  # every format has the numbers
        one = after and what in whats[3:]
        why = "an element can be in only one set" if one else f"the format has no {what}"
        told += [f"left out, because {why}: {', '.join(lost)}"] if lost else []
        volumes = [name for name in mesh.cell_data if any(one.startswith(f"{name}_") for one in lost)]
        if before is mesh.sets.cells and after and volumes:
            told.append(f"`cortet convert --tags {volumes[0]}` writes labels of {volumes[0]} in place of the regions")
    return told


def _named(mesh: TetMesh) -> tuple[Mapping[str, object], ...]:
    return mesh.point_data, mesh.cell_data, mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells


def _real(name: str, values: NDArray[Any], solver: str) -> NDArray[Any]:
    """The values of a field, (n,) or (n, k), as whole or real numbers of a kind that its files have."""
    if values.dtype.kind not in "biuf" or (len(values) and not values.size):
        what = (
            f"the field {name} has the shape {values.shape} and the type {values.dtype}, which no mesh file can store"
        )
        raise InputError(what, remedy="give real numbers, for example the real part or modulus of a complex field")
    kind = {"?": np.uint8, "e": np.float32, "g": np.float64}.get(values.dtype.char, values.dtype.newbyteorder("="))
    if name == THICKNESS and not FORMATS[solver].has_q:
        values = np.nan_to_num(values)
    return (values.reshape(len(values), -1) if values.ndim > 2 else values).astype(kind, copy=False)


def _renamed(values: Mapping[str, _T], solver: str) -> dict[str, _T]:
    """The values by names that a solver takes; they differ, for Abaqus in more than case."""
    names: list[str] = []
    for given in values:
        name = _in_ascii(given) if solver in ASCII else given
        if solver == "carp":  # names are parts of names of files, between dots
            name = name.replace(".", "_")
        names.append(set_name(name, names) if solver == "abaqus" else name)
    return safely_named(zip(names, values.values(), strict=True))


def _in_ascii(name: str) -> str:
    return unicodedata.normalize("NFKD", name.replace("ß", "ss")).encode("ascii", "ignore").decode()


def growth_field(age: float, *, core: bool = False) -> str:
    """The name of the field with growth up to an age, of the cortex or of the core."""
    return f"{CORE_GROWTH_FIELD if core else GROWTH_FIELD}{age:g}".replace(".", "_")


def age_of_growth(name: str) -> float | None:
    """The age in weeks up to which a field of this name holds growth; None if it is not such a field."""
    found = _GROWTH.fullmatch(name)
    return float(found[1].replace("_", ".")) if found else None
