"""The tetrahedra around one vertex v: E(x) = sum of mu^p with v at x, its derivatives, and steps that lower it.

mu = 1 / (1 - q) = l_rms^3 / (sqrt(2) 6V). With d = grad log mu = 1.5 grad S / S - grad V' / V' (S mean squared edge,
V' = 6V), grad E = sum of p mu^p d, and the Hessian used is the sum of p mu^p (1.5 I / S + grad V' grad V'^T / V'^2 +
p d d^T), which is positive definite. A row describes each tetrahedron: n, d, m, k with V' = d - n.x and
6 S = 3 x.x - 2 m.x + k.
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.meshes import FloatArray


def mu2_of(q: FloatArray | float) -> FloatArray | float:
    """mu^2 = (1 - q)^-2."""
    return (1.0 - q) ** -2.0


def q_of(mu2: FloatArray) -> FloatArray:
    """q = 1 - 1 / mu."""
    return 1 - 1 / np.sqrt(mu2)


@numba.njit(cache=True, error_model="numpy", inline="always")
def fill_row(row, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]
    """Describe tetrahedron (v, a, b, c) with v at the origin, for `row_mu2` and the functions below it."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = cx - bx, cy - by, cz - bz
    row[0], row[1], row[2] = nx, ny, nz
    row[3] = nx * ax + ny * ay + nz * az
    row[4], row[5], row[6] = ax + bx + cx, ay + by + cy, az + bz + cz
    row[7] = (
        ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
        + ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz + cx * cx + cy * cy + cz * cz
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy", inline="always")
def row_mu2(row, x, y, z):  # type: ignore[no-untyped-def]
    """mu^2 of the tetrahedron of one row with v at (x, y, z); infinite unless its volume is positive."""
    v6 = row[3] - (row[0] * x + row[1] * y + row[2] * z)
    if v6 <= 0:
        return np.inf
    s = (3 * (x * x + y * y + z * z) - 2 * (row[4] * x + row[5] * y + row[6] * z) + row[7]) / 6
    return s * s * s / (2 * v6 * v6)


@numba.njit(cache=True, error_model="numpy")
def row_energy(star, size, x, y, z, half_power, cap):  # type: ignore[no-untyped-def]
    """Sum of mu^p with v at (x, y, z); infinite if some mu^2 exceeds `cap` or a volume is not positive."""
    total = 0.0
    for i in range(size):
        t = row_mu2(star[i], x, y, z)
        if not t <= cap:
            return np.inf
        total += t**half_power
    return total


@numba.njit(cache=True, error_model="numpy")
def row_derivatives(star, size, half_power):  # type: ignore[no-untyped-def]
    """Gradient and positive-definite Hessian at the origin: gx, gy, gz, hxx, hxy, hxz, hyy, hyz, hzz."""
    gx = gy = gz = hxx = hxy = hxz = hyy = hyz = hzz = 0.0
    for i in range(size):
        row = star[i]
        v6, s = row[3], row[7] / 6
        t = s * s * s / (2 * v6 * v6)
        power = 2.0 * half_power
        weight = power * t**half_power
        nx, ny, nz = row[0] / v6, row[1] / v6, row[2] / v6
        dx, dy, dz = nx - 0.5 * row[4] / s, ny - 0.5 * row[5] / s, nz - 0.5 * row[6] / s
        gx += weight * dx
        gy += weight * dy
        gz += weight * dz
        r = 1.5 / s
        hxx += weight * (r + nx * nx + power * dx * dx)
        hyy += weight * (r + ny * ny + power * dy * dy)
        hzz += weight * (r + nz * nz + power * dz * dz)
        hxy += weight * (nx * ny + power * dx * dy)
        hxz += weight * (nx * nz + power * dx * dz)
        hyz += weight * (ny * nz + power * dy * dz)
    return gx, gy, gz, hxx, hxy, hxz, hyy, hyz, hzz


@numba.njit(cache=True, error_model="numpy")
def newton_step(d):  # type: ignore[no-untyped-def]
    """-H^-1 g for symmetric positive-definite H, by cofactors."""
    gx, gy, gz, hxx, hxy, hxz, hyy, hyz, hzz = d
    cxx, cxy, cxz = hyy * hzz - hyz * hyz, hxz * hyz - hxy * hzz, hxy * hyz - hxz * hyy
    cyy, cyz, czz = hxx * hzz - hxz * hxz, hxy * hxz - hxx * hyz, hxx * hyy - hxy * hxy
    det = hxx * cxx + hxy * cxy + hxz * cxz
    if not det > 0:
        return 0.0, 0.0, 0.0
    return (
        -(cxx * gx + cxy * gy + cxz * gz) / det,
        -(cxy * gx + cyy * gy + cyz * gz) / det,
        -(cxz * gx + cyz * gy + czz * gz) / det,
    )


@numba.njit(cache=True, error_model="numpy")
def tangent_step(d, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Newton step within the plane of unit normal n: the 2 x 2 system in an orthonormal basis u, w of that plane."""
    gx, gy, gz, hxx, hxy, hxz, hyy, hyz, hzz = d
    if abs(nx) < 0.6:
        ux, uy, uz = 0.0, nz, -ny
    else:
        ux, uy, uz = -nz, 0.0, nx
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    hux, huy, huz = hxx * ux + hxy * uy + hxz * uz, hxy * ux + hyy * uy + hyz * uz, hxz * ux + hyz * uy + hzz * uz
    hwx, hwy, hwz = hxx * wx + hxy * wy + hxz * wz, hxy * wx + hyy * wy + hyz * wz, hxz * wx + hyz * wy + hzz * wz
    a, b, c = ux * hux + uy * huy + uz * huz, ux * hwx + uy * hwy + uz * hwz, wx * hwx + wy * hwy + wz * hwz
    gu, gw = ux * gx + uy * gy + uz * gz, wx * gx + wy * gy + wz * gz
    det = a * c - b * b
    if not det > 0:
        return 0.0, 0.0, 0.0
    su, sw = -(c * gu - b * gw) / det, -(a * gw - b * gu) / det
    return su * ux + sw * wx, su * uy + sw * wy, su * uz + sw * wz
