"""The input gate: what passes, what is mended, what is refused and in which words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapes import ball_surface

from cortet.config.stages import Gate
from cortet.errors import InputError
from cortet.formats.gifti import read_surface
from cortet.geometry import topology
from cortet.geometry.intersection import self_intersections
from cortet.meshes import TriSurface, single_precision
from cortet.stages.gate import gate

DATA = Path(__file__).parents[2] / "../shared/data"


def hemisphere() -> TriSurface:
    """A ball of 20 mm radius, off the origin, as exact as a file: stands for a hemisphere."""
    ball = ball_surface(4, 20.0)
    return single_precision(replace(ball, points=ball.points + np.array([30, -20, 10])))


def joined(*surfaces: TriSurface) -> TriSurface:
    shifts = np.cumsum([0, *(len(s.points) for s in surfaces[:-1])])
    faces = np.concatenate([s.faces + shift for s, shift in zip(surfaces, shifts, strict=True)])
    return TriSurface(np.concatenate([s.points for s in surfaces]), faces)


def dented(depth: float) -> TriSurface:
    """The hemisphere with one vertex pushed inward by `depth` mm, through the other side from 40 mm on."""
    surface = hemisphere()
    points = surface.points.copy()
    points[0] -= depth * topology.vertex_normals(points, surface.faces)[0]
    return replace(surface, points=points)


def test_a_good_surface_passes_untouched() -> None:
    surface = hemisphere()
    passed, report = gate(surface, source="a.surf.gii")
    assert np.array_equal(passed.points, surface.points)
    assert np.array_equal(passed.faces, surface.faces)
    assert (report.source, report.genus, report.vertices, report.faces) == ("a.surf.gii", 0, 2562, 5120)
    assert report.volume_ml == pytest.approx(4 / 3 * np.pi * 8, rel=0.01)
    assert report.area_mm2 == pytest.approx(4 * np.pi * 400, rel=0.01)
    assert report.extent_mm == pytest.approx((40, 40, 40), rel=0.01)
    assert report.faces_reoriented == report.unused_vertices_dropped == report.crossing_faces_repaired == 0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_triangles_are_turned_outward(share: float) -> None:
    surface = hemisphere()
    inward = np.random.default_rng(1).random(len(surface.faces)) < share
    passed, report = gate(
        replace(surface, faces=np.where(inward[:, None], surface.faces[:, ::-1], surface.faces)), source="x"
    )
    assert topology.surface_topology(passed.faces).is_closed_manifold
    assert topology.enclosed_volume(passed.points, passed.faces) > 0
    assert report.faces_reoriented == inward.sum()


def test_unused_vertices_are_dropped_with_their_values() -> None:
    surface = hemisphere()
    values = np.arange(len(surface.points) + 2.0)
    padded = TriSurface(np.vstack([[np.zeros(3)], surface.points, [np.ones(3)]]), surface.faces + 1, {"v": values})
    passed, report = gate(padded, source="x")
    assert report.unused_vertices_dropped == 2
    assert np.array_equal(passed.points, surface.points)
    assert np.array_equal(passed.point_data["v"], values[1:-1])


def test_a_few_crossing_triangles_are_pulled_apart_locally() -> None:
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
    again, _ = gate(crossed, source="x")
    assert np.array_equal(again.points, passed.points)


def one_sided() -> TriSurface:
    """A Klein bottle of 40 by 20 quads: closed, but without an inside."""
    u, v = (w.ravel() for w in np.meshgrid(np.arange(40), np.arange(20), indexing="ij"))

    def index(i, j):
        return i % 40 * 20 + np.where(i >= 40, -j, j) % 20

    quad = [index(u, v), index(u + 1, v), index(u + 1, v + 1), index(u, v + 1)]
    faces = np.concatenate([np.stack([quad[0], quad[1], quad[2]], 1), np.stack([quad[0], quad[2], quad[3]], 1)])
    a, b = u * np.pi / 20, v * np.pi / 10
    radius = 20 + 6 * np.cos(b)
    return TriSurface(np.c_[radius * np.cos(a), radius * np.sin(a), 6 * np.sin(b) * np.cos(a / 2)], faces)


def torus() -> TriSurface:
    shape = trimesh.creation.torus(20.0, 6.0)
    return TriSurface(shape.vertices, shape.faces)


def pinched() -> TriSurface:
    """Two balls that share one vertex."""
    ball = hemisphere()
    left, right = ball.points[:, 0].argmin(), ball.points[:, 0].argmax()
    other = replace(ball, points=ball.points + ball.points[right] - ball.points[left])
    both = joined(ball, other)
    return replace(both, faces=np.where(both.faces == len(ball.points) + left, right, both.faces))


def flat_triangle() -> TriSurface:
    surface = hemisphere()
    points = surface.points.copy()
    a, b, c = surface.faces[7]
    points[a] = (points[b] + points[c]) / 2
    return replace(surface, points=points)


def moved(surface: TriSurface, distance: float) -> TriSurface:
    return replace(surface, points=surface.points + np.array([distance, 0, 0]))


def scaled(factor: float) -> TriSurface:
    return replace(hemisphere(), points=hemisphere().points * factor)


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        (replace(hemisphere(), faces=hemisphere().faces[1:]), "3 open edges"),
        (joined(hemisphere(), moved(hemisphere(), 60)), "2 components instead of one$|2 components instead of one \\("),
        (joined(hemisphere(), replace(hemisphere(), faces=hemisphere().faces[:1])), "vertices coincide .* merge them"),
        (
            replace(hemisphere(), faces=np.vstack([hemisphere().faces, hemisphere().faces[:1]])),
            "3 edges in more than two",
        ),
        (pinched(), "1 pinched vertices"),
        (one_sided(), "inconsistently oriented faces .*no inside"),
        (torus(), "genus 1 .*at most 0 .*gate.allow_genus"),
        (flat_triangle(), r"1 triangles without area, the first is triangle 7 \["),
        (replace(hemisphere(), faces=np.vstack([hemisphere().faces, [5, 5, 9]])), "without area, .* 5120"),
        (scaled(1 / 1000), "0.04 mm long .* in m, .*gate.unit"),
        (scaled(1000), "e.04 mm long .* in um, .*gate.unit"),
        (scaled(1 / 10), "4 mm long .* in cm, .*gate.unit"),
        (scaled(6), "240 mm long.*voxel"),
        (dented(60), r"triangles cross others, the first is \d+ at \[.*\] mm"),
    ],
)
def test_anything_else_is_refused_with_the_reason(surface: TriSurface, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        gate(surface, source="bad.surf.gii")
    assert str(caught.value).startswith("bad.surf.gii: ")
    assert caught.value.remedy


def test_handles_pass_for_those_who_know() -> None:
    _, report = gate(torus(), Gate(allow_genus=1), source="x")
    assert report.genus == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("defects/camelhead_open", "56 open edges"),
        ("defects/fertility_genus4", "genus 4"),
        ("defects/multibody", "2 components"),
        ("defects/fetomorph_GW29_asis_nonmanifold", "633 edges in more than two faces"),
        ("neonatal/ico6_smooth_voxel_units", "221.3 mm long"),
    ],
)
def test_real_defects_are_refused(name: str, words: str) -> None:
    path = DATA / f"{name}.surf.gii"
    if not path.exists():
        pytest.skip("no real surfaces in ../shared/data")
    with pytest.raises(InputError, match=words):
        gate(read_surface(path), source=path)


def test_a_real_surface_with_crossing_triangles_is_mended() -> None:
    path = DATA / "defects/macaque_lh.NMT.wm_selfintersecting.surf.gii"
    if not path.exists():
        pytest.skip("no real surfaces in ../shared/data")
    passed, report = gate(read_surface(path), source=path)
    assert not len(self_intersections(passed))
    assert report.crossing_faces_repaired == 20
    assert report.repair_moved_vertices < 100
    assert report.repair_max_displacement_mm < 0.5


@pytest.mark.parametrize("value", [1e308, -1e308, 1e12, np.nan, np.inf])
def test_absurd_coordinates_are_refused_in_words(value: float) -> None:
    surface = hemisphere()
    points = surface.points.copy()
    points[7, 1] = value
    with pytest.raises(InputError, match=r"x\.gii: a coordinate is .* the file is damaged"):
        gate(replace(surface, points=points), source="x.gii")
