"""Quality of tetrahedra: 0 for the regular one, 1 for a degenerate one.

The certified measure is q = 1 - sqrt(2) 6V / l_rms^3 (`tet_qmetric_volume` of meshtool; V signed volume, l_rms the root
mean square of the six edge lengths). All functions take `points` (n, 3) float64 in mm and `cells` (m, 4) int32.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps

import numba
import numpy as np

from cortet.geometry.topology import TET_EDGES, TET_FACES
from cortet.mesh import FloatArray, IntArray, TetMesh

VERSION: int = 1

#: counted limits of q; the last is the one a solver-ready mesh stays below
COUNTED_LIMITS = (0.3, 0.4, 0.5, 0.6)
HISTOGRAM_BIN_WIDTH = 0.005
#: (K + 4/3 mu) of the folding simulation in units of mu, with bulk modulus K = 5 (BrainGrowth), and its density
_P_WAVE_MODULUS, _DENSITY = 5 + 4 / 3, 0.01


#: tetrahedra measured at a time: their temporary arrays then stay in the processor's cache, whatever the mesh
_BLOCK = 1 << 14


def _in_blocks(measure: Callable[[FloatArray, IntArray], FloatArray]) -> Callable[[FloatArray, IntArray], FloatArray]:
    """The same measure of each tetrahedron, taken of a block of them at a time."""

    @wraps(measure)
    def in_blocks(points: FloatArray, cells: IntArray) -> FloatArray:
        if len(cells) <= _BLOCK:
            return measure(points, cells)
        return np.concatenate([measure(points, cells[at : at + _BLOCK]) for at in range(0, len(cells), _BLOCK)])

    return in_blocks


def edge_vectors(points: FloatArray, cells: IntArray) -> FloatArray:
    """Vectors along the six edges, in the order of `topology.TET_EDGES`: (m, 6, 3) mm."""
    ends = points[cells[:, TET_EDGES]]
    return ends[:, :, 1] - ends[:, :, 0]


@_in_blocks
def edge_lengths(points: FloatArray, cells: IntArray) -> FloatArray:
    """The six edge lengths: (m, 6) mm."""
    return np.linalg.norm(edge_vectors(points, cells), axis=2)


@_in_blocks
def signed_volumes(points: FloatArray, cells: IntArray) -> FloatArray:
    """Signed volumes: (m,) mm3, positive when d sees a, b, c counter-clockwise from outside."""
    a, b, c, d = (points[cells[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def quality(points: FloatArray, cells: IntArray) -> FloatArray:
    """q = 1 - sqrt(2) 6V / l_rms^3: (m,); 1 where V <= 0."""
    return _quality(np.ascontiguousarray(points, np.float64), np.ascontiguousarray(cells, np.int32))


@numba.njit(parallel=True, cache=True)
def _quality(points, cells):  # type: ignore[no-untyped-def]
    q = np.empty(len(cells))
    for e in numba.prange(len(cells)):
        a, b, c, d = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
        wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
        v6 = (uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz
        squares = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
        squares += (vx - ux) ** 2 + (vy - uy) ** 2 + (vz - uz) ** 2
        squares += (wx - ux) ** 2 + (wy - uy) ** 2 + (wz - uz) ** 2
        squares += (wx - vx) ** 2 + (wy - vy) ** 2 + (wz - vz) ** 2
        square = squares / 6
        q[e] = 1 - np.sqrt(2) * v6 / (square * np.sqrt(square)) if v6 > 0 else 1.0
    return q


@_in_blocks
def circumradii(points: FloatArray, cells: IntArray) -> FloatArray:
    """Radius of the circumscribed sphere: (m,) mm; infinite or NaN for a flat element."""
    u, v, w = (points[cells[:, i]] - points[cells[:, 0]] for i in (1, 2, 3))
    uu, vv, ww = ((x * x).sum(axis=1, keepdims=True) for x in (u, v, w))
    numerator = np.linalg.norm(uu * np.cross(v, w) + vv * np.cross(w, u) + ww * np.cross(u, v), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return numerator / (12 * np.abs(signed_volumes(points, cells)))


def _face_area_sums(points: FloatArray, cells: IntArray) -> FloatArray:
    corners = points[cells[:, TET_FACES]]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    return 0.5 * np.linalg.norm(normals, axis=2).sum(axis=1)


@_in_blocks
def radius_ratio(points: FloatArray, cells: IntArray) -> FloatArray:
    """1 - 3 inradius / circumradius: (m,); 1 where V <= 0."""
    volumes = signed_volumes(points, cells)
    inradii = 3 * volumes / _face_area_sums(points, cells)
    return np.where(volumes > 0, 1 - 3 * inradii / circumradii(points, cells), 1.0)


@_in_blocks
def radius_edge(points: FloatArray, cells: IntArray) -> FloatArray:
    """1 - sqrt(6)/4 shortest edge / circumradius: (m,); 1 where V <= 0."""
    volumes = signed_volumes(points, cells)
    shortest = edge_lengths(points, cells).min(axis=1)
    return np.where(volumes > 0, 1 - np.sqrt(6) / 4 * shortest / circumradii(points, cells), 1.0)


@_in_blocks
def dihedral_angles(points: FloatArray, cells: IntArray) -> FloatArray:
    """Interior angle between the two faces along each edge, in the order of `topology.TET_EDGES`: (m, 6) degrees."""
    corners = points[cells]
    angles = np.empty((len(cells), 6))
    for k, (i, j) in enumerate(TET_EDGES):
        m, n = (x for x in range(4) if x not in (i, j))
        axis = corners[:, j] - corners[:, i]
        first, second = np.cross(axis, corners[:, m] - corners[:, i]), np.cross(axis, corners[:, n] - corners[:, i])
        sine = np.linalg.norm(np.cross(first, second), axis=1)
        angles[:, k] = np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", first, second)))
    return angles


def opening_bound(angle: float) -> float:
    """Smallest possible q of a tetrahedron with a dihedral angle of `angle` degrees; 1 from 180 degrees on.

    It has 1 - q <= sqrt(2) sin(angle) / (1 + sin(angle / 2)^2). Of n tetrahedra around an interior edge one has a
    dihedral angle of at most 360 / n degrees, and one of at least that, so this is also a bound of the worst of them.
    """
    if angle >= 180:
        return 1.0
    theta = np.radians(angle)
    return float(1 - np.sqrt(2) * np.sin(theta) / (1 + np.sin(theta / 2) ** 2))


@dataclass(frozen=True)
class Distribution:
    """Mean, standard deviation and range of one measure over all elements."""

    mean: float
    sd: float
    min: float
    max: float


@dataclass(frozen=True)
class QualitySummary:
    """Everything reported about the element quality of one mesh; plain numbers, ready for JSON."""

    nodes: int
    tets: int
    #: the certified measure
    q: Distribution
    #: "0.6" -> number of elements with q above it
    count_above: dict[str, int]
    #: elements per bin of q, [0, 0.005), [0.005, 0.01), ..., the last bin closed; edges are k * `bin_width`
    histogram: list[int]
    bin_width: float
    one_minus_mean_ratio: Distribution
    one_minus_radius_ratio: Distribution
    one_minus_radius_edge: Distribution
    dihedral_min_deg: float
    dihedral_max_deg: float
    shortest_edge_mm: float
    longest_edge_mm: float
    volume_min_mm3: float
    #: l_min / c, c the speed of pressure waves: an explicit solver's bound, in units of mm / sqrt(mu / density), mu = 1
    stable_time_step: float


def distribution(values: FloatArray) -> Distribution:
    """Summary of (m,) values."""
    return Distribution(float(values.mean()), float(values.std()), float(values.min()), float(values.max()))


def histogram(q: FloatArray) -> IntArray:
    """Elements per bin of width 0.005 over [0, 1]: (200,) int32, to be summed over meshes.

    Raises
    ------
    ValueError : a value outside [0, 1], which no positively oriented element has
    """
    if len(q) and not (q.min() >= -1e-12 and q.max() <= 1):
        raise ValueError(f"q runs from {q.min()} to {q.max()}, outside [0, 1]: the mesh has mixed orientation or NaN")
    bins = round(1 / HISTOGRAM_BIN_WIDTH)
    return np.bincount(np.clip((q * bins).astype(int), 0, bins - 1), minlength=bins).astype(np.int32)


def summarise(mesh: TetMesh) -> QualitySummary:
    """Measure every element of a mesh."""
    args = mesh.points, mesh.cells
    q, angles, lengths = quality(*args), dihedral_angles(*args), edge_lengths(*args)
    return QualitySummary(
        nodes=len(mesh.points),
        tets=len(mesh.cells),
        q=distribution(q),
        count_above={str(limit): int((q > limit).sum()) for limit in COUNTED_LIMITS},
        histogram=histogram(q).tolist(),
        bin_width=HISTOGRAM_BIN_WIDTH,
        one_minus_mean_ratio=distribution(1 - (1 - q) ** (2 / 3)),
        one_minus_radius_ratio=distribution(radius_ratio(*args)),
        one_minus_radius_edge=distribution(radius_edge(*args)),
        dihedral_min_deg=float(angles.min()),
        dihedral_max_deg=float(angles.max()),
        shortest_edge_mm=float(lengths.min()),
        longest_edge_mm=float(lengths.max()),
        volume_min_mm3=float(signed_volumes(*args).min()),
        stable_time_step=float(lengths.min() / np.sqrt(_P_WAVE_MODULUS / _DENSITY)),
    )
