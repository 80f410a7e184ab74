"""Synthetic fetal cortex surfaces of any gestational age, used by the demo cohort and the tests.

A sphere is deformed into a smooth hemisphere. Its vertices are pressed inward along lines that lead to a core inside
and do not meet before it. So wherever each vertex stops, the surface is closed, of genus 0, and does not cross itself.
Primary sulci are curves on the sphere along which vertices go deeper. They appear in the order of Garel et al. (AJNR
2001; 22:184), then deepen and narrow. From 26 weeks on, secondary folds, which differ with the seed, fill the gaps
between. The common depth of all folds is set so that the area is that of a real cortex of that age.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from cortet.config.stages import Regions
from cortet.errors import InputError
from cortet.geometry import topology
from cortet.geometry.icosphere import icosphere
from cortet.geometry.limits import PHANTOM_AGES, SUBDIVISIONS, THICKNESS_MM, require_within
from cortet.geometry.nesting import nested
from cortet.meshes import FloatArray, IntArray, TriSurface, single_precision
from cortet.stages.separate import separate

VERSION: int = 1

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
    #: points (anterior, superior) on that face, seen as a disc of radius 1
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
#: rounds of redistributing the vertices over the folds
_SPREADING_ROUNDS = 4
#: smoothing steps that round off creases, for a sphere with this number of faces
_ROUNDING_STEPS, _ROUNDING_FACES = 4, 20480
#: wavelength of secondary folds, mm
_WAVELENGTH = 22.0
#: distance that secondary folds keep from primary sulci, mm
_APART = 7.0
#: depth of the medial hollow, over the sphere's radius, and drop of the poles, over the half length
_HOLLOW, _BEND = 0.8, 0.3
#: distance of the medial wall from the plane where the hemisphere is widest, over the sphere's radius
_MEDIAL = 0.35
#: the core is the unfolded surface shrunk by these factors towards this point
_CORE, _CENTRE = np.array([0.0, 0.62, 0.5]), np.array([0.15, 0.0, 0.0])
#: mm by which a white surface is moved inward at a time, and smoothing steps after each move
_INSET_STEP, _ROUNDINGS = 0.15, 3
#: bulges and hollows of the sphere: direction (lateral, anterior, superior), height, angular radius
_RELIEF = (
    ((0.70, 0.42, -0.70), 0.36, 0.36),  # temporal pole
    ((0.45, -0.10, -0.95), 0.26, 0.40),  # temporal lobe
    ((0.10, -1.00, -0.10), 0.08, 0.45),  # occipital pole
    ((0.30, 0.95, 0.10), 0.06, 0.50),  # frontal pole
    ((0.90, 0.30, -0.12), -0.26, 0.30),  # insula
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

    Returns
    -------
    vertices (n, 3) mm, faces (m, 3)

    Examples
    --------
    >>> cortet.phantom(28, subdivisions=4).points.shape
    (2562, 3)
    """
    return phantom_with_sphere(gestational_age, hemisphere=hemisphere, subdivisions=subdivisions, seed=seed)[0]


def phantom_with_sphere(
    gestational_age: float, *, hemisphere: str = "L", subdivisions: int = 5, seed: int = 0
) -> tuple[TriSurface, TriSurface]:
    """A phantom, and the unit sphere that it was made from: a point of the sphere is the same anatomy in every phantom.

    Parameters are those of `phantom`.
    """
    require_within(gestational_age, PHANTOM_AGES, "the gestational age of a phantom in weeks")
    require_within(subdivisions, SUBDIVISIONS, "the number of subdivisions of the icosahedron")
    if seed < 0:
        raise InputError(f"seed {seed} is below 0", remedy="use 0 or more")
    if hemisphere not in ("L", "R"):
        raise InputError(f"no hemisphere `{hemisphere}`", remedy="use L or R")
    volume, area = (float(x) for x in PchipInterpolator(GROWTH[:, 0], GROWTH[:, 1:])(gestational_age))
    volume *= 1000  # mm3

    ball = icosphere(5)  # coordinates (lateral, anterior, superior)
    coarse, coarse_faces = ball.points, ball.faces
    # half the length of the unfolded hemisphere, mm
    length = (volume / topology.enclosed_volume(_bent(_unfolded(coarse)), coarse_faces)) ** (1 / 3)
    pattern = _pattern(coarse, gestational_age, length, seed)

    def missing(depth: float) -> float:
        points = _of_volume(_rounded(_folded(coarse, depth * pattern, length), coarse_faces), coarse_faces, volume)
        return area - float(topology.face_areas(points, coarse_faces).sum())

    deepest = 0.6 * length
    depth = brentq(missing, 0, deepest, xtol=1e-3) if missing(0) * missing(deepest) < 0 else deepest
    ball = icosphere(subdivisions)
    sphere, faces = ball.points, ball.faces
    for _ in range(_SPREADING_ROUNDS):
        points = _folded(sphere, depth * _pattern(sphere, gestational_age, length, seed), length)
        sphere = _drawn_to_long_edges(sphere, faces, points)
    points = _folded(sphere, depth * _pattern(sphere, gestational_age, length, seed), length)
    points = _of_volume(_rounded(points, faces), faces, volume)
    points -= [points[:, 0].min() - 1, *points.mean(axis=0)[1:]]
    if hemisphere == "L":
        points, sphere, faces = points * np.array([-1, 1, 1]), sphere * np.array([-1, 1, 1]), faces[:, ::-1]
    return single_precision(TriSurface(points, faces)), single_precision(TriSurface(sphere, faces))


def inset(surface: TriSurface, thickness: float) -> TriSurface:
    """A white surface within a pial one: its vertices moved inward, smoothly, until they are `thickness` mm below it.

    Where a gyrus is too thin for this, the depth is smaller, as in `separate`.
    """
    require_within(thickness, THICKNESS_MM, "the thickness in mm")
    white = surface
    for reached in np.linspace(0, thickness, int(np.ceil(thickness / _INSET_STEP)) + 1)[1:]:
        try:
            moved, _ = separate(
                nested(surface, {"white": white}), Regions(min_gap=1.0), cell_size=float(reached), most_the_same=1.0
            )
        except InputError as error:
            raise InputError(
                f"a cortex of {thickness:g} mm does not fit into a surface of {len(surface.points):,} vertices: "
                f"{error.what}",
                remedy="use more subdivisions, a thinner cortex, or an earlier age",
            ) from error
        white = moved.inner["white"]
        rounder = white.points
        for _ in range(_ROUNDINGS):
            rounder = (rounder + topology.neighbour_means(rounder, white.faces)) / 2
        white = single_precision(replace(white, points=rounder))
    return white


def _unfolded(directions: FloatArray) -> FloatArray:
    """The sphere with the temporal lobe and the occipital pole raised and the medial half flattened."""
    radius = np.ones(len(directions))
    for centre, height, width in _RELIEF:
        axis = np.array(centre) / np.linalg.norm(centre)
        angle = np.arccos(np.clip(directions @ axis, -1, 1))
        radius += height * np.exp(-((angle / width) ** 2))
    points: FloatArray = directions * radius[:, None]
    lateral = points[:, 0]
    points[:, 0] = np.where(lateral < 0, _MEDIAL * np.tanh(lateral / _MEDIAL), lateral)
    return points


def _bent(points: FloatArray) -> FloatArray:
    """Proportions of a hemisphere of half length 1: the medial wall hollowed around the thalamus, the poles bent down.

    Both are shears, each monotone along its axis, so points that are apart stay apart.
    """
    lateral, anterior, superior = points.T
    hollow = _HOLLOW * np.exp(-(((anterior - 0.05) / 0.5) ** 2) - ((superior + 0.35) / 0.4) ** 2)
    lateral = lateral + hollow * np.clip(1 - lateral, 0, 1.2) / 1.2
    bent: FloatArray = np.stack([lateral, anterior, superior - _BEND * anterior**2], axis=1) * _ASPECT
    return bent


def _maturity(age: float, onset: float, weeks: float) -> float:
    """A smooth rise from 0 at `onset` to 1, `weeks` later."""
    grown = min(max((age - onset) / weeks, 0.0), 1.0)
    return grown**2 * (3 - 2 * grown)


def _width(maturity: float) -> float:
    """Half width of a sulcus, mm: folds narrow as they deepen."""
    return 5.0 - 2.2 * maturity


def _pattern(directions: FloatArray, age: float, length: float, seed: int) -> FloatArray:
    """Relative depth of the folds at `age` (weeks): (n,) for unit vectors (n, 3)."""
    rng = np.random.default_rng(seed)
    surface = length * _bent(_unfolded(directions))
    primary = np.zeros(len(directions))
    lines = []
    for sulcus in SULCI.values():
        course = np.array(sulcus.course) + rng.normal(0, 0.02, (len(sulcus.course), 2))
        relative_depth = sulcus.depth * rng.lognormal(0, 0.1)
        maturity = _maturity(age, sulcus.onset, 8)
        if not maturity:
            continue
        t = np.linspace(-1, 1, 200)
        course = PchipInterpolator(np.linspace(-1, 1, len(course)), course)(t)
        lines.append(length * _bent(_unfolded(_on_sphere(course, sulcus.lateral))))
        width = _width(maturity)
        distance, nearest = cKDTree(lines[-1]).query(surface, distance_upper_bound=3 * width)
        depth = relative_depth * maturity * np.r_[1 - np.abs(t) ** 3, 0][nearest]  # 0 for points farther away
        primary += (depth * np.exp(-((distance / width) ** 2))) ** 4
    maturity = _maturity(age, 26, 10)
    apart = cKDTree(np.concatenate(lines)).query(surface, distance_upper_bound=3 * _APART)[0]
    distance = _distance_to_waves(surface, rng)
    secondary = maturity * np.exp(-((distance / _width(maturity)) ** 2)) * (1 - np.exp(-((apart / _APART) ** 2)))
    pattern: FloatArray = (primary + (0.8 * secondary) ** 4) ** 0.25
    return pattern


def _distance_to_waves(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Distance, mm, of `points` (n, 3) to the winding nodal lines of a random wave, half a wavelength apart."""
    wave = rng.normal(size=(32, 3))
    wave *= 2 * np.pi / _WAVELENGTH / np.linalg.norm(wave, axis=1, keepdims=True)
    phase = points @ wave.T + rng.uniform(0, 2 * np.pi, len(wave))
    slope = np.linalg.norm(np.sin(phase) @ wave, axis=1)
    distance: FloatArray = np.abs(np.cos(phase).sum(axis=1)) / np.hypot(slope, 0.3 * slope.mean())
    return distance


def _on_sphere(course: FloatArray, lateral: bool) -> FloatArray:
    """Unit vectors (lateral, anterior, superior) of points (anterior, superior) of one face."""
    height = np.sqrt(np.maximum(1 - (course**2).sum(axis=1), 0.02))
    return _normalised(np.c_[height if lateral else -height, course])


def _folded(directions: FloatArray, depth: FloatArray, length: float) -> FloatArray:
    """The hemisphere, mm, with vertices pressed towards the core by `depth` (n,) mm, but never onto it."""
    outer = _unfolded(directions)
    core = _CENTRE + _CORE * (outer - _CENTRE)
    thickness = length * np.linalg.norm((outer - core) * _ASPECT, axis=1)
    share = 0.85 * np.tanh(depth / thickness / 0.85)
    return length * _bent(outer + share[:, None] * (core - outer))


def _rounded(points: FloatArray, faces: IntArray) -> FloatArray:
    """Vertices moved towards the mean of their neighbours: real sulci have round bottoms, and creases are hard to mesh.

    The diffusion length is the same at every resolution, so a finer mesh takes more steps.
    """
    for _ in range(max(1, round(_ROUNDING_STEPS * len(faces) / _ROUNDING_FACES))):
        points = (points + topology.neighbour_means(points, faces)) / 2
    return points


def _drawn_to_long_edges(directions: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    """Unit vectors moved half-way to the mean of their neighbours, weighted by their distances in `points`."""
    start, end = topology.edges(faces).T
    one, other = np.r_[start, end], np.r_[end, start]
    weight = np.linalg.norm(points[one] - points[other], axis=1)
    total = np.stack([np.bincount(one, weight * directions[other, i]) for i in range(3)], axis=1)
    return _normalised(directions + total / np.bincount(one, weight)[:, None])


def _normalised(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _of_volume(points: FloatArray, faces: IntArray, volume: float) -> FloatArray:
    """The points, scaled so that the surface encloses `volume` mm3."""
    scaled: FloatArray = points * (volume / topology.enclosed_volume(points, faces)) ** (1 / 3)
    return scaled
