"""A surface made again on a grid: always a sphere, near what was given, whatever was wrong with that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_surface, torus

from cortet.config.stages import Repair
from cortet.errors import InputError
from cortet.geometry import rebuilding
from cortet.geometry.grid_topology import skin
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import joined
from cortet.geometry.rebuilding import rebuilt
from cortet.geometry.topology import enclosed_volume, surface_topology
from cortet.geometry.winding import winding_numbers
from cortet.measure.lost import distances_to
from cortet.meshes import FILLED, TriSurface
from cortet.stages.repair import repair

BALL = ball_surface(3, radius=10.0)
#: mm
SPACING = 0.8
ASIDE = replace(BALL, points=BALL.points + np.array([3.0, 0, 0]))
CAVITY = TriSurface(BALL.points * 0.3, BALL.faces[:, ::-1])


def test_a_closed_surface_winds_once_around_what_is_inside():
    places = np.array([[0, 0, 0], [9, 0, 0], [0, 11, 0], [0, 0, 100.0]])
    assert winding_numbers(BALL, places) == pytest.approx([1, 1, 0, 0], abs=0.05)
    twice = joined([BALL, BALL])
    assert winding_numbers(twice, places[:1]) == pytest.approx([2], abs=0.05)


@pytest.mark.parametrize(
    "broken",
    [
        pytest.param(BALL, id="good"),
        pytest.param(replace(BALL, faces=BALL.faces[40:]), id="a hole"),
        pytest.param(joined([BALL, ASIDE]), id="crosses another"),
        pytest.param(joined([BALL, CAVITY]), id="a cavity"),
        pytest.param(torus(8.0, 3.0), id="a handle"),
        pytest.param(torus(6.0, 5.5), id="a tunnel"),
    ],
)
def test_a_sphere_near_the_given_triangles_comes_out(broken):
    made, volume = rebuilt(broken, SPACING)
    assert surface_topology(made.faces).problems(genus=0) == []
    assert len(self_intersections(made)) == 0
    assert enclosed_volume(made.points, made.faces) == pytest.approx(volume, rel=0.03)
    assert distances_to(broken, made)[: len(made.points)].mean() < 0.1 * SPACING


def test_a_plane_comes_out_as_it_is():
    """Linear depths are found where they are, to rounding; the skin is outward."""
    x = np.arange(6.0)
    depth = 2.35 - np.broadcast_to(x[:, None, None], (6, 6, 6))
    points, faces = skin(depth)
    assert points[:, 0] == pytest.approx(2.35)
    normals = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    assert (normals[:, 0] > 0).all()


def test_repair_makes_a_broken_surface_anew_where_it_is_asked_to():
    crossing = joined([replace(BALL, faces=BALL.faces[20:]), ASIDE])
    given = replace(crossing, point_data={"depth": crossing.points[:, 2].copy()})
    made, report = repair(given, Repair(method="voxel", spacing=SPACING), source="x")
    assert report.repaired and "0.8 mm" in report.steps[-1].done
    assert abs(report.relative_volume_change) < 0.02
    assert made.point_data["depth"] == pytest.approx(made.points[:, 2], abs=2 * SPACING)
    assert FILLED not in made.point_data
    assert repair(BALL, Repair(method="voxel"), source="x")[0] is BALL  # nothing is wrong with it
    apart = joined([BALL, replace(BALL, points=BALL.points + 40)])
    with pytest.raises(InputError, match="volume"):  # no sphere has it
        repair(replace(apart, faces=apart.faces[3:]), Repair(method="voxel", spacing=SPACING), source="x")


def test_a_grid_that_is_too_fine_or_empty_is_refused(monkeypatch):
    flat = TriSurface(np.eye(3), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(InputError, match="nothing"):
        rebuilt(flat, 0.2)
    monkeypatch.setattr(rebuilding, "MOST_POINTS", 1000)
    with pytest.raises(InputError, match="1,000"):
        rebuilt(BALL, SPACING)
