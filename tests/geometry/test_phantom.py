"""Synthetic cortices: valid surfaces of real size that fold as they grow."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cortet.errors import InputError
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.meshes import FloatArray, TriSurface
from cortet.phantoms import phantom
from cortet.stages.gate import gate

#: weeks, volume in mL and area in mm2 of real hemispheres
REAL = [(22, 19.8, 4775), (28, 50.0, 9858), (36, 81, 21400)]


@cache
def standard(weeks: float) -> TriSurface:
    return phantom(weeks)


def hull_depths(surface: TriSurface) -> FloatArray:
    """Distance, mm, of the vertices of the outer half to the convex hull: what a sulcus goes deep."""
    hull = ConvexHull(surface.points)
    outer = surface.points[np.abs(surface.points[:, 0]) > np.median(np.abs(surface.points[:, 0]))]
    return closest_points(surface_tree(surface.points, hull.simplices.astype(np.int32)), outer).distances


@pytest.mark.parametrize(("weeks", "volume", "area"), REAL)
def test_size_is_that_of_a_real_hemisphere(weeks, volume, area):
    _, report = gate(standard(weeks), source="phantom")
    assert report.volume_ml == pytest.approx(volume, rel=0.01)
    assert report.area_mm2 == pytest.approx(area, rel=0.05)


@pytest.mark.parametrize(("weeks", "subdivisions", "seed"), [(21, 3, 0), (38, 4, 3)])
def test_every_phantom_passes_the_gate_as_it_is(weeks, subdivisions, seed):
    surface = phantom(weeks, subdivisions=subdivisions, seed=seed)
    assert len(surface.points) == 10 * 4**subdivisions + 2
    _, report = gate(surface, source="phantom")
    assert report.genus == report.faces_reoriented == report.crossing_faces_repaired == 0


def test_left_and_right_are_mirror_images_beside_the_midline():
    left, right = (phantom(27, hemisphere=side, subdivisions=3) for side in "LR")
    assert left.points[:, 0].max() < 0 < right.points[:, 0].min()
    assert np.array_equal(left.points * [-1, 1, 1], right.points)
    assert np.array_equal(left.faces[:, ::-1], right.faces)


def test_sulci_appear_and_deepen_with_age():
    surfaces = [standard(weeks) for weeks in (22, 25, 30, 34)]
    depths = [np.percentile(hull_depths(surface), 75) for surface in surfaces]
    assert all(late > 1.3 * early for early, late in pairwise(depths)), depths
    areas = [topology.face_areas(surface.points, surface.faces).sum() for surface in surfaces]
    gyrification = [area / ConvexHull(surface.points).area for area, surface in zip(areas, surfaces, strict=True)]
    assert gyrification == sorted(gyrification)
    assert gyrification[0] < 1.1 and gyrification[-1] > 1.25


@pytest.mark.parametrize(
    ("weeks", "others", "word"),
    [
        (20, {}, "21 to 38"),
        (39, {}, "21 to 38"),
        (30, {"hemisphere": "left"}, "L or R"),
        (28, {"subdivisions": 40}, "2 to 7"),
        (28, {"seed": -1}, "seed"),
    ],
)
def test_what_there_is_no_phantom_of_is_refused(weeks, others, word):
    with pytest.raises(InputError, match=word):
        phantom(weeks, **others)
