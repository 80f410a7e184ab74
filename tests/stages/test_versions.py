"""A stage whose result changes must raise its VERSION: by it Snakemake sees that the package was edited.

`golden.json` holds, for the present VERSION of each stage, a fingerprint of its result on a small fixed input. After a
change that is meant: raise VERSION in the stage's module, then `python tests/stages/test_versions.py` records it again.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config import SETTINGS
from cortet.config.fold import Settings
from cortet.config.stages import Generate, Reconnect, Resample, SmoothSurface
from cortet.folding.fold import fold
from cortet.formats import vtu
from cortet.measure.quality import quality
from cortet.meshes import TetMesh, TriSurface
from cortet.phantoms import phantom, phantom_with_sphere
from cortet.stages.clean import clean
from cortet.stages.gate import gate
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect
from cortet.stages.relocate import relocate
from cortet.stages.repair import repair
from cortet.stages.resample import resample
from cortet.stages.smooth_boundary import smooth_boundary
from cortet.stages.smooth_surface import smooth_surface
from cortet.stages.snap import snap
from cortet.stages.solver_ready import surface_nodes_first
from cortet.stages.transfer import transfer
from cortet.version import version_of

GOLDEN = Path(__file__).with_name("golden.json")
#: relative; rounding that differs between processors stays below, a change of method does not
TOLERANCE = 1e-5
#: of a body that buckles, which amplifies rounding: with the BLAS kernels of four processors up to 4e-4
TOLERANCE_OF = {"fold": 2e-3}


def rough_ball() -> TriSurface:
    """A ball of 20 mm with a field and 0.2 % of noise on its radius."""
    ball = ball_surface(4, radius=20.0)
    noise = np.random.default_rng(0).normal(1, 0.002, (len(ball.points), 1))
    return TriSurface(ball.points * noise, ball.faces, {"thickness": ball.points[:, 0]})


def jagged_ball() -> TriSurface:
    """A ball of 20 mm, its radius rounded to steps of 0.1 mm: rough enough to be smoothed."""
    ball = ball_surface(5, radius=20.0)
    steps = 0.1 * np.round(np.random.default_rng(0).normal(0, 1, (len(ball.points), 1)))
    return TriSurface(ball.points * (1 + steps / 20), ball.faces)


def broken_ball() -> TriSurface:
    """The same with a hole, a spike and crossing triangles."""
    ball = rough_ball()
    points = ball.points.copy()
    points[0] *= 1.3
    points[500] += 1.3 * (points[ball.faces[(ball.faces == 500).any(axis=1)][0]].sum(axis=0) - 3 * points[500])
    return TriSurface(points, ball.faces[ball.points[ball.faces, 2].max(axis=1) < 18], ball.point_data)


def with_labels(surface: TriSurface, sphere: TriSurface) -> tuple[TriSurface, TriSurface]:
    """The surface with labels and a field."""
    height = surface.points[:, 2]
    fields = {"label": (height > 0).astype(np.int32), "height": height}
    return replace(surface, point_data=fields), sphere


def good_ball() -> TetMesh:
    """A mesh of good tetrahedra, its boundary nodes on the sphere of 5 mm."""
    return reconnect(ball_mesh(2, radius=5.0), ball_surface(4), Reconnect(insert=False))[0]


def floating_ball() -> TetMesh:
    """The same with boundary nodes up to 0.05 mm off the sphere."""
    mesh = good_ball()
    return TetMesh(mesh.points * (1 + 0.01 * np.sin(3 * mesh.points[:, :1])), mesh.cells)


def folded_ball() -> TetMesh:
    """A ball whose skin has grown for a week."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(gestational_age=22.0, force=True, end=23.0, thickness=3.0)
        fold(ball_mesh(2, radius=10.0), Path(folder), settings)
        return vtu.read(sorted(Path(folder).glob("frames/*.vtu"))[-1])


@dataclass(frozen=True)
class Example:
    """A small input of a stage, and how the stage is called with it."""

    given: Callable[[], tuple[TriSurface | TetMesh, ...]]
    run: Callable[..., tuple[Any, Any]]

    def result(self) -> TriSurface | TetMesh:
        """What the stage makes of the input."""
        made: TriSurface | TetMesh = self.run(*self.given())[0]
        return made


def bad_ball() -> TetMesh:
    return ball_mesh(2, radius=5.0)


RESULTS: dict[str, Example] = {
    "phantom": Example(tuple, lambda: (phantom(28.0, subdivisions=3), None)),
    "resample": Example(
        lambda: with_labels(*phantom_with_sphere(28.0, subdivisions=3)),
        lambda surface, sphere: resample(surface, sphere, Resample(subdivisions=3)),
    ),
    "repair": Example(lambda: (broken_ball(),), lambda surface: repair(surface, source="broken ball")),
    "gate": Example(lambda: (rough_ball(),), lambda surface: gate(surface, source="rough ball")),
    "smooth_surface": Example(lambda: (jagged_ball(),), smooth_surface),
    "smooth_surface (published)": Example(
        lambda: (rough_ball(),),
        lambda surface: smooth_surface(
            surface, SmoothSurface(**SETTINGS["published"]["smooth_surface"]), gestational_age=28.0
        ),
    ),
    "generate": Example(
        lambda: (ball_surface(3),),
        lambda surface: generate(surface, Generate(backend="cgal"), cell_size=1.5, mesher="cgal"),
    ),
    "generate (lattice)": Example(
        lambda: (ball_surface(3),), lambda surface: generate(surface, cell_size=1.5, mesher="lattice")
    ),
    "transfer": Example(lambda: (ball_mesh(3, radius=20.0), rough_ball()), transfer),
    "relocate": Example(lambda: (bad_ball(),), relocate),
    "clean": Example(lambda: (bad_ball(), ball_surface(4)), clean),
    "reconnect": Example(lambda: (bad_ball(), ball_surface(4)), reconnect),
    "smooth_boundary": Example(lambda: (good_ball(), ball_surface(4)), smooth_boundary),
    "snap": Example(lambda: (floating_ball(), ball_surface(4)), snap),
    "fold": Example(tuple, lambda: (folded_ball(), None)),
    "solver_ready": Example(lambda: (bad_ball(),), surface_nodes_first),
}


def version(result: str) -> int:
    """VERSION of the module that makes one of the results."""
    step = result.split(maxsplit=1)[0]
    return version_of({"phantom": "phantoms", "fold": "folding.fold"}.get(step, f"stages.{step}"))


def fingerprint(result: TriSurface | TetMesh) -> dict[str, float]:
    """Numbers that change when a vertex moves, an element changes, the numbering changes or a field changes."""
    cells = result.cells if isinstance(result, TetMesh) else result.faces
    corners = result.points[cells]
    numbers = {
        "points": float(len(result.points)),
        "cells": float(len(cells)),
        "distance_mm": float(np.linalg.norm(result.points, axis=1).mean()),
        "edge_mm": float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()),
        "order": float(np.linalg.norm(result.points, axis=1) @ np.linspace(0, 1, len(result.points))),
    }
    if isinstance(result, TetMesh):
        numbers["mean_q"] = float(quality(result.points, cells).mean())
    return numbers | {name: float(np.abs(values).sum()) for name, values in result.point_data.items()}


@pytest.mark.parametrize("stage", RESULTS)
def test_a_stage_gives_what_its_version_gave(stage):
    golden = json.loads(GOLDEN.read_text())[stage]
    tolerance = TOLERANCE_OF.get(stage, TOLERANCE)
    same = fingerprint(RESULTS[stage].result()) == pytest.approx(golden["fingerprint"], rel=tolerance)
    raised = version(stage) != golden["version"]
    assert same or raised, f"{stage} gives another result: raise its VERSION, then run python {Path(__file__).name}"
    assert not raised, f"{stage} has a new VERSION: record its result with python {Path(__file__).name}"


if __name__ == "__main__":
    record = {
        stage: {"version": version(stage), "fingerprint": fingerprint(example.result())}
        for stage, example in RESULTS.items()
    }
    GOLDEN.write_text(json.dumps(record, indent=2) + "\n")
