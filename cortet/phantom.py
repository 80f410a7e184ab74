"""Synthetic fetal cortex surfaces of any gestational age: what the demo cohort and the tests are made of.

A sphere is folded, then bent into a hemisphere. Every vertex moves along its own line from the sphere towards a flat
core; wherever it stops, the surface stays closed, of genus 0 and free of self-intersections. Sulci are lines along which
vertices stop deeper. They are named after real ones, appear in the order of Garel et al. (AJNR 2001;22:184) and deepen
and narrow from then on; how deep they are together follows from the area that a real cortex of that age has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from cortet import topology
from cortet.errors import InputError
from cortet.formats.gifti import single_precision
from cortet.mesh import FloatArray, IntArray, TriSurface

VERSION: int = 1

#: gestational ages, weeks
AGES = (21.0, 38.0)
#: weeks, volume (mL) and area (mm2) of real inner cortical surfaces of one hemisphere
GROWTH = np.array(
    [
        (22, 19.8, 4775),
        (25, 37.4, 7536),
        (28, 50.0, 9858),
        (30, 58.6, 11736),
        (34, 79.1, 18937),
        (36, 81.0, 21400),
        (40, 94.1, 23965),
    ]
)


class Sulcus(NamedTuple):
    """A line on the unit sphere along which the cortex folds inward."""

    #: gestational age at which it appears, weeks
    onset: float
    #: depth relative to the others when fully grown
    depth: float
    #: whether it lies on the lateral or the medial face
    lateral: bool
    #: points (anterior, superior) on that face seen as a disc of radius 1
    course: tuple[tuple[float, float], ...]


SULCI = {
    "Sylvian": Sulcus(15, 1.3, True, ((0.62, -0.34), (0.35, -0.2), (0.0, -0.02), (-0.32, 0.14), (-0.46, 0.28))),
    "calcarine": Sulcus(18, 1.0, False, ((-0.9, -0.08), (-0.65, 0.0), (-0.42, 0.06), (-0.22, -0.04))),
    "parieto-occipital": Sulcus(18, 1.0, False, ((-0.5, 0.78), (-0.53, 0.45), (-0.44, 0.12))),
    "cingulate": Sulcus(
        20, 0.9, False, ((0.66, -0.1), (0.68, 0.22), (0.45, 0.5), (0.1, 0.6), (-0.2, 0.62), (-0.3, 0.82))
    ),
    "central": Sulcus(23, 1.1, True, ((-0.08, 0.9), (0.0, 0.62), (0.1, 0.34), (0.16, 0.14))),
    "superior temporal": Sulcus(
        24, 1.1, True, ((0.46, -0.58), (0.15, -0.4), (-0.2, -0.2), (-0.5, -0.02), (-0.62, 0.2))
    ),
    "collateral": Sulcus(24, 0.9, False, ((0.15, -0.62), (-0.2, -0.5), (-0.6, -0.38))),
    "precentral": Sulcus(26, 1.0, True, ((0.2, 0.86), (0.28, 0.56), (0.34, 0.22))),
    "postcentral": Sulcus(26, 1.0, True, ((-0.3, 0.86), (-0.23, 0.58), (-0.12, 0.28))),
    "superior frontal": Sulcus(26, 0.9, True, ((0.4, 0.7), (0.62, 0.54), (0.82, 0.32))),
    "intraparietal": Sulcus(26, 1.0, True, ((-0.36, 0.46), (-0.58, 0.48), (-0.78, 0.3))),
    "inferior frontal": Sulcus(28, 0.9, True, ((0.48, 0.32), (0.66, 0.2), (0.84, -0.02))),
    "lateral occipital": Sulcus(28, 0.8, True, ((-0.68, 0.02), (-0.82, -0.1), (-0.92, -0.16))),
    "olfactory": Sulcus(28, 0.7, False, ((0.88, -0.3), (0.66, -0.46), (0.48, -0.54))),
    "inferior temporal": Sulcus(30, 0.8, True, ((0.36, -0.76), (0.02, -0.62), (-0.34, -0.44), (-0.6, -0.28))),
    "orbital": Sulcus(30, 0.7, True, ((0.72, -0.44), (0.84, -0.32), (0.92, -0.12))),
    "subparietal": Sulcus(30, 0.7, False, ((-0.08, 0.36), (-0.28, 0.36), (-0.36, 0.52))),
    "superior rostral": Sulcus(32, 0.7, False, ((0.84, -0.06), (0.86, 0.2), (0.74, 0.46))),
    "superior parietal": Sulcus(32, 0.7, True, ((-0.52, 0.78), (-0.62, 0.64), (-0.74, 0.56))),
    "middle frontal": Sulcus(32, 0.7, True, ((0.46, 0.5), (0.64, 0.37), (0.84, 0.15))),
}

#: half extents of the hemisphere relative to its half length: lateral, anterior, superior
_ASPECT = np.array([0.58, 1.0, 0.56])
#: distance of the medial wall from the plane where the hemisphere is widest, of a sphere's radius
_MEDIAL = 0.35
#: the core is the unfolded surface shrunk by these factors towards this point
_CORE, _CENTRE = np.array([0.0, 0.62, 0.5]), np.array([0.15, 0.0, 0.0])
#: bulges and hollows of the sphere: direction (lateral, anterior, superior), height, angular radius
_RELIEF = (
    ((0.70, 0.42, -0.70), 0.36, 0.36),  # temporal pole
    ((0.45, -0.10, -0.95), 0.26, 0.40),  # temporal lobe
    ((0.10, -1.00, -0.10), 0.08, 0.45),  # occipital pole
    ((0.30, 0.95, 0.10), 0.06, 0.50),  # frontal pole
    ((0.90, 0.30, -0.12), -0.26, 0.30),  # insula
    ((-0.70, 0.10, -0.55), -0.40, 0.36),  # between thalamus and hippocampus
)


def phantom(gestational_age: float, *, hemisphere: str = "L", subdivisions: int = 5, seed: int = 0) -> TriSurface:
    """Inner cortical surface of one synthetic hemisphere, mm, left or right of the plane x = 0.

    Volume and area are those of real hemispheres (`GROWTH`).

    Parameters
    ----------
    gestational_age : weeks, 21 to 38
    hemisphere : ``L`` or ``R``, mirror images of each other
    subdivisions : of the icosahedron; 5 gives 10,242 vertices, 6 gives 40,962
    seed : of the individual course and depth of the sulci

    Raises
    ------
    InputError : the age is out of range, the hemisphere neither L nor R
    """
    if not AGES[0] <= gestational_age <= AGES[1]:
        what = f"no phantom of {gestational_age:g} weeks"
        raise InputError(what, remedy=f"gestational age must be {AGES[0]:g} to {AGES[1]:g} weeks")
    if hemisphere not in ("L", "R"):
        raise InputError(f"no hemisphere `{hemisphere}`", remedy="use L or R")
    volume, area = (float(x) for x in PchipInterpolator(GROWTH[:, 0], GROWTH[:, 1:])(gestational_age))
    volume *= 1000

    coarse, coarse_faces = _sphere(5)
    length = (volume / topology.enclosed_volume(_bent(_unfolded(coarse)), coarse_faces)) ** (1 / 3)
    lines = _lines(gestational_age, length, np.random.default_rng(seed))

    def missing(depth: float) -> float:
        points = _of_volume(_folded(coarse, lines, length, depth), coarse_faces, volume)
        return area - float(topology.face_areas(points, coarse_faces).sum())

    deepest = 0.6 * length
    depth = brentq(missing, 0, deepest, xtol=1e-3) if missing(0) * missing(deepest) < 0 else deepest
    sphere, faces = _sphere(subdivisions)
    points = _of_volume(_folded(sphere, lines, length, depth), faces, volume)
    points -= [points[:, 0].min() - 1, *points.mean(axis=0)[1:]]
    if hemisphere == "L":
        points, faces = points * [-1, 1, 1], faces[:, ::-1]
    return single_precision(TriSurface(points, faces))


def _sphere(subdivisions: int) -> tuple[FloatArray, IntArray]:
    """Unit icosphere, coordinates (lateral, anterior, superior)."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.asarray(sphere.vertices), np.asarray(sphere.faces, np.int32)


def _unfolded(directions: FloatArray) -> FloatArray:
    """The sphere with the temporal lobe and the occipital pole raised and the medial half flattened."""
    radius = np.ones(len(directions))
    for centre, height, width in _RELIEF:
        angle = np.arccos(np.clip(directions @ (centre / np.linalg.norm(centre)), -1, 1))
        radius += height * np.exp(-((angle / width) ** 2))
    points = directions * radius[:, None]
    lateral = points[:, 0]
    points[:, 0] = np.where(lateral < 0, _MEDIAL * np.tanh(lateral / _MEDIAL), lateral)
    return points


def _bent(points: FloatArray) -> FloatArray:
    """Proportions of a hemisphere of half length 1, its poles bent down."""
    lateral, anterior, superior = points.T
    return np.stack([lateral, anterior, superior - 0.25 * anterior**2], axis=1) * _ASPECT


class _Line(NamedTuple):
    """One sulcus at one age."""

    #: (k, 3) mm
    points: FloatArray
    #: (k,) depth relative to the deepest possible
    depth: FloatArray
    #: mm
    width: float


def _lines(age: float, length: float, rng: np.random.Generator) -> list[_Line]:
    """The sulci that have appeared by `age` (weeks), on the unfolded hemisphere of half length `length` mm."""
    lines = []
    for sulcus in SULCI.values():
        course = np.array(sulcus.course) + rng.normal(0, 0.02, (len(sulcus.course), 2))
        depth = sulcus.depth * rng.lognormal(0, 0.1)
        course = PchipInterpolator(np.linspace(0, 1, len(course)), course)(np.linspace(0, 1, 100))
        courses = [(sulcus.onset, depth, course)]
        for start in rng.uniform([0.1, 0.4, 0.7], [0.3, 0.6, 0.9]):
            stem = course[round(99 * start)]
            along = course[round(99 * start) + 1] - stem
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along) * rng.choice([-1, 1])
            reach = rng.uniform(0.15, 0.25)
            branch = stem + np.linspace(0, reach, 40)[:, None] * (across + rng.normal(0, 0.3, 2))
            courses.append((max(sulcus.onset + 4, 27), 0.8 * depth, branch))
        for onset, relative_depth, line in courses:
            grown = np.clip((age - onset) / 9, 0, 1)
            maturity = grown**2 * (3 - 2 * grown)
            if maturity:
                t = np.linspace(-1, 1, len(line))
                directions = _on_sphere(line, sulcus.lateral)
                taper = relative_depth * maturity * (1 - np.abs(t) ** 6)
                lines.append(_Line(length * _bent(_unfolded(directions)), taper, 1.6 + 4 * (1 - maturity)))
    return lines


def _on_sphere(course: FloatArray, lateral: bool) -> FloatArray:
    """Unit vectors (lateral, anterior, superior) of points (anterior, superior) of one face."""
    height = np.sqrt(np.maximum(1 - (course**2).sum(axis=1), 0.02))
    directions = np.c_[height if lateral else -height, course]
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _folded(directions: FloatArray, lines: list[_Line], length: float, depth: float) -> FloatArray:
    """The hemisphere, mm, with its sulci pressed in; `depth` mm is that of one of relative depth 1."""
    outer = _unfolded(directions)
    surface = length * _bent(outer)
    pressed = np.zeros(len(directions))
    for line in lines:
        distance, nearest = cKDTree(line.points).query(surface)
        pressed += (line.depth[nearest] * np.exp(-((distance / line.width) ** 2))) ** 6
    pressed = depth * pressed ** (1 / 6)
    core = _CENTRE + _CORE * (outer - _CENTRE)
    thickness = length * np.linalg.norm((outer - core) * _ASPECT, axis=1)
    share = np.tanh(pressed / thickness / 0.8) * 0.8
    return length * _bent(outer + share[:, None] * (core - outer))


def _of_volume(points: FloatArray, faces: IntArray, volume: float) -> FloatArray:
    """Scaled to enclose `volume` mm3."""
    return points * (volume / topology.enclosed_volume(points, faces)) ** (1 / 3)
