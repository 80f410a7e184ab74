"""Stress and elastic stretch of the elements of a folding body, by the law that moves it."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from cortet.folding.body import Body, Material
from cortet.folding.law import (
    SMALLEST_STRETCH,
    combined,
    cross,
    deformation,
    degenerate_stress,
    dot,
    fast,
    grown_gradients,
    growth_share,
    own_growth,
    shear_modulus,
    stress,
    stretches,
    vector,
)
from cortet.folding.run import Moment, Run
from cortet.folding.smoothing import PER_ELEMENT, Edges, edge_deformation
from cortet.meshes import FloatArray

#: number of elements in a block
_BLOCK = 256


class Mechanics(NamedTuple):
    """What m elements feel."""

    #: (m, 6), Cauchy stress xx, yy, zz, xy, yz, xz in the frame of the mesh, over the shear modulus of the cortex
    stress: FloatArray
    #: (m,), largest principal stretch of the elastic deformation, which growth is not part of: 1 without strain
    stretch: FloatArray


def mechanics(run: Run, moment: Moment) -> Mechanics:
    """Stress and stretch of all elements, in the order of the run.

    The Cauchy stress is sigma = P F^T / J, of the first Piola-Kirchhoff stress P and the elastic deformation F of
    `law` (Holzapfel, Nonlinear Solid Mechanics, 2000, section 3.1). Shear stress and stretch of an element are means
    over its own F and those of its edges, as shear energy is (`smoothing`).

    Parameters
    ----------
    moment : after `run.measured`, whose nodal volumes and F of edges are those of now
    """
    course = run.growth.at(np.array([moment.time]), moment.dt)
    return Mechanics(
        *_mechanics(
            tuple(moment.body),
            tuple(run.material),
            tuple(moment.work.edges),
            moment.state.x,
            moment.work.ratio,
            course.growth[0],
            float(course.thickening[0]),
        )
    )


def distortion(run: Run, moment: Moment) -> FloatArray:
    """Largest over smallest stretch of the elastic deformation of each element, in the order of the run: (m,).

    It is 1 without strain: growth, which is not elastic, is no part of it. It is infinite where an element is inverted.
    """
    course = run.growth.at(np.array([moment.time]), moment.dt)
    return _distortion(tuple(moment.body), moment.state.x, course.growth[0], float(course.thickening[0]))


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _distortion(body, x, growth, thickening):  # type: ignore[no-untyped-def]
    body = Body(*body)
    result = np.empty(len(body.cells))
    for block in numba.prange((len(result) + _BLOCK - 1) // _BLOCK):  # of fixed size, as in `kernels`
        for e in range(block * _BLOCK, min(len(result), (block + 1) * _BLOCK)):
            (f0, f1, f2), _ = _elastic(body, x, growth, thickening, e)
            result[e] = _condition(f0, f1, f2)
    return result


@fast
def _condition(f0, f1, f2):  # type: ignore[no-untyped-def]
    """Largest over smallest stretch of the rows of F; infinite for J <= 0.

    Their squares are the eigenvalues of F F^T, by the cosines of Smith (Commun. ACM 4, 1961): an eighth of the
    time that singular values take, for up to a million elements in each row of the table.
    """
    j = dot(f0, cross(f1, f2))
    if not j > 0:
        return np.inf
    mean = (dot(f0, f0) + dot(f1, f1) + dot(f2, f2)) / 3
    a, b, c = dot(f0, f0) - mean, dot(f1, f1) - mean, dot(f2, f2) - mean
    d, e, f = dot(f0, f1), dot(f1, f2), dot(f0, f2)
    radius = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    if radius <= 1e-12 * mean:
        return 1.0
    determinant = a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f)
    angle = np.arccos(min(max(determinant / (2 * radius**3), -1.0), 1.0)) / 3
    largest = mean + 2 * radius * np.cos(angle)
    middle = mean + 2 * radius * np.cos(angle - 2 * np.pi / 3)
    # the product of all three is J^2: their sum would lose the smallest of a flat element to rounding
    return largest * np.sqrt(middle) / j


@numba.njit(cache=True, error_model="numpy")
def _elastic(body, x, growth, thickening, e):  # type: ignore[no-untyped-def]
    """Rows of the elastic deformation gradient of an element, and its share of the cortex."""
    cells, rows, n = body.cells[e], body.gradients[e], vector(body.normals, e)
    share = growth_share(body.depth[e], body.thickness[e] + thickening, body.mask[e])
    along, across, core = vector(growth, body.label[e])
    alpha, beta = own_growth(share, body.amount[e], along, across, core)
    gradients = grown_gradients(vector(rows, 0), vector(rows, 1), vector(rows, 2), n, 1 - dot(n, n), alpha, beta)
    origin = vector(x, cells[0])
    u = combined(1.0, vector(x, cells[1]), -1.0, origin)
    v = combined(1.0, vector(x, cells[2]), -1.0, origin)
    w = combined(1.0, vector(x, cells[3]), -1.0, origin)
    return deformation(u, v, w, gradients[0], gradients[1], gradients[2]), share


@numba.njit(cache=True, error_model="numpy")
def _mechanics(body, material, edges, x, ratio, growth, thickening):  # type: ignore[no-untyped-def]
    body, material, edges = Body(*body), Material(*material), Edges(*edges)
    part = (1 - material.own) / PER_ELEMENT
    sigma, largest = np.empty((len(body.cells), 6)), np.empty(len(body.cells))
    for e in range(len(body.cells)):
        cells = body.cells[e]
        (f0, f1, f2), share = _elastic(body, x, growth, thickening, e)
        mean = (ratio[cells[0]] + ratio[cells[1]] + ratio[cells[2]] + ratio[cells[3]]) / 4
        mu, bulk = shear_modulus(material, share, body.stiffness[e]), material.bulk * (mean - 1)
        sigma[e], largest[e] = _cauchy(f0, f1, f2, mu * material.own, bulk)
        if part > 0:
            largest[e] *= material.own
            for k in range(e * PER_ELEMENT, (e + 1) * PER_ELEMENT):
                f0, f1, f2 = edge_deformation(edges.deformation, edges.of_element[k])
                of_edge, stretch = _cauchy(f0, f1, f2, mu * part, 0.0)
                sigma[e] += of_edge
                largest[e] += part * stretch
    return sigma, largest


@numba.njit(cache=True, error_model="numpy")
def _cauchy(f0, f1, f2, mu, bulk):  # type: ignore[no-untyped-def]
    """Cauchy stress (6,) for the rows of F, and the largest stretch."""
    p0, p1, p2, j, _ = stress(f0, f1, f2, mu, bulk)
    left, stretch, right = stretches(f0, f1, f2)
    if stretch[2] < SMALLEST_STRETCH:
        q0, q1, q2 = degenerate_stress(left, stretch, right, mu)
        p0 = combined(1.0, q0, bulk, cross(f1, f2))
        p1 = combined(1.0, q1, bulk, cross(f2, f0))
        p2 = combined(1.0, q2, bulk, cross(f0, f1))
    sigma = np.array((dot(p0, f0), dot(p1, f1), dot(p2, f2), dot(p0, f1), dot(p1, f2), dot(p0, f2))) / j
    return sigma, stretch[0]
