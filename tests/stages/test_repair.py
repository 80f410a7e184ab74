"""Repair: what is put right, how far from the good surface, what is refused and in which words."""

from __future__ import annotations

from dataclasses import replace

import breakages
import numpy as np
import pytest
import trimesh
from shapes import ball_surface, can, one_sided, torus

from cortet.config.stages import Repair
from cortet.errors import InputError
from cortet.geometry import mending
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import joined
from cortet.geometry.topology import edges, enclosed_volume, surface_topology
from cortet.measure.lost import distances_to
from cortet.meshes import FILLED, TriSurface, single_precision
from cortet.phantoms import phantom
from cortet.stages.gate import gate
from cortet.stages.repair import RepairReport, repair


def ball() -> TriSurface:
    """A ball of 20 mm, its edges some 1.5 mm, as exact as a file."""
    return single_precision(ball_surface(4, 20.0))


def crossed(count: int = 30) -> TriSurface:
    """The ball with some vertices pulled over an edge of their fans."""
    surface = ball()
    points, pairs = surface.points.copy(), edges(surface.faces)
    for start, end in pairs[:: len(pairs) // count].tolist():
        points[start] += 1.3 * (points[end] - points[start])
    return single_precision(replace(surface, points=points))


TORUS = torus(20.0, 6.0, major_sections=60, minor_sections=24)


def repaired(surface: TriSurface, **limits: float) -> tuple[TriSurface, RepairReport]:
    """Repair that must end in something the gate lets in as it is."""
    made, report = repair(surface, Repair(**limits), source="a.surf.gii")
    passed, gated = gate(made, source="a.surf.gii")
    assert np.array_equal(passed.points, made.points)
    assert gated.crossing_faces_repaired == gated.faces_reoriented == 0
    assert not len(self_intersections(made))
    return made, report


@pytest.mark.parametrize("surface", [ball(), phantom(34.0, subdivisions=5)])
def test_a_good_surface_passes_with_the_very_same_arrays(surface):
    made, report = repair(surface, source="a.surf.gii")
    assert made is surface
    assert not report.repaired
    assert report.steps == ()
    assert report.relative_volume_change == report.surface_to_file_mm.max == 0
    assert report.volume_ml == pytest.approx(enclosed_volume(surface.points, surface.faces) / 1000)


def test_the_tip_of_a_cone_and_the_hub_of_a_fan_are_no_spikes():
    angle = 2 * np.pi * np.arange(200) / 200
    rim = np.column_stack([25 * np.cos(angle), 25 * np.sin(angle), 0 * angle])
    a, b = np.arange(200), np.roll(np.arange(200), -1)
    sides, floor = (np.column_stack([*pair, np.full(200, tip)]) for pair, tip in (((a, b), 200), ((b, a), 201)))
    cone = TriSurface(np.concatenate([rim, [[0, 0, 60.0], [0, 0, 0]]]), np.concatenate([sides, floor]))
    for sharp in (cone, can(200, rings=30, hub=24.9)):  # its hub is that of a flat fan
        assert repair(sharp, source="a.stl")[0] is sharp


#: breakage -> beginning of the step that mends it, and farthest that the repaired surface is from the good one, mm
MENDED = {
    "hole of 5 mm": ("hole filled", 0.2),
    "hole of 30 mm": ("hole filled", 2.5),
    "narrow handle": ("handle cut", 0.2),
    "wide handle": ("handle cut", 0.6),
    "doubled faces": ("doubled", 0.0),
    "both sides": ("doubled", 0.0),
    "isolated component": ("small separate piece", 0.0),
    "flipped patch": ("triangles turned", 0.0),
    "duplicated vertices": ("coinciding vertices", 0.0),
    "spike of 8 mm": ("spike", 0.1),
    "NaN vertex": ("vertex without finite", 0.1),
}


@pytest.mark.parametrize("breakage", MENDED)
def test_a_broken_ball_is_a_ball_again(breakage):
    good = ball()
    made, report = repaired(breakages.BREAKAGES[breakage](good), max_volume_change=0.03)
    done, distance = MENDED[breakage]
    assert report.repaired
    assert [step.done for step in report.steps if step.done.startswith(done)]
    assert all(np.linalg.norm(step.places_mm, axis=1).max() < 45 for step in report.steps)
    assert distances_to(made, good).max() <= distance + 1e-6
    assert distances_to(good, made).max() <= distance + 1e-6
    assert abs(report.relative_volume_change) < 0.03


def test_a_triangle_that_rounding_mends_leaves_no_empty_message(caplog):
    ball = ball_surface(4, 12.0)
    points = ball.points.copy()
    first, between, last = ball.faces[100]
    points[between] = (points[first] + points[last]) / 2
    _, report = repair(TriSurface(points, ball.faces), source="ball.surf.gii")
    assert report.repaired and not report.steps
    assert "ball.surf.gii: repaired: coordinates rounded to float32" in caplog.text


def test_many_crossing_triangles_are_pulled_apart():
    broken = crossed()
    crossing = len(self_intersections(broken))
    assert crossing > 100
    with pytest.raises(InputError, match="intersect"):
        gate(broken, source="x")
    made, report = repaired(broken)
    assert (report.steps[0].count, report.steps[0].of) == (crossing, "faces")
    assert distances_to(ball(), made).max() < 0.5
    assert 0 < report.displacement_max_mm < 1
    places = np.array(report.steps[0].places_mm)
    assert len(places) == 10
    assert np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(10, 1)].min() > 5


@pytest.mark.parametrize(("below", "common"), [(1, 1), (-1, 2)], ids=["in a corner", "along an edge"])
def test_bodies_that_touch_are_parted(below, common):
    """A small box on a large one, with common vertices where they touch."""
    box, small = trimesh.creation.box((20, 20, 20)), trimesh.creation.box((1.25, 1.25, 1.25))
    for _ in range(4):
        box = box.subdivide()
    large = TriSurface(box.vertices, box.faces)
    both = joined([large, TriSurface(small.vertices + 10 + 0.625 * np.array([1, 1, below]), small.faces)])
    merged, _ = mending.collapsed(mending.triangles(both.points, both.faces), 0.0)
    assert len(merged.faces) == len(both.faces)
    points, place = np.unique(both.points.round(6), axis=0, return_inverse=True)
    assert len(points) == len(both.points) - common
    touching = TriSurface(points, place[both.faces])
    assert not surface_topology(touching.faces).is_closed_manifold
    made, report = repaired(touching)
    assert report.repaired
    assert distances_to(large, made).max() < 2.5


def test_fields_follow_and_caps_are_labelled():
    good = ball()
    height, parcel = good.points[:, 2].copy(), (good.points[:, 0] > 0).astype(np.int32)
    gone = good.points[:, 2] > 17
    kept = ~gone[good.faces].any(axis=1)
    used = mending.compacted(mending.chosen_faces(mending.triangles(good.points, good.faces), kept))
    fields = {"height": height[used.origin], "parcel": parcel[used.origin]}
    made, _ = repaired(TriSurface(used.points, used.faces, fields))
    cap = made.point_data[FILLED] == 1
    assert made.point_data[FILLED].dtype == np.int32
    assert cap.sum() > 20
    assert (made.points[cap, 2] > 16.5).all()
    assert (made.points[~cap, 2] <= 17).all()
    assert np.array_equal(made.point_data["height"][~cap], made.points[~cap, 2])
    assert made.point_data["height"][cap] == pytest.approx(17, abs=1.5)  # of the nearest point of the rim
    assert set(made.point_data["parcel"]) == {0, 1}
    made, report = repaired(breakages.unknown(ball()))
    assert FILLED not in made.point_data and report.filled_area_mm2 == 0, "a cut that the repair made itself"


def shells() -> TriSurface:
    """A ball with two walls inside."""
    walls = [TriSurface(ball().points / 4 + np.array([x, 0, 0]), ball().faces[:, ::-1]) for x in (8, -8)]
    return joined([ball(), *walls])


def dumbbell() -> TriSurface:
    """Two balls that a neck without any width joins."""
    surface = ball()
    points = surface.points.copy()
    neck = np.abs(points[:, 2]) < 2
    points[neck, :2] = 0
    points[neck, 2] *= 0.5
    return TriSurface(points, surface.faces)


def scattered() -> TriSurface:
    """Random triangles: every piece is small, and a cap on the largest was meshed."""
    random = np.random.default_rng(0)
    centres = random.uniform(0, 60, (900, 1, 3))
    return TriSurface((centres + random.normal(0, 0.3, (900, 3, 3))).reshape(-1, 3), np.arange(2700).reshape(-1, 3))


@pytest.mark.parametrize(
    ("surface", "limits", "words"),
    [
        (joined([ball(), TriSurface(ball().points + np.array([60, 0, 0]), ball().faces)]), {}, "2 separate pieces"),
        (scattered(), {}, "pieces, of which the largest has .* of the area"),
        (one_sided(), {}, "no inside"),
        (breakages.hole(ball(), 30.0), {"max_hole": 50.0}, "88.4 mm"),
        (breakages.hole(ball(), 30.0), {"max_hole": 88.3}, "88.4 mm"),
        (shells(), {}, "2 of 3 pieces"),
        (dumbbell(), {}, "flat triangle"),
        (TORUS, {}, "repair.max_loop"),
        (breakages.handle(ball(), 3), {"max_volume_change": 0.001}, "volume"),
        (crossed(), {"max_displacement": 0.001}, "0.001 mm"),
        (TriSurface(np.full((3, 3), np.nan), [[0, 1, 2]]), {}, "every triangle"),
        (TriSurface(np.eye(3), [[0, 1, 2]]), {}, "a.gii: "),
    ],
)
def test_what_has_no_single_right_answer_is_refused(surface, limits, words):
    with pytest.raises(InputError, match=words) as error:
        repair(surface, Repair(**limits), source="a.gii")
    assert str(error.value).startswith("a.gii: ")
    assert error.value.remedy


def test_a_tunnel_is_closed_within_the_limit_and_kept_where_it_is_allowed():
    made, report = repaired(TORUS, max_loop=45.0, max_volume_change=0.5)
    assert surface_topology(made.faces).genus == 0
    assert "handle cut" in report.steps[0].done
    kept, report = repair(TORUS, source="x", allow_genus=1)
    assert not report.repaired
    assert surface_topology(kept.faces).genus == 1


def test_a_cap_has_the_same_bits_whatever_memory_holds():
    """A symmetric surface has many caps that are equally good: addresses in memory must not choose among them."""
    shape, held = torus(8.0, 3.0), []
    first, _ = repair(shape, Repair(max_loop=200.0, max_volume_change=0.9), source="x")
    for count in (50, 1050, 2050):
        held.append([bytearray(100 + count) for _ in range(count)])
        again, _ = repair(shape, Repair(max_loop=200.0, max_volume_change=0.9), source="x")
        assert np.array_equal(again.points, first.points) and np.array_equal(again.faces, first.faces)
