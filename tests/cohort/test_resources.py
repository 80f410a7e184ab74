"""What jobs ask for follows from what was measured."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from shapes import ball_surface

from cortet.cohort.resources import (
    COSTS,
    cost,
    expected_tets,
    memory_to_ask_mb,
    minutes_to_ask,
)
from cortet.config.stages import Generate
from cortet.geometry.topology import enclosed_volume
from cortet.stages.generate import generate

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("mesher", ["cgal", "lattice"])
def test_a_ball_has_about_as_many_tetrahedra_as_expected(mesher):
    ball = ball_surface(3, radius=10.0)
    volume_ml = enclosed_volume(ball.points, ball.faces) / 1000
    mesh, _ = generate(
        ball, Generate(odt=False, lloyd=False, perturb=False, exude=False), cell_size=1.25, mesher=mesher
    )
    assert len(mesh.cells) == pytest.approx(expected_tets(volume_ml, 1.25, mesher), rel=0.25)


def test_a_mesh_that_was_measured_fits_into_what_is_asked_for():
    """MB and CPU seconds of jobs: 34 weeks at 0.6 mm by CGAL, and an adult's white surface by the lattice."""
    measured = {
        ("generate", "cgal"): (1_527_842, 959, 553),
        ("relocate", "cgal"): (1_527_842, 478, 113),
        ("generate", "lattice"): (5_378_494, 1679, 61),
        ("reconnect", "lattice"): (5_378_494, 1248, 37),
    }
    for (rule, mesher), (tets, megabytes, seconds) in measured.items():
        assert megabytes < memory_to_ask_mb(cost(rule, mesher).memory_mb(tets)) < 3 * megabytes + 1000
        assert seconds / 60 < minutes_to_ask(cost(rule, mesher).cpu_seconds(tets))


def test_the_profile_groups_every_rule_on_a_case_but_the_long_ones():
    profile = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text())
    grouped = {line.partition("=")[0] for line in profile["groups"]}
    rules = {rule.partition(":")[0] for rule in COSTS}
    long = {"generate", "fold", "fold_figures", "folded_surface"}
    assert rules - grouped == long and grouped <= rules
    assert profile["retries"] > 0
