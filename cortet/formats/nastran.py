"""Nastran bulk data (`.bdf`): `GRID*`, `CTETRA`, and `CTRIA3` for the faces of the surface.

Property numbers identify parts: 1 and 2 are the regions core and cortex, 11 and 12 the cortical surface and the medial
wall. Comments at the beginning name them. Numbers count from 1 in the order of the mesh. The user adds the cards of
properties and materials. Other sets and fields are not written. meshio reads the file. Source: MSC Nastran Quick
Reference Guide, "Bulk Data Entries".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from meshio import CellBlock, ReadError, nastran
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import CORTEX, REGION_TAGS, SURFACE_TAGS, region_tags, with_surface
from cortet.formats.text import write_rows
from cortet.formats.untrusted import content, sound
from cortet.meshes import MeshSets, TetMesh

#: property numbers of parts of the surface begin above this one, since a property may not hold both solids and shells
_SHELLS = 10
#: errors that meshio raises for files that are damaged or not of Nastran
_DAMAGED = (ReadError, RuntimeError, AssertionError, ValueError, KeyError, IndexError, TypeError, OverflowError)


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    parts = {name: mesh.sets.faces[name] for name in SURFACE_TAGS if name in mesh.sets.faces}
    names = {tag: name for name, tag in REGION_TAGS.items() if name in mesh.sets.cells}
    names |= {_SHELLS + SURFACE_TAGS[name]: name for name in parts}
    regions = region_tags(mesh) if mesh.sets.cells else np.ones(len(mesh.cells), np.int32)
    count = len(mesh.cells)
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.writelines(f"$ property {tag}: {name}\n" for tag, name in names.items())
        file.write("BEGIN BULK\n")
        card = "GRID*   %16d                %16.9E%16.9E\n*       %16.9E\n"
        write_rows(file, card, np.arange(1, len(mesh.points) + 1), mesh.points)
        write_rows(file, "CTETRA  %8d%8d%8d%8d%8d%8d\n", np.arange(1, count + 1), regions, mesh.cells + 1)
        for name, faces in parts.items():
            tags = np.full(len(faces), _SHELLS + SURFACE_TAGS[name])
            write_rows(file, "CTRIA3  %8d%8d%8d%8d%8d\n", count + np.arange(1, len(faces) + 1), tags, faces + 1)
            count += len(faces)
        file.write("ENDDATA\n")


def read(path: str | Path) -> TetMesh:
    """Read a file with meshio; regions and parts of the surface come back by their property numbers.

    Raises
    ------
    InputError
        the file is missing or cut off, holds no tetrahedra, or names nodes that it lacks
    """
    text = content(path)
    begin, end = text.find(b"BEGIN BULK"), text.find(b"\nENDDATA")
    if begin < 0 or end < begin:
        raise InputError("does not hold bulk data from BEGIN BULK to ENDDATA", file=path, remedy="export it again")
    try:
        found = nastran.read(str(path))
    except _DAMAGED as error:
        raise InputError(f"is not a readable Nastran file: {error}", file=path, remedy="export it again") from error
    tags = found.cell_data.get("nastran:ref", [np.zeros(len(block.data), int) for block in found.cells])
    cells, regions = _of_kind("tetra", found.cells, tags, 4)
    faces, parts = _of_kind("triangle", found.cells, tags, 3)
    if not len(cells):
        raise DamagedFileError("holds no tetrahedra of four nodes", file=path)
    sets = MeshSets(
        faces={name: faces[parts == _SHELLS + tag] for name, tag in SURFACE_TAGS.items() if _SHELLS + tag in parts},
        cells={
            name: np.flatnonzero(regions == tag).astype(np.int32)
            for name, tag in REGION_TAGS.items()
            if tag in regions and REGION_TAGS[CORTEX] in regions
        },
    )
    return sound(path, found.points, cells, sets=sets)


def _of_kind(
    kind: str, blocks: list[CellBlock], tags: list[NDArray[Any]], corners: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Nodes (m, corners) and property numbers (m,) of all elements of one kind."""
    chosen = [number for number, block in enumerate(blocks) if block.type == kind]
    nodes = [np.empty((0, corners), np.int64), *(np.asarray(blocks[number].data) for number in chosen)]
    return np.concatenate(nodes), np.concatenate([np.empty(0, np.int64), *(tags[number] for number in chosen)])
