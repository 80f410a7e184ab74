"""Nastran bulk data (`.bdf`): `GRID*`, `CTETRA`, and `CTRIA3` for the faces of the surface.

Property numbers identify regions, parts of the surface and interfaces (`tags`). Comments at the beginning name them:
`$ property 1: cortex`. Numbers count from 1 in the order of the mesh. The user adds the cards of
properties and materials. Other sets and fields are not written. meshio reads the file. Source: MSC Nastran Quick
Reference Guide, "Bulk Data Entries".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.formats.values import write_rows
from cortet.meshes import TetMesh


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
