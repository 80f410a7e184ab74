"""The input gate: what passes, what is mended, what is refused and in which words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from shapes import ball_surface, one_sided, torus

from cortet.config import load
from cortet.config.stages import Gate
from cortet.errors import InputError
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import joined
from cortet.geometry.topology import enclosed_volume, surface_topology, vertex_normals
from cortet.meshes import TriSurface, single_precision
from cortet.stages.gate import gate

#: mm per unit -> name of the unit
UNITS = {1e-3: "m", 1e3: "um", 0.1: "cm"}


def hemisphere() -> TriSurface:
    """A ball of 20 mm radius, off the origin, as exact as a file: stands for a hemisphere."""
    ball = ball_surface(4, 20.0)
    return single_precision(replace(ball, points=ball.points + np.array([30, -20, 10])))


def dented(depth: float) -> TriSurface:
    """The hemisphere with one vertex pushed inward by `depth` mm, through the other side from 40 mm on."""
    surface = hemisphere()
    points = surface.points.copy()
    points[0] -= depth * vertex_normals(points, surface.faces)[0]
    return replace(surface, points=points)


def test_a_good_surface_passes_untouched():
    surface = hemisphere()
    passed, report = gate(surface, source="a.surf.gii")
    assert np.array_equal(passed.points, surface.points)
    assert np.array_equal(passed.faces, surface.faces)
    assert (report.source, report.genus, report.vertices, report.faces) == ("a.surf.gii", 0, 2562, 5120)
    assert report.volume_ml == pytest.approx(4 / 3 * np.pi * 8, rel=0.01)
    assert report.area_mm2 == pytest.approx(4 * np.pi * 400, rel=0.01)
    assert report.faces_reoriented == report.unused_vertices_dropped == report.crossing_faces_repaired == 0


def test_triangles_are_turned_outward_and_unused_vertices_dropped_with_their_values():
    surface = hemisphere()
    inward = np.random.default_rng(1).random(len(surface.faces)) < 0.3
    faces = np.where(inward[:, None], surface.faces[:, ::-1], surface.faces) + 1
    values = np.arange(len(surface.points) + 2.0)
    passed, report = gate(
        TriSurface(np.vstack([[np.zeros(3)], surface.points, [np.ones(3)]]), faces, {"v": values}), source="x"
    )
    assert surface_topology(passed.faces).is_closed_manifold and enclosed_volume(passed.points, passed.faces) > 0
    assert report.faces_reoriented == inward.sum() and report.unused_vertices_dropped == 2
    assert np.array_equal(passed.points, surface.points)
    assert np.array_equal(passed.point_data["v"], values[1:-1])
    all_inward = replace(surface, faces=surface.faces[:, ::-1])
    assert gate(all_inward, source="x")[1].faces_reoriented == len(surface.faces)


def test_a_few_crossing_triangles_are_pulled_apart_locally():
    surface = trimesh.creation.icosphere(subdivisions=5, radius=20.0)
    points = surface.vertices.copy()
    vertex, neighbour = surface.edges[1000]
    points[vertex] += 1.3 * (points[neighbour] - points[vertex])  # over the edge of its fan
    crossed = single_precision(TriSurface(points, surface.faces, {"v": np.arange(len(points))}))
    crossing = self_intersections(crossed)
    assert 0 < len(crossing) <= 20

    passed, report = gate(crossed, source="x")
    assert not len(self_intersections(passed))
    assert report.crossing_faces_repaired == len(crossing)
    assert np.array_equal(passed.faces, crossed.faces)
    assert np.array_equal(passed.point_data["v"], crossed.point_data["v"])
    moved = np.linalg.norm(passed.points - crossed.points, axis=1)
    assert report.repair_moved_vertices == (moved > 0).sum() < 60
    assert report.repair_max_displacement_mm == moved.max() < 1


TORUS = torus(20.0, 6.0)


def pinched() -> TriSurface:
    """Two balls that share one vertex."""
    ball = hemisphere()
    left, right = ball.points[:, 0].argmin(), ball.points[:, 0].argmax()
    other = replace(ball, points=ball.points + ball.points[right] - ball.points[left])
    both = joined([ball, other])
    return replace(both, faces=np.where(both.faces == len(ball.points) + left, right, both.faces))


def flat_triangle() -> TriSurface:
    surface = hemisphere()
    points = surface.points.copy()
    a, b, c = surface.faces[7]
    points[a] = (points[b] + points[c]) / 2
    return replace(surface, points=points)


def with_coordinate(value: float) -> TriSurface:
    surface = hemisphere()
    points = surface.points.copy()
    points[7, 1] = value
    return replace(surface, points=points)


BALL = hemisphere()
ASIDE = replace(BALL, points=BALL.points + np.array([60, 0, 0]))


@pytest.mark.parametrize(
    ("surface", "word"),
    [
        (replace(BALL, faces=BALL.faces[1:]), "3 open edges"),
        (joined([BALL, ASIDE]), "2 components"),
        (joined([BALL, replace(BALL, faces=BALL.faces[:1])]), "coincide"),
        (replace(BALL, faces=np.vstack([BALL.faces, BALL.faces[:1]])), "3 edges"),
        (pinched(), "1 pinched"),
        (one_sided(), "no inside"),
        (TORUS, "genus 1"),
        (flat_triangle(), "triangle 7 "),
        (replace(BALL, faces=np.vstack([BALL.faces, [5, 5, 9]])), "5120"),
        *((replace(BALL, points=BALL.points * scale), f" in {unit}, ") for scale, unit in UNITS.items()),
        (replace(BALL, points=BALL.points * 6), "240 mm.*voxel"),
        (dented(60), "triangles intersect"),
        *((with_coordinate(value), "damaged") for value in (1e308, 1e12, np.nan, np.inf)),
    ],
)
def test_anything_else_is_refused_with_the_file_and_a_remedy(surface, word):
    with pytest.raises(InputError, match=word) as caught:
        gate(surface, source="bad.surf.gii")
    assert "bad.surf.gii: " in str(caught.value) and caught.value.remedy


def test_handles_pass_for_those_who_know():
    assert gate(TORUS, Gate(allow_genus=1), source="x")[1].genus == 1


def test_a_brain_of_10_mm_is_accepted_if_its_unit_is_stated():
    """A mouse: the refusal names centimetres, and how a brain that really is so small is accepted."""
    mouse = ball_surface(3, 5.0)
    with pytest.raises(InputError) as caught:
        gate(mouse, source="mouse.surf.gii")
    assert "gate.unit: cm" in caught.value.remedy and "gate.unit: mm" in caught.value.remedy
    assert gate(mouse, source="mouse.surf.gii", to_mm=load({"gate": {"unit": "mm"}}).placement())[1].vertices == 642


def test_a_stated_unit_that_gives_a_brain_of_40_m_is_refused_and_the_right_one_named():
    wrong = replace(BALL, points=BALL.points * 1000)
    with pytest.raises(InputError, match="4e.04 mm long") as caught:
        gate(wrong, source="x.surf.gii", to_mm=1000.0)
    assert "in mm, set gate.unit: mm" in caught.value.remedy
