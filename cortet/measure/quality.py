"""Quality of tetrahedra: 0 for the regular tetrahedron, 1 for a degenerate one.

The certified measure is q = 1 - sqrt(2) 6V / l_rms^3 (`tet_qmetric_volume` of meshtool; V signed volume, l_rms the root
mean square of the six edge lengths). All functions take `points` (n, 3) float64 in mm and `cells` (m, 4) int32.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from cortet.geometry.topology import TET_EDGES
from cortet.measure.counts import COUNTED_LIMITS, HISTOGRAM_BIN_WIDTH
from cortet.meshes import FloatArray, IntArray, TetMesh, require_indices, require_measurable

VERSION: int = 2

#: (K + 4/3 mu) of the folding simulation in units of mu, with bulk modulus K = 5 (BrainGrowth), and its density
_P_WAVE_MODULUS, _DENSITY = 5 + 4 / 3, 0.01


def edge_lengths(points: FloatArray, cells: IntArray) -> FloatArray:
    """The six edge lengths, in the order of `topology.TET_EDGES`: (m, 6) mm."""
    ends = points[cells[:, TET_EDGES]]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def signed_volumes(points: FloatArray, cells: IntArray) -> FloatArray:
    """Signed volumes: (m,) mm3, positive when d sees a, b, c counter-clockwise from outside."""
    require_indices(cells, len(points), "tetrahedron", "nodes")
    return _volumes(np.ascontiguousarray(points, np.float64), np.ascontiguousarray(cells, np.int32))


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _volumes(points, cells):  # type: ignore[no-untyped-def]
    volumes = np.empty(len(cells))
    for e in numba.prange(len(cells)):
        volumes[e] = signed_volume(points, cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3])
    return volumes


@numba.njit(cache=True, error_model="numpy")
def signed_volume(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """Volume of a tetrahedron, positive when d sees a, b, c counter-clockwise from outside."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
    return ((uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz) / 6


def oriented(points: FloatArray, cells: IntArray) -> tuple[IntArray, int]:
    """Tetrahedra reordered to positive volume. Exactly flat ones are dropped; returns also their number."""
    volumes = signed_volumes(points, cells)
    cells = np.where((volumes < 0)[:, None], cells[:, [0, 1, 3, 2]], cells)
    return cells[volumes != 0], int((volumes == 0).sum())


def quality(points: FloatArray, cells: IntArray) -> FloatArray:
    """q = 1 - sqrt(2) 6V / l_rms^3: (m,); 1 where V <= 0. InputError if an index is not valid."""
    require_indices(cells, len(points), "tetrahedron", "nodes")
    return _quality(np.ascontiguousarray(points, np.float64), np.ascontiguousarray(cells, np.int32))


@numba.njit(parallel=True, cache=True, error_model="numpy")
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


def circumradii(points: FloatArray, cells: IntArray) -> FloatArray:
    """Radius of the circumscribed sphere: (m,) mm; infinite or NaN for a flat element."""
    u, v, w = (points[cells[:, i]] - points[cells[:, 0]] for i in (1, 2, 3))
    uu, vv, ww = ((x * x).sum(axis=1, keepdims=True) for x in (u, v, w))
    numerator = np.linalg.norm(uu * np.cross(v, w) + vv * np.cross(w, u) + ww * np.cross(u, v), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return numerator / (12 * np.abs(signed_volumes(points, cells)))


class Measures(NamedTuple):
    """All measures of elements besides q, each (m,)."""

    #: signed, mm3
    volume: FloatArray
    #: 1 - 3 inradius / circumradius, and 1 - sqrt(6)/4 shortest edge / circumradius; 1 where V <= 0
    radius_ratio: FloatArray
    radius_edge: FloatArray
    #: smallest of the six dihedral angles, degrees
    smallest_angle: FloatArray
    largest_angle: FloatArray
    #: shortest of the six edges, mm
    shortest_edge: FloatArray
    longest_edge: FloatArray


def measures(points: FloatArray, cells: IntArray) -> Measures:
    """All measures but q, in one pass over the elements. InputError if an index is not valid."""
    require_indices(cells, len(points), "tetrahedron", "nodes")
    table = _measures(np.ascontiguousarray(points, np.float64), np.ascontiguousarray(cells, np.int32))
    return Measures(*table.T)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _measures(points, cells):  # type: ignore[no-untyped-def]
    table = np.empty((len(cells), 7))
    for e in numba.prange(len(cells)):
        a, b, c, d = points[cells[e, 0]], points[cells[e, 1]], points[cells[e, 2]], points[cells[e, 3]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
        # outward normals of twice the face areas; the one opposite `a` makes their sum 0
        normal = np.empty((4, 3))
        normal[1] = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
        normal[2] = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        normal[3] = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
        for k in range(3):
            normal[0, k] = -(normal[1, k] + normal[2, k] + normal[3, k])
        size = np.empty(4)
        for i in range(4):
            size[i] = np.sqrt(normal[i, 0] ** 2 + normal[i, 1] ** 2 + normal[i, 2] ** 2)
        v6 = -(normal[3, 0] * wx + normal[3, 1] * wy + normal[3, 2] * wz)

        uu, vv, ww = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
        least = min(uu, vv, ww)
        most = max(uu, vv, ww)
        for square in (
            (vx - ux) ** 2 + (vy - uy) ** 2 + (vz - uz) ** 2,
            (wx - ux) ** 2 + (wy - uy) ** 2 + (wz - uz) ** 2,
            (wx - vx) ** 2 + (wy - vy) ** 2 + (wz - vz) ** 2,
        ):
            least, most = min(least, square), max(most, square)

        # |uu (v x w) + vv (w x u) + ww (u x v)| / 2 V6 is the circumradius; the normals are these products, negative
        x = uu * normal[1, 0] + vv * normal[2, 0] + ww * normal[3, 0]
        y = uu * normal[1, 1] + vv * normal[2, 1] + ww * normal[3, 1]
        z = uu * normal[1, 2] + vv * normal[2, 2] + ww * normal[3, 2]
        doubled = np.sqrt(x * x + y * y + z * z)  # circumradius times 2 V6

        smallest, largest = np.inf, -np.inf
        for i in range(4):
            for j in range(i + 1, 4):
                n, m = normal[i], normal[j]
                cosine = -(n[0] * m[0] + n[1] * m[1] + n[2] * m[2])
                x, y, z = n[1] * m[2] - n[2] * m[1], n[2] * m[0] - n[0] * m[2], n[0] * m[1] - n[1] * m[0]
                angle = np.arctan2(np.sqrt(x * x + y * y + z * z), cosine)
                smallest, largest = min(smallest, angle), max(largest, angle)

        table[e, 0] = v6 / 6
        if v6 > 0:
            inradius = v6 / (size[0] + size[1] + size[2] + size[3])
            table[e, 1] = 1 - 3 * inradius * 2 * v6 / doubled
            table[e, 2] = 1 - np.sqrt(6) / 4 * np.sqrt(least) * 2 * v6 / doubled
        else:
            table[e, 1] = table[e, 2] = 1.0
        table[e, 3], table[e, 4] = np.degrees(smallest), np.degrees(largest)
        table[e, 5], table[e, 6] = np.sqrt(least), np.sqrt(most)
    return table


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

    Such a tetrahedron has 1 - q <= sqrt(2) sin(angle) / (1 + sin(angle / 2)^2). Of n tetrahedra around an interior
    edge, one has a dihedral angle of at most 360 / n degrees and one of at least that. So this also bounds the worst
    of them.
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
    """All that is reported about the element quality of one mesh, in plain numbers that JSON can hold."""

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
    """Elements per bin of width 0.005 over [0, 1]: (200,) int32; histograms of several meshes can be added."""
    if len(q) and not (q.min() >= -1e-12 and q.max() <= 1):
        raise ValueError(f"q runs from {q.min()} to {q.max()}, outside [0, 1]: the mesh has mixed orientation or NaN")
    bins = round(1 / HISTOGRAM_BIN_WIDTH)
    return np.bincount(np.clip((q * bins).astype(int), 0, bins - 1), minlength=bins).astype(np.int32)


def summarise(mesh: TetMesh) -> QualitySummary:
    """Measure every element of a mesh; InputError if it has no elements, or a coordinate is not finite."""
    require_measurable(mesh)
    q, of = quality(mesh.points, mesh.cells), measures(mesh.points, mesh.cells)
    shortest = float(of.shortest_edge.min())
    return QualitySummary(
        nodes=len(mesh.points),
        tets=len(mesh.cells),
        q=distribution(q),
        count_above={str(limit): int((q > limit).sum()) for limit in COUNTED_LIMITS},
        histogram=histogram(q).tolist(),
        bin_width=HISTOGRAM_BIN_WIDTH,
        one_minus_mean_ratio=distribution(1 - np.cbrt(1 - q) ** 2),
        one_minus_radius_ratio=distribution(of.radius_ratio),
        one_minus_radius_edge=distribution(of.radius_edge),
        dihedral_min_deg=float(of.smallest_angle.min()),
        dihedral_max_deg=float(of.largest_angle.max()),
        shortest_edge_mm=shortest,
        longest_edge_mm=float(of.longest_edge.max()),
        volume_min_mm3=float(of.volume.min()),
        stable_time_step=float(shortest / np.sqrt(_P_WAVE_MODULUS / _DENSITY)),
    )
