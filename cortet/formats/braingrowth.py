"""`.mesh` of the BrainGrowth solver (Tallinen et al., Nature Physics 2016; https://github.com/rousseau/BrainGrowth).

Text: the number of nodes and `x y z` each; the number of tetrahedra and `tag a b c d` each; the number of boundary
triangles and `tag a b c` each. Nodes count from 1, surface nodes come first, tetrahedra have **negative** volume,
triangles face outward. Tags, which the solver skips, are those of `tags`: of regions, and of parts of the surface. (The
solver's loader swaps x with y and c with d; these two mirrors cancel.)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import SURFACE, with_surface
from cortet.formats.tags import face_tags, region_numbers
from cortet.formats.untrusted import by_library, content, sound
from cortet.formats.values import write_rows
from cortet.geometry.topology import boundary_nodes, compact
from cortet.meshes import TetMesh


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write a mesh whose surface nodes come first (`stages.solver_ready`), with coordinates in mm to 1e-9."""
    surface_nodes = boundary_nodes(mesh)
    if surface_nodes[-1] != len(surface_nodes) - 1:
        what = "BrainGrowth needs the surface nodes first, but they are not"
        raise InputError(what, file=path, remedy="run the stage solver_ready first")
    with atomic_path(path) as temporary, temporary.open("w") as file:
        file.write(f"{len(mesh.points)}\n")
        write_rows(file, "%.9f %.9f %.9f\n", mesh.points)
        file.write(f"{len(mesh.cells)}\n")
        write_rows(file, "%d %d %d %d %d\n", region_numbers(mesh), mesh.cells[:, [0, 1, 3, 2]] + 1)
        named = with_surface(mesh)
        parts = {tag: named.sets.faces[name] for name, tag in face_tags(named).items() if name in SURFACE}
        file.write(f"{sum(map(len, parts.values()))}\n")
        for tag, faces in parts.items():
            write_rows(file, f"{tag} %d %d %d\n", faces + 1)


def read(path: str | Path) -> TetMesh:
    """The nodes and tetrahedra of one of BrainGrowth's own meshes; unused nodes are dropped."""
    lines = content(path).split(b"\n")
    with by_library("a BrainGrowth mesh", path):
        first = int(lines[0]) + 1
        points = np.loadtxt(lines[1:first], ndmin=2)
        nodes = np.loadtxt(lines[first + 1 : first + 1 + int(lines[first])], np.int64, ndmin=2)[:, [1, 2, 4, 3]]
        if nodes.min() < 1 or nodes.max() > len(points):
            raise ValueError("a tetrahedron has a node that does not exist")
        points, cells, _ = compact(points, (nodes - 1).astype(np.int32))
    return sound(path, points, cells)
