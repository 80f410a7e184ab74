"""What a mesh and a surface promise: read-only arrays of the right shape and type, and indices of what there is."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import fold
from cortet.measure.certify import certify
from cortet.measure.quality import measures, quality, summarise
from cortet.meshes import MeshSets, TetMesh, TriSurface

MESH, SURFACE = ball_mesh(1), ball_surface(1)


@pytest.mark.parametrize("values", [np.zeros(3), np.zeros((3, 2)), np.float64(1)])
def test_a_field_has_one_value_per_node_or_cell(values):
    for make, of in (
        (lambda: TetMesh(MESH.points, MESH.cells, {"thickness": values}), "nodes"),
        (lambda: TetMesh(MESH.points, MESH.cells, {}, {"thickness": values}), "cells"),
        (lambda: TriSurface(SURFACE.points, SURFACE.faces, {"thickness": values}), "vertices"),
    ):
        with pytest.raises(InputError, match=f"thickness.* {of}"):
            make()


def test_fields_are_read_only_and_those_of_the_caller_are_not():
    thickness = np.arange(len(MESH.points), dtype=float)
    mesh = TetMesh(MESH.points, MESH.cells, {"thickness": thickness})
    with pytest.raises(ValueError, match="read-only"):
        mesh.point_data["thickness"][0] = 1
    thickness[0] = 5
    assert mesh.point_data["thickness"][0] == 0


LAST = len(MESH.points) - 1


@pytest.mark.parametrize(
    ("index", "shown"), [(-1, "-1"), (LAST + 1, f"{LAST + 1}"), (2**32, "4294967296"), (2**63, "9223372036854775808")]
)
def test_an_index_of_no_point_is_refused_with_element_and_range(index, shown):
    kind = np.uint64 if index >= 2**63 else np.int64
    cells, faces = MESH.cells.astype(kind), SURFACE.faces.astype(kind)
    cells[7, 2], faces[5, 1] = index, index
    with pytest.raises(InputError, match=f"tetrahedron 7 .*{shown}"):
        TetMesh(MESH.points, cells)
    with pytest.raises(InputError, match=f"triangle 5 .*{shown}"):
        TriSurface(SURFACE.points, faces)
    for measure in (quality, measures):
        with pytest.raises(InputError, match="tetrahedron 7"):
            measure(MESH.points, cells)


@pytest.mark.parametrize(
    ("points", "cells", "word"),
    [
        (MESH.points, MESH.cells + 0.5, "tetrahedron 0 .*float64"),
        (MESH.points, MESH.cells.astype(float), "float64"),
        (MESH.points, MESH.cells > 0, "bool"),
        (MESH.points, MESH.cells[:, :3], r"\(n, 4\)"),
        (MESH.points.astype(str), MESH.cells, "<U"),
        (MESH.points[:, :2], MESH.cells, r"\(n, 3\)"),
    ],
)
def test_what_is_no_array_of_points_or_cells_is_refused(points, cells, word):
    with pytest.raises(InputError, match=word):
        TetMesh(points, cells)


@pytest.mark.parametrize(
    ("kind", "members", "word"),
    [
        ("nodes", [LAST + 1], f"x 0 is {LAST + 1}"),
        ("faces", [[0, 1, 2], [0, 1, -1]], r"x 1 is \[0, 1, -1\]"),
        ("cells", [len(MESH.cells)], "tetrahedra"),
        ("cells", [0.5], "float64"),
    ],
)
def test_a_set_names_what_there_is(kind, members, word):
    with pytest.raises(InputError, match=word):
        replace(MESH, sets=MeshSets(**{kind: {"x": np.array(members)}}))


EMPTY = TetMesh(MESH.points, np.zeros((0, 4), np.int32))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_and_nothing_at_all_are_not_measured(bad, tmp_path):
    points = MESH.points.copy()
    points[3, 1] = bad
    for mesh, word in ((TetMesh(points, MESH.cells), "number 3"), (EMPTY, "no tetrahedra")):
        for measured in (
            lambda mesh=mesh: certify(mesh, SURFACE),
            lambda mesh=mesh: summarise(mesh),
            lambda mesh=mesh: fold(mesh, tmp_path, Settings(gestational_age=28.0)),
        ):
            with pytest.raises(InputError, match=word):
                measured()
    points = SURFACE.points.copy()
    points[4, 0] = bad
    nothing = TriSurface(SURFACE.points, np.zeros((0, 3), np.int32))
    for surface, word in ((TriSurface(points, SURFACE.faces), "1 of .* vertices"), (nothing, "no triangles")):
        for given in (surface, replace(SURFACE, inner={"white": surface})):
            with pytest.raises(InputError, match=word):
                certify(MESH, given)
