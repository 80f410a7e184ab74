"""Only certified meshes are exported, and only files that keep their solver's conventions get a name."""

from __future__ import annotations

from pathlib import Path

import pytest
from shapes import ball_mesh

from cortet.errors import StageError
from cortet.export import export
from cortet.formats import FORMATS
from cortet.stages.solver_ready import solver_ready
from cortet.verify import SOLVERS, verify

CERTIFIED = {"certified": True, "reasons": []}
REFUSED = {"certified": False, "reasons": ["worst q 0.8 must be below 0.6"]}


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_certified_mesh_is_written_as_its_solver_wants_it(tmp_path: Path, solver: str) -> None:
    path = tmp_path / f"ball{FORMATS[solver].suffix}"
    export(solver_ready(ball_mesh())[0], path, solver=solver, certificate=CERTIFIED)
    assert verify(path, solver) == []


def test_an_uncertified_mesh_is_written_only_on_demand(tmp_path: Path) -> None:
    mesh, _ = solver_ready(ball_mesh())
    with pytest.raises(StageError, match="worst q 0.8 must be below 0.6"):
        export(mesh, tmp_path / "ball.mesh", solver="braingrowth", certificate=REFUSED)
    assert not list(tmp_path.iterdir())
    export(mesh, tmp_path / "ball.mesh", solver="braingrowth", certificate=REFUSED, uncertified=True)
    assert (tmp_path / "ball.mesh").exists()


def test_a_file_that_breaks_a_convention_gets_no_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cortet.export.verify", lambda *_: ["4 triangles face inward"])
    with pytest.raises(StageError, match="4 triangles face inward"):
        export(solver_ready(ball_mesh())[0], tmp_path / "ball.mesh", solver="braingrowth", certificate=CERTIFIED)
    assert not list(tmp_path.iterdir())
