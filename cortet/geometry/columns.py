"""Columns through a wall: field lines of the harmonic function φ that is 0 on one of its surfaces and 1 on the other.

Field lines do not cross, and reach both surfaces at right angles, as cortical columns do. The flux through a bundle of
field lines is constant, so its cross-section goes as the reciprocal of the gradient. The length of a line and the
volume of a thin bundle, from one surface up to a point, are therefore integrals along the line:

    length = ∫ ds,    volume ∝ ∫ ds / |∇φ|

The first gives the thickness (A. Yezzi and J. L. Prince, IEEE Transactions on Medical Imaging 22, 2003, 1332-1339), the
second the equivolumetric depth of Bok (M. D. Waehnert et al., NeuroImage 93, 2014, 210-220).

The gradient of linear elements jumps from one tetrahedron to the next. Here the gradient at a node is that of the
harmonic polynomial of second degree that fits φ best at the node and its neighbours (a polynomial-preserving recovery,
Z. Zhang and A. Naga, SIAM Journal on Scientific Computing 26, 2005, 1192-1213). It is linear between nodes, so lines
are smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.topology import TET_FACES, edges, face_normals, neighbours
from cortet.meshes import FloatArray, IntArray, TetMesh

#: largest step along a line, as a change of φ
_STEP = 0.1
#: most steps of a line, and most tetrahedra that one step passes
_STEPS, _PASSED = 200, 1000
#: difference of φ within which a line that leaves the wall has reached the surface
_REACHED = 1e-3
#: terms of a harmonic polynomial of second degree in three variables
_TERMS = 9
#: weight of the squared distance that a node has from itself, relative to that of its farthest neighbour
_NEAREST = 0.05
#: added to the diagonal of the quadratic terms, relative to the trace: a node may have too few neighbours for them
_RIDGE = 1e-6


class Lines(NamedTuple):
    """A field line from each node to a surface."""

    #: (n,) mm
    length: FloatArray
    #: (n,) volume of a bundle of unit flux
    volume: FloatArray
    #: (n, 3) mm, where the line ends
    ends: FloatArray
    #: (n,) whether that is the surface
    reached: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Columns:
    """The column through each node of a wall."""

    wall: TetMesh
    #: (n,), (n, 3) per mm, at the nodes
    phi: FloatArray
    gradient: FloatArray
    #: (n, 3), unit vector towards the surface where φ is 1; zero at a node without a column
    direction: FloatArray
    #: lines to the surfaces where φ is 0, and where it is 1
    to_zero: Lines
    to_one: Lines

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Whether the column of a node reaches both surfaces: (n,)."""
        return self.to_zero.reached & self.to_one.reached

    @property
    def thickness(self) -> FloatArray:
        """Length of the column of a node: (n,) mm."""
        return self.to_zero.length + self.to_one.length

    @property
    def depth(self) -> FloatArray:
        """Share of the length between a node and the surface where φ is 1: (n,)."""
        return _share(self.to_one.length, self.to_zero.length)

    @property
    def depth_equivolumetric(self) -> FloatArray:
        """Share of the volume between a node and the surface where φ is 1: (n,)."""
        return _share(self.to_one.volume, self.to_zero.volume)

    @property
    def share_per_mm(self) -> FloatArray:
        """How much of its volume a column has in a millimetre at a node: (n,) per mm."""
        flux = np.linalg.norm(self.gradient, axis=1) * (self.to_zero.volume + self.to_one.volume)
        return np.divide(1, flux, out=np.zeros(len(flux)), where=flux > 0)

    def at(self, nodes: IntArray, depth: float, *, equivolumetric: bool = True) -> FloatArray:
        """The points at a depth, from 0 to 1, of the columns of some nodes: (k, 3) mm, NaN without a whole column.

        Parameters
        ----------
        nodes : (k,)
        equivolumetric : whether the depth is a share of the volume, or of the length
        """
        by = "volume" if equivolumetric else "length"
        above, below = getattr(self.to_one, by)[nodes], getattr(self.to_zero, by)[nodes]
        further = depth * (above + below) - above
        points = self.wall.points[nodes].copy()
        for goal, way in ((0.0, further), (1.0, -further)):
            going = np.flatnonzero(way > 0)
            lines = _lines(self.wall, self.phi, self.gradient, goal, nodes[going], way[going], by_volume=equivolumetric)
            points[going] = lines.ends
        points[~self.whole[nodes]] = np.nan
        return points


def _share(above: FloatArray, below: FloatArray) -> FloatArray:
    total = above + below
    return np.divide(above, total, out=np.zeros(len(total)), where=total > 0)


def columns(wall: TetMesh, phi: FloatArray) -> Columns:
    """Follow the field line of each node of a wall to both of its surfaces.

    Parameters
    ----------
    wall : tetrahedra between two surfaces, all nodes used
    phi : (n,) harmonic in the wall, 0 on one surface and 1 on the other
    """
    gradient = recovered_gradient(wall, phi)
    size = np.linalg.norm(gradient, axis=1)
    direction = np.divide(gradient, size[:, None], out=np.zeros_like(gradient), where=size[:, None] > 0)
    nodes = np.arange(len(wall.points), dtype=np.int32)
    to_zero, to_one = (
        _lines(wall, phi, gradient, goal, nodes, np.full(len(nodes), np.inf), by_volume=True) for goal in (0.0, 1.0)
    )
    return Columns(wall, phi, gradient, direction, to_zero, to_one)


def _lines(
    wall: TetMesh,
    phi: FloatArray,
    gradient: FloatArray,
    goal: float,
    nodes: IntArray,
    most: FloatArray,
    *,
    by_volume: bool,
) -> Lines:
    """Lines from some nodes (k,) to where φ is `goal`, or as far as `most` (k,), a volume or a length."""
    slopes = _slopes(wall)
    first = _first_cells(wall, slopes, gradient if goal else -gradient)
    found = _follow(
        wall.points, wall.cells, slopes, neighbours(wall), phi, gradient, nodes, first[nodes], goal, most, by_volume
    )
    return Lines(*found)


def recovered_gradient(mesh: TetMesh, values: FloatArray) -> FloatArray:
    """The gradient of a harmonic function at the nodes: (n, 3), per mm.

    Parameters
    ----------
    values : (n,) at the nodes
    """
    ends = np.concatenate([found := edges(mesh.cells), found[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    first = np.searchsorted(ends[:, 0], np.arange(len(mesh.points) + 1))
    return _fitted(mesh.points, values, first, np.ascontiguousarray(ends[:, 1]))


def _slopes(mesh: TetMesh) -> FloatArray:
    """Gradients of the barycentric coordinates of each tetrahedron: (m, 4, 3), per mm."""
    inward = -np.stack([face_normals(mesh.points, mesh.cells[:, face]) for face in TET_FACES], axis=1)
    side = mesh.points[mesh.cells[:, 1]] - mesh.points[mesh.cells[:, 0]]
    six_volumes = np.einsum("mc,mc->m", inward[:, 1], side)
    return np.ascontiguousarray(inward / six_volumes[:, None, None])


def _first_cells(mesh: TetMesh, slopes: FloatArray, direction: FloatArray) -> IntArray:
    """The tetrahedron at each node into which a direction leads most: (n,) int32."""
    best, cell = np.full(len(mesh.points), -np.inf), np.zeros(len(mesh.points), np.int32)
    for corner in range(4):
        nodes = mesh.cells[:, corner]
        others = [other for other in range(4) if other != corner]
        inside = np.einsum("mkc,mc->mk", slopes[:, others], direction[nodes]).min(axis=1)
        order = np.argsort(inside, kind="stable")  # of several tetrahedra at a node the last one written stays
        better = order[inside[order] > best[nodes[order]]]
        best[nodes[better]], cell[nodes[better]] = inside[better], better
    return cell


@numba.njit(cache=True, error_model="numpy")
def _fitted(points, values, first, others):  # type: ignore[no-untyped-def]
    """Gradient at each node of the harmonic polynomial that fits the values at it and its neighbours."""
    gradient = np.zeros_like(points)
    term = np.empty(_TERMS)
    for node in range(len(points)):
        around = others[first[node] : first[node + 1]]
        scale = 0.0
        for other in around:
            scale = max(scale, np.sum((points[other] - points[node]) ** 2))
        scale = np.sqrt(scale)
        matrix, right = np.zeros((_TERMS, _TERMS)), np.zeros(_TERMS)
        for k in range(len(around) + 1):
            other = node if k == len(around) else around[k]
            x, y, z = (points[other] - points[node]) / scale
            term[0], term[1], term[2], term[3] = 1.0, x, y, z
            term[4], term[5], term[6], term[7] = x * y, y * z, x * z, x * x - y * y
            term[8] = 2 * z * z - x * x - y * y
            weight = 1 / (_NEAREST + x * x + y * y + z * z)
            for i in range(_TERMS):
                right[i] += weight * term[i] * values[other]
                for j in range(_TERMS):
                    matrix[i, j] += weight * term[i] * term[j]
        trace = np.trace(matrix)
        for i in range(4, _TERMS):
            matrix[i, i] += _RIDGE * trace
        gradient[node] = np.linalg.solve(matrix, right)[1:4] / scale
    return gradient


@numba.njit(cache=True, error_model="numpy")
def _follow(  # type: ignore[no-untyped-def]
    points, cells, slopes, behind, phi, gradient, nodes, first, goal, most, by_volume
):
    """Follow the line of each node to where φ has the value `goal`, or until it has the volume or length `most`."""
    n = len(nodes)
    length, volume, ends, reached = np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(n, np.bool_)
    for k in range(n):
        length[k], volume[k], reached[k] = _follow_one(
            points, cells, slopes, behind, phi, gradient, nodes[k], first[k], goal, most[k], by_volume, ends[k]
        )
    return length, volume, ends, reached


@numba.njit(cache=True, error_model="numpy")
def _follow_one(  # type: ignore[no-untyped-def]
    points, cells, slopes, behind, phi, gradient, node, cell, goal, most, by_volume, at
):
    """Length and volume of one line, and whether it reached the goal; `at` becomes its end."""
    sign = 1.0 if goal else -1.0
    at[:] = points[node]
    length, volume = 0.0, 0.0
    weights = _weights(points, cells, slopes, cell, at)
    value, slope = _interpolated(cells, phi, gradient, cell, weights)
    for _ in range(_STEPS):
        size = np.sqrt(np.sum(slope**2))
        left = sign * (goal - value)
        if left <= _REACHED**2 or size == 0.0:
            break
        direction = sign * slope / size
        rest = min(_STEP, left) / size
        went = rest
        for _ in range(_PASSED):
            way, through = _way_out(slopes, cell, weights, direction, rest)
            at += way * direction
            rest -= way
            entered = behind[cell, through] if through >= 0 else -1
            cell = cell if entered < 0 else entered
            weights = _weights(points, cells, slopes, cell, at)
            if entered < 0:
                break
        went -= rest
        value, slope = _interpolated(cells, phi, gradient, cell, weights)
        spread = went * (1 / size + 1 / np.sqrt(np.sum(slope**2))) / 2
        beyond = volume + spread - most if by_volume else length + went - most
        if beyond > 0:
            share = beyond / (spread if by_volume else went)
            at -= share * went * direction
            return length + (1 - share) * went, volume + (1 - share) * spread, False
        length += went
        volume += spread
        if rest > 0:
            break
    return length, volume, abs(goal - value) <= _REACHED


@numba.njit(cache=True, error_model="numpy")
def _way_out(slopes, cell, weights, direction, most):  # type: ignore[no-untyped-def]
    """How far a straight line stays in a tetrahedron, at most `most` mm, and the face by which it leaves, or -1."""
    way, through = most, -1
    for corner in range(4):
        falls = -np.sum(slopes[cell, corner] * direction)
        if falls > 0 and max(weights[corner], 0.0) < way * falls:
            way, through = max(weights[corner], 0.0) / falls, corner
    return way, through


@numba.njit(cache=True, error_model="numpy")
def _weights(points, cells, slopes, cell, at):  # type: ignore[no-untyped-def]
    """Barycentric coordinates of a point in a tetrahedron."""
    weights = np.empty(4)
    weights[0] = 1.0
    for corner in range(1, 4):
        weights[corner] = np.sum(slopes[cell, corner] * (at - points[cells[cell, 0]]))
        weights[0] -= weights[corner]
    return weights


@numba.njit(cache=True, error_model="numpy")
def _interpolated(cells, phi, gradient, cell, weights):  # type: ignore[no-untyped-def]
    value, slope = 0.0, np.zeros(3)
    for corner in range(4):
        value += weights[corner] * phi[cells[cell, corner]]
        slope += weights[corner] * gradient[cells[cell, corner]]
    return value, slope
