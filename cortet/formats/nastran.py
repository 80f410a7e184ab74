"""Nastran bulk data (`.bdf`): `GRID*`, `CTETRA`, and `CTRIA3` for the faces of the surface.

Property numbers identify regions, parts of the surface and interfaces (`tags`). Comments at the beginning name them:
`$ property 1: cortex`. Numbers count from 1 in the order of the mesh. The user adds the cards of
properties and materials. Other sets and fields are not written. meshio reads the file. Source: MSC Nastran Quick
Reference Guide, "Bulk Data Entries".
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from meshio import CellBlock, ReadError, nastran
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import face_tags, named_once, region_numbers, regions, with_names
from cortet.formats.text import write_rows
from cortet.formats.untrusted import content, sound
from cortet.meshes import REGION, MeshSets, TetMesh

_NAME = re.compile(rb"^\$ property (\d{1,8}): (\S.*?)\s*$", re.MULTILINE)
#: errors that meshio raises for files that are damaged or not of Nastran
_DAMAGED = (ReadError, RuntimeError, AssertionError, ValueError, KeyError, IndexError, TypeError, OverflowError)


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    shells = face_tags(mesh)
    count = len(mesh.cells)
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.writelines(f"$ property {tag}: {name}\n" for name, tag in (regions(mesh) | shells).items())
        file.write("BEGIN BULK\n")
        card = "GRID*   %16d                %16.9E%16.9E\n*       %16.9E\n"
        write_rows(file, card, np.arange(1, len(mesh.points) + 1), mesh.points)
        write_rows(file, "CTETRA  %8d%8d%8d%8d%8d%8d\n", np.arange(1, count + 1), region_numbers(mesh), mesh.cells + 1)
        for name, tag in shells.items():
            tags = np.full(len(faces := mesh.sets.faces[name]), tag)
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
    cells, solids = _of_kind("tetra", found.cells, tags, 4)
    faces, parts = _of_kind("triangle", found.cells, tags, 3)
    if not len(cells):
        raise DamagedFileError("holds no tetrahedra of four nodes", file=path)
    names = named_once([(name.decode("ascii", "replace"), int(tag)) for tag, name in _NAME.findall(text[:begin])], path)
    sets = MeshSets(faces={name: faces[parts == tag] for name, tag in names.items() if tag in parts})
    return sound(path, found.points, cells, cell_data={REGION: solids}, sets=with_names(sets, solids, names))


def _of_kind(
    kind: str, blocks: list[CellBlock], tags: list[NDArray[Any]], corners: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Nodes (m, corners) and property numbers (m,) of all elements of one kind."""
    chosen = [number for number, block in enumerate(blocks) if block.type == kind]
    nodes = [np.empty((0, corners), np.int64), *(np.asarray(blocks[number].data) for number in chosen)]
    return np.concatenate(nodes), np.concatenate([np.empty(0, np.int64), *(tags[number] for number in chosen)])
