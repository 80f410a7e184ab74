"""Each convention of solvers that a mesh breaks is named, and no other; nothing is written then."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from exported import full_mesh

from cortet.errors import StageError
from cortet.meshes import MeshSets, TetMesh
from cortet.solver_files.conventions import broken_conventions
from cortet.solver_files.export import export


def swapped_node_pair(mesh: TetMesh) -> TetMesh:
    cells = mesh.cells.copy()
    cells[4, :2] = cells[4, 1::-1]
    return replace(mesh, cells=cells)


def wrong_sign(mesh: TetMesh) -> TetMesh:
    return replace(mesh, cells=mesh.cells[:, [0, 1, 3, 2]])


def faces_changed(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[TetMesh], TetMesh]:
    """Only the division of the surface, with other faces of the cortical surface."""

    def changed(mesh: TetMesh) -> TetMesh:
        parts = {name: mesh.sets.faces[name] for name in ("cortical_surface", "medial_wall")}
        parts["cortical_surface"] = change(parts["cortical_surface"])
        return replace(mesh, sets=MeshSets({}, parts, {}))

    return changed


def interior_node_first(mesh: TetMesh) -> TetMesh:
    """The first and the last node change their numbers."""
    number = np.arange(len(mesh.points), dtype=np.int32)
    number[[0, -1]] = number[[-1, 0]]
    return TetMesh(
        mesh.points[number],
        number[mesh.cells],
        {name: values[number] for name, values in mesh.point_data.items()},
        sets=MeshSets(
            {name: np.sort(number[nodes]) for name, nodes in mesh.sets.nodes.items()},
            {name: number[faces] for name, faces in mesh.sets.faces.items()},
            mesh.sets.cells,
        ),
    )


def field_not_finite(mesh: TetMesh) -> TetMesh:
    values = mesh.point_data["thickness"].copy()
    values[3] = np.nan
    return replace(mesh, point_data={**mesh.point_data, "thickness": values})


@pytest.mark.parametrize(
    ("breakage", "word"),
    [
        (swapped_node_pair, "number 5"),
        (wrong_sign, "384 of 384"),
        (faces_changed(lambda faces: np.vstack([faces[:7], faces[7:8, ::-1], faces[8:]])), "inward.* number 8"),
        (faces_changed(lambda faces: np.delete(faces, 7, axis=0)), "1 .*missing"),
        (faces_changed(lambda faces: np.vstack([faces, faces[:1]])), "1 .*more than once"),
        (faces_changed(lambda faces: np.vstack([faces, [[0, 1, 124]]])), "not on the boundary"),
        (interior_node_first, "node 125"),
        (field_not_finite, "thickness.*finite"),
    ],
)
def test_each_broken_convention_is_named_and_nothing_is_written(breakage, word, tmp_path):
    broken = breakage(full_mesh())
    found = broken_conventions(broken)
    assert re.search(word, found[0]) and (len(found) == 1 or breakage in (swapped_node_pair, wrong_sign)), found
    with pytest.raises(StageError, match=word):
        export(broken, tmp_path / "m.inp", solver="abaqus")
    assert not list(tmp_path.iterdir())
