"""Other meshers fill a surface as they come; whatever they do wrong is one error that says so."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from shapes import ball_surface

from cortet.errors import StageError
from cortet.geometry.topology import boundary_faces, enclosed_volume
from cortet.measure.quality import quality, signed_volumes
from cortet.meshers import baselines
from cortet.meshers.baselines import TOOLS, prepared, tetrahedra
from cortet.meshes import TriSurface
from cortet.stages.generate import generate

MODULES = {"tetgen": "tetgen", "ftetwild": "pytetwild", "gmsh": "gmsh", "netgen": "netgen"}


def installed(mesher: str) -> bool:
    return importlib.util.find_spec(MODULES[mesher]) is not None


@pytest.mark.parametrize("mesher", TOOLS)
def test_a_ball_is_filled(mesher):
    if not installed(mesher):
        pytest.skip(f"{mesher} is not installed")
    mesh, report = generate(ball_surface(), cell_size=2.0, mesher=mesher)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0
    assert signed_volumes(mesh.points, mesh.cells).sum() == pytest.approx(4 / 3 * np.pi * 5**3, rel=0.05)
    assert report.topology_ok
    assert (report.mesher, report.backend) == (mesher, TOOLS[mesher][0])


@pytest.mark.parametrize("mesher", ["tetgen", "gmsh", "netgen"])
def test_the_same_surface_gives_the_same_mesh(mesher):
    if not installed(mesher):
        pytest.skip(f"{mesher} is not installed")
    (first, cells), (second, again) = (tetrahedra(ball_surface(2), mesher, cell_size=2.0) for _ in range(2))
    assert np.array_equal(first, second) and np.array_equal(cells, again)


def test_tetgen_keeps_the_boundary_and_makes_slivers_as_published():
    surface = ball_surface(4)
    mesh, _ = generate(surface, mesher="tetgen", cell_size=1.0)
    assert len(boundary_faces(mesh)) == len(surface.faces)
    assert quality(mesh.points, mesh.cells).max() > 0.85


def test_the_surface_is_turned_outward_and_merged():
    ball = ball_surface(1)
    soup = TriSurface(ball.points[ball.faces].reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3)[:, ::-1])
    points, faces = prepared(soup)
    assert len(points) == len(ball.points)
    assert enclosed_volume(points, faces) == pytest.approx(enclosed_volume(ball.points, ball.faces))


def test_whatever_ends_a_mesher_is_an_error_that_says_so(monkeypatch, tmp_path):
    ball = ball_surface(1)
    crossing = TriSurface(np.vstack([ball.points, ball.points + 3]), np.vstack([ball.faces, ball.faces + 42]))
    with pytest.raises(StageError, match="tetgen (failed|crashed)"):
        tetrahedra(crossing, "tetgen", cell_size=1.0)
    with pytest.raises(StageError, match="0.001 minutes"):
        tetrahedra(ball, "tetgen", cell_size=1.0, time_limit=0.001)
    (tmp_path / "tetgen.py").write_text("import a_module_that_is_not_there")
    with monkeypatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        with pytest.raises(StageError, match="ModuleNotFoundError"):
            tetrahedra(ball, "tetgen", cell_size=1.0)
    crash = tmp_path / "python"
    crash.write_text("#!/bin/sh\nkill -SEGV $$\n")
    crash.chmod(0o755)
    monkeypatch.setattr(baselines.sys, "executable", str(crash))
    with pytest.raises(StageError, match="SIGSEGV"):
        tetrahedra(ball, "tetgen", cell_size=1.0)


def test_a_mesh_that_overlaps_itself_is_refused(monkeypatch):
    """As Netgen's on coarse surfaces: turned to positive volumes, two tetrahedra lie on one side of their face."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.3, 0.5]], float)
    cells = np.array([[0, 1, 2, 3], [0, 1, 2, 4]], np.int32)
    monkeypatch.setattr(baselines, "tetrahedra", lambda *_, **__: (points, cells))
    with pytest.raises(StageError, match="netgen.* overlap.* 1 face has"):
        generate(ball_surface(1), mesher="netgen", cell_size=1.0)
