"""Self-intersections, against a brute-force test in exact rational arithmetic."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from shapes import horseshoe, real_surface

from cortet.geometry.intersection import self_intersections
from cortet.meshes import TriSurface

Point = tuple[Fraction, Fraction, Fraction]


def minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Point, b: Point) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def ends_inside(p: Point, q: Point, triangle: list[Point]) -> list[Point]:
    """Both ends of the part of the segment pq that lies in a closed triangle, exactly; none when they do not meet."""
    normal = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]))
    along = minus(q, p)
    first, last = Fraction(0), Fraction(1)
    height, slope = dot(normal, minus(p, triangle[0])), dot(normal, along)
    if slope:
        first = last = -height / slope
        if not 0 <= first <= 1:
            return []
    elif height:
        return []
    for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
        inward = cross(normal, minus(b, a))
        at_p, slope = dot(inward, minus(p, a)), dot(inward, along)
        if slope > 0:
            first = max(first, -at_p / slope)
        elif slope < 0:
            last = min(last, -at_p / slope)
        elif at_p < 0:
            return []
    return [tuple(x + t * d for x, d in zip(p, along, strict=True)) for t in (first, last)] if first <= last else []


def on_segment(x: Point, a: Point, b: Point) -> bool:
    side, from_a = minus(b, a), minus(x, a)
    if not any(side):
        return x == a
    return not any(cross(side, from_a)) and 0 <= dot(side, from_a) <= dot(side, side)


def meet(points: list[Point], one: list[int], other: list[int]) -> bool:
    """Whether two triangles meet beyond what they share.

    They meet in a convex set; each of its corners is an end of the part of some edge of one inside the other.
    """
    shared = [v for v in one if v in other]
    a, b = [points[v] for v in one], [points[v] for v in other]
    corners = [x for t, s in ((a, b), (b, a)) for k in range(3) for x in ends_inside(t[k], t[(k + 1) % 3], s)]
    if not shared:
        return bool(corners)
    if len(shared) == 3:
        return True
    first, last = points[shared[0]], points[shared[-1]]
    return not all(on_segment(x, first, last) for x in corners)


def brute_force(surface: TriSurface) -> list[int]:
    points = [tuple(map(Fraction, p)) for p in surface.points.tolist()]
    faces = surface.faces.tolist()
    pairs = [pair for pair in itertools.combinations(range(len(faces)), 2) if meet(points, *(faces[i] for i in pair))]
    return sorted(set(itertools.chain(*pairs)))


def scattered(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(12, 3))


def on_a_grid(rng: np.random.Generator) -> np.ndarray:
    """Many points in line and in plane with others."""
    return np.array(list(itertools.product(range(4), repeat=3)), float)[rng.choice(64, 12, replace=False)]


def in_a_plane(rng: np.random.Generator) -> np.ndarray:
    grid = np.array(list(itertools.product(range(4), range(4), [0])), float)
    return grid[rng.choice(16, 12, replace=False)]


@pytest.mark.parametrize("place", [scattered, on_a_grid, in_a_plane])
@pytest.mark.parametrize("vertices", [6, 12])
def test_agrees_with_exact_brute_force(place, vertices):
    """Six vertices make triangles that share many vertices and edges, twelve few."""
    rng = np.random.default_rng(0)
    crossing = clear = 0
    for _ in range(80):
        points = place(rng)
        faces = np.array([rng.choice(vertices, 3, replace=False) for _ in range(3)])
        a, b, c = (points[faces[:, i]] for i in range(3))
        faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.1]
        surface = TriSurface(points, faces)
        expected = brute_force(surface)
        assert self_intersections(surface).tolist() == expected
        crossing, clear = crossing + bool(expected), clear + (not expected)
    assert crossing > 3 and clear > 3


def test_neighbours_in_a_flat_region_do_not_cross():
    """Its ends are fans of triangles in one plane, up to rounding, and face each other across a narrow gap."""
    for gap in (0.3, 0.05, 0.001):
        assert not len(self_intersections(horseshoe(gap)))


def test_a_fold_onto_the_neighbour_is_seen_and_a_sharp_one_is_not_a_crossing():
    faces = [[0, 1, 2], [1, 0, 3]]

    def hinge(*apex: float) -> TriSurface:
        return TriSurface([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], apex], faces)

    assert self_intersections(hinge(0.4, 0.7, 0)).tolist() == [0, 1]
    assert not len(self_intersections(hinge(0.4, 0.7, 1e-6)))
    assert not len(self_intersections(hinge(0.4, -0.7, 0)))


@pytest.mark.parametrize(
    ("name", "crossing"),
    [("defects/macaque_lh.NMT.wm_selfintersecting", 20), ("defects/cow", 82), ("fetal/CRL_STA34_left_white", 0)],
)
def test_real_surfaces(name, crossing):
    assert len(self_intersections(real_surface(name))) == crossing
