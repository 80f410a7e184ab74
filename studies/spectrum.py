"""How the folds of a surface are spread over sizes: its curvature by bands of spatial frequency, and its sulcal basins.

Bands are those of SPANGY (Germanaud et al., NeuroImage 63, 2012): the first begins at the lowest frequency of the
surface itself, and each is an octave wide. In fetuses and newborns, bands 4 to 6 grow one after the other, as primary,
secondary and tertiary folds appear (Dubois et al., NeuroImage 185, 2019).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import eigsh

from cortet.geometry.spheres import vertex_areas
from cortet.geometry.topology import edges
from cortet.meshes import FloatArray, IntArray, TriSurface

#: octaves above the lowest frequency of the surface
BANDS = 6
#: steps of Lanczos' iteration: from 1000 to 2000, the power of a band changes by less than 3 %
_STEPS = 2000
#: shift below zero at which the smallest eigenvalues are looked for, over the inverse area of the surface
_SHIFT = 0.1


def band_powers(surface: TriSurface, values: FloatArray) -> tuple[FloatArray, float]:
    """Integral of the square of values over the surface, by bands of frequency: (BANDS,); and the longest wave, mm.

    The power of a band is the sum of the squared coefficients of its eigenfunctions of the Laplace-Beltrami operator.
    There are thousands of these, so none is computed: Lanczos' iteration that starts at the values finds the sums
    (Golub and Meurant, Matrices, Moments and Quadrature, Princeton 2010). Curvature in 1/mm has powers without unit.

    Parameters
    ----------
    values : (n,), of the vertices
    """
    areas = vertex_areas(surface)
    root = np.sqrt(areas)
    scale = diags_array(1 / root)
    operator = csr_array(scale @ stiffness(surface) @ scale)
    lowest = eigsh(operator, 2, sigma=-_SHIFT / areas.sum(), v0=root, return_eigenvectors=False)
    first = float(lowest.max())
    start = root * (values - np.average(values, weights=areas))
    eigenvalues, weights = _measure(operator, start)
    limits = first * 4.0 ** np.arange(BANDS + 1)
    limits[0] *= 1 - 1e-6  # the lowest frequency is in the first band
    return np.histogram(eigenvalues, limits, weights=weights)[0], 2 * np.pi / np.sqrt(first)


def _measure(operator: csr_array, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, and how much of the squared length of a vector belongs to each (Gauss's quadrature by Lanczos)."""
    power = float(start @ start)
    if power == 0:
        return np.zeros(1), np.zeros(1)
    diagonal, beside = [], []
    last, current, step = np.zeros_like(start), start / np.sqrt(power), 0.0
    for _ in range(min(_STEPS, len(start))):
        following = operator @ current - step * last
        diagonal.append(float(following @ current))
        following -= diagonal[-1] * current
        step = float(np.linalg.norm(following))
        if step < 1e-12 * abs(diagonal[0]):
            break
        beside.append(step)
        last, current = current, following / step
    eigenvalues, vectors = eigh_tridiagonal(np.array(diagonal), np.array(beside[: len(diagonal) - 1]))
    return eigenvalues, power * vectors[0] ** 2


def stiffness(surface: TriSurface) -> csr_array:
    """Stiffness matrix of linear elements on a triangulated surface, (n, n): half the cotangents beside each edge."""
    corners = surface.points[surface.faces]
    rows, columns, values = [], [], []
    for corner in range(3):
        one, other = (corner + 1) % 3, (corner + 2) % 3
        u, v = corners[:, one] - corners[:, corner], corners[:, other] - corners[:, corner]
        half = (u * v).sum(axis=1) / np.linalg.norm(np.cross(u, v), axis=1) / 2
        i, j = surface.faces[:, one], surface.faces[:, other]
        rows += [i, j, i, j]
        columns += [j, i, i, j]
        values += [-half, -half, half, half]
    count = len(surface.points)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_array(entries, shape=(count, count))


def basins(depth: FloatArray, faces: IntArray, least_mm: float = 1.0) -> FloatArray:
    """Depths of the bottoms of sulcal basins, mm, deepest first.

    Two basins are one unless the ridge between them rises above the bottom of the shallower one by `least_mm`. This is
    the persistence of a maximum (Edelsbrunner, Letscher and Zomorodian 2002).

    Parameters
    ----------
    depth : (n,) depth of the vertices, mm; 0 where none is counted
    faces : (k, 3)
    """
    pairs = edges(faces)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    begins = np.searchsorted(ends[:, 0], np.arange(len(depth) + 1))
    bottom = np.full(len(depth), -1)  # of the basin that a vertex belongs to, by the union of basins
    found = []
    for vertex in np.argsort(-depth, kind="stable").tolist():
        if depth[vertex] <= 0:
            break
        bottom[vertex] = vertex
        for neighbour in ends[begins[vertex] : begins[vertex + 1], 1].tolist():
            if bottom[neighbour] < 0:
                continue
            one, other = _root(bottom, vertex), _root(bottom, neighbour)
            if one == other:
                continue
            deeper, shallower = (one, other) if depth[one] >= depth[other] else (other, one)
            if depth[shallower] - depth[vertex] >= least_mm:
                found.append(depth[shallower])
            bottom[shallower] = deeper
    roots = np.flatnonzero(bottom == np.arange(len(depth)))
    found += [value for value in depth[roots] if value >= least_mm]
    return np.sort(np.array(found, float))[::-1]


def _root(bottom: IntArray, vertex: int) -> int:
    """The bottom of the basin that a vertex is in now; paths are halved on the way."""
    while bottom[vertex] != vertex:
        bottom[vertex] = bottom[bottom[vertex]]
        vertex = bottom[vertex]
    return int(vertex)
