"""Every registered format gives back the mesh it was given."""

import numpy as np
import pytest
from shapes import cube_mesh

from cortet.formats import FORMATS
from cortet.stages.solver_ready import solver_ready


@pytest.mark.parametrize("name", FORMATS)
def test_a_solver_ready_mesh_survives(name, tmp_path):
    mesh, _ = solver_ready(cube_mesh(2, side=2.0, jitter=0.2))
    path = tmp_path / f"mesh{FORMATS[name].suffix}"
    FORMATS[name].write(mesh, path)
    back = FORMATS[name].read(path)
    assert path.exists() and np.array_equal(back.cells, mesh.cells)
    assert np.allclose(back.points, mesh.points, atol=1e-9)
