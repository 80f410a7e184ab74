"""Coordinates that are not mm: taken to mm where a unit is named."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_surface

from cortet.config import load
from cortet.formats.placement import placed
from cortet.meshes import CoordinateFrame, TriSurface
from cortet.pipeline import run


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000.0), ("um", 0.001)])
def test_units(unit, factor):
    ball, frame = ball_surface(), CoordinateFrame("NIFTI_XFORM_TALAIRACH")
    surface = TriSurface(ball.points / factor, ball.faces, frame=frame)
    made = placed(surface, load({"gate": {"unit": unit}}).placement())
    assert made.points == pytest.approx(ball.points) and np.array_equal(made.faces, surface.faces)
    assert made.frame == CoordinateFrame()
    assert load({}).placement() is None and placed(surface, None) is surface


def test_the_line_places_what_it_reads_and_records_how():
    surface = ball_surface(3, 20.0)
    config = load({"gate": {"unit": "m"}, "generate": {"cell_size": 4.0}})
    steps = {}
    for step in run(TriSurface(surface.points / 1000, surface.faces), config):
        steps[step.stage] = step
        if step.stage == "gate":
            break
    assert steps["gate"].result.points == pytest.approx(surface.points, abs=1e-4)
    assert steps["gate"].parameters["to_mm"] == 1000
    assert "to_mm" not in next(run(surface, load({}))).parameters
