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
are smooth. On a sharp crest the fit may lead out of the wall; there the gradient is that along the steepest edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.topology import TET_FACES, edges, face_normals, neighbours, unit_vectors
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


class Potential(NamedTuple):
    """φ in a wall of n nodes and m tetrahedra, as the kernels take it."""

    #: (n, 3) mm, (m, 4)
    points: FloatArray
    cells: IntArray
    #: (m, 4) the tetrahedron behind the face opposite each corner, or -1
    behind: IntArray
    #: (m, 4, 3) per mm, gradients of the barycentric coordinates
    slopes: FloatArray
    #: (n,), and its gradient (n, 3) per mm
    phi: FloatArray
    gradient: FloatArray


@dataclass(frozen=True, eq=False)
class Columns:
    """The column through each node of a wall."""

    wall: TetMesh
    potential: Potential
    #: (n, 3), unit vector towards the surface where φ is 1
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

    def depth(self, *, equivolumetric: bool) -> tuple[FloatArray, FloatArray]:
        """Fraction of a column between a node and the surface where φ is 1, (n,); and its gradient, (n, 3) per mm.

        Parameters
        ----------
        equivolumetric : whether it is a fraction of the volume, or of the length
        """
        above, below = self._parts(equivolumetric)
        total = above + below
        flux = np.linalg.norm(self.potential.gradient, axis=1) if equivolumetric else np.ones(len(total))
        per_mm = _ratio(np.ones(len(total)), flux * total)
        return _ratio(above, total), -per_mm[:, None] * self.direction

    def at(self, nodes: IntArray, depth: float, *, equivolumetric: bool = True) -> FloatArray:
        """The points at a depth, from 0 to 1, of the columns of some nodes (k,): (k, 3) mm, NaN without a whole column.

        `equivolumetric` is that of `depth`.
        """
        above, below = (part[nodes] for part in self._parts(equivolumetric))
        further = depth * (above + below) - above
        points = self.wall.points[nodes].copy()
        for goal, way in ((0.0, further), (1.0, -further)):
            going = np.flatnonzero(way > 0)
            points[going] = _lines(self.potential, goal, nodes[going], way[going], by_volume=equivolumetric).ends
        points[~self.whole[nodes]] = np.nan
        return points

    def _parts(self, equivolumetric: bool) -> tuple[FloatArray, FloatArray]:
        """Volume or length of the column of a node above and below it."""
        if equivolumetric:
            return self.to_one.volume, self.to_zero.volume
        return self.to_one.length, self.to_zero.length


def _ratio(part: FloatArray, total: FloatArray) -> FloatArray:
    return np.divide(part, total, out=np.zeros(len(total)), where=total > 0)


def columns(wall: TetMesh, phi: FloatArray) -> Columns:
    """Follow the field line of each node of a wall to both of its surfaces.

    Parameters
    ----------
    wall : tetrahedra between two surfaces, all nodes used
    phi : (n,) harmonic in the wall, 0 on one surface and 1 on the other
    """
    potential = _leading_inward(
        Potential(wall.points, wall.cells, neighbours(wall), _slopes(wall), phi, recovered_gradient(wall, phi))
    )
    nodes = np.arange(len(phi), dtype=np.int32)
    endless = np.full(len(phi), np.inf)
    to_zero, to_one = (_lines(potential, goal, nodes, endless, by_volume=True) for goal in (0.0, 1.0))
    return Columns(wall, potential, unit_vectors(potential.gradient), to_zero, to_one)


def _lines(potential: Potential, goal: float, nodes: IntArray, most: FloatArray, *, by_volume: bool) -> Lines:
    """Lines from some nodes (k,) to where φ is `goal`, or as far as `most` (k,), a volume or a length."""
    first, _ = _first_cells(potential, potential.gradient if goal else -potential.gradient)
    return Lines(*_follow(potential, nodes, first[nodes], goal, most, by_volume))


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


def _leading_inward(potential: Potential) -> Potential:
    """The potential with the steepest edge as gradient at the nodes of a surface where the gradient leads outward."""
    phi, gradient = potential.phi, potential.gradient.copy()
    _, inside = _first_cells(potential, np.where(phi[:, None] > 0.5, -gradient, gradient))
    outward = (inside < 0) & ((phi == 0) | (phi == 1))
    ends = np.concatenate([found := edges(potential.cells), found[:, ::-1]])
    ends = ends[outward[ends[:, 0]]]
    side = potential.points[ends[:, 1]] - potential.points[ends[:, 0]]
    along = side * ((phi[ends[:, 1]] - phi[ends[:, 0]]) / np.einsum("ec,ec->e", side, side))[:, None]
    order = np.argsort(np.linalg.norm(along, axis=1), kind="stable")  # the last one written, the steepest, stays
    gradient[ends[order, 0]] = along[order]
    return potential._replace(gradient=gradient)


def _first_cells(potential: Potential, direction: FloatArray) -> tuple[IntArray, FloatArray]:
    """The tetrahedron at each node into which a direction leads most: (n,) int32; and how much, < 0: into none."""
    best, cell = np.full(len(direction), -np.inf), np.zeros(len(direction), np.int32)
    for corner, nodes in enumerate(potential.cells.T):
        others = [other for other in range(4) if other != corner]
        inside = np.einsum("mkc,mc->mk", potential.slopes[:, others], direction[nodes]).min(axis=1)
        order = np.argsort(inside, kind="stable")  # of several tetrahedra at a node the last one written stays
        better = order[inside[order] > best[nodes[order]]]
        best[nodes[better]], cell[nodes[better]] = inside[better], better
    return cell, best


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
def _follow(potential, nodes, first, goal, most, by_volume):  # type: ignore[no-untyped-def]
    """Follow the line of each node to where φ has the value `goal`, or until it has the volume or length `most`."""
    n = len(nodes)
    length, volume, ends, reached = np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(n, np.bool_)
    for k in range(n):
        ends[k] = potential.points[nodes[k]]
        length[k], volume[k], reached[k] = _follow_one(potential, first[k], goal, most[k], by_volume, ends[k])
    return length, volume, ends, reached


@numba.njit(cache=True, error_model="numpy")
def _follow_one(potential, cell, goal, most, by_volume, at):  # type: ignore[no-untyped-def]
    """Length and volume of one line, and whether it reached the goal; `at`, its first point, becomes its end."""
    sign = 1.0 if goal else -1.0
    length, volume = 0.0, 0.0
    weights = _weights(potential, cell, at)
    value, slope = _interpolated(potential, cell, weights)
    for _ in range(_STEPS):
        size = np.sqrt(np.sum(slope**2))
        left = sign * (goal - value)
        if left <= _REACHED**2 or size == 0.0:
            break
        direction = sign * slope / size
        rest = min(_STEP, left) / size
        went = rest
        for _ in range(_PASSED):
            way, through = _way_out(potential.slopes[cell], weights, direction, rest)
            at += way * direction
            rest -= way
            entered = potential.behind[cell, through] if through >= 0 else -1
            cell = cell if entered < 0 else entered
            weights = _weights(potential, cell, at)
            if entered < 0:
                break
        went -= rest
        value, slope = _interpolated(potential, cell, weights)
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
def _way_out(slopes, weights, direction, most):  # type: ignore[no-untyped-def]
    """How far a straight line stays in a tetrahedron, at most `most` mm, and the face by which it leaves, or -1."""
    way, through = most, -1
    for corner in range(4):
        falls = -np.sum(slopes[corner] * direction)
        if falls > 0 and max(weights[corner], 0.0) < way * falls:
            way, through = max(weights[corner], 0.0) / falls, corner
    return way, through


@numba.njit(cache=True, error_model="numpy")
def _weights(potential, cell, at):  # type: ignore[no-untyped-def]
    """Barycentric coordinates of a point in a tetrahedron."""
    weights = np.empty(4)
    weights[0] = 1.0
    for corner in range(1, 4):
        origin = potential.points[potential.cells[cell, 0]]
        weights[corner] = np.sum(potential.slopes[cell, corner] * (at - origin))
        weights[0] -= weights[corner]
    return weights


@numba.njit(cache=True, error_model="numpy")
def _interpolated(potential, cell, weights):  # type: ignore[no-untyped-def]
    """φ and its gradient at a point of a tetrahedron."""
    value, slope = 0.0, np.zeros(3)
    for corner in range(4):
        node = potential.cells[cell, corner]
        value += weights[corner] * potential.phi[node]
        slope += weights[corner] * potential.gradient[node]
    return value, slope
