"""What a mesh and a surface promise: arrays of the right shape, which nobody changes."""

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.mesh import TetMesh, TriSurface

MESH, SURFACE = ball_mesh(1), ball_surface(1)


@pytest.mark.parametrize("values", [np.zeros(3), np.zeros((3, 2)), np.float64(1)])
def test_a_field_has_one_value_per_node_or_cell(values) -> None:
    with pytest.raises(ValueError, match=r"field thickness has shape .*, but there are [0-9]+ nodes"):
        TetMesh(MESH.points, MESH.cells, {"thickness": values})
    with pytest.raises(ValueError, match=r"[0-9]+ cells"):
        TetMesh(MESH.points, MESH.cells, {}, {"thickness": values})
    with pytest.raises(ValueError, match=r"[0-9]+ vertices"):
        TriSurface(SURFACE.points, SURFACE.faces, {"thickness": values})


def test_fields_are_read_only_and_those_of_the_caller_are_not() -> None:
    thickness = np.arange(len(MESH.points), dtype=float)
    mesh = TetMesh(MESH.points, MESH.cells, {"thickness": thickness})
    with pytest.raises(ValueError, match="read-only"):
        mesh.point_data["thickness"][0] = 1
    thickness[0] = 5
    assert mesh.point_data["thickness"][0] == 0
