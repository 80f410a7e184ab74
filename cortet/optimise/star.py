"""The tetrahedra around one vertex v: E(x) = sum of mu^p with v at x, its derivatives, and steps that lower it.

mu = 1 / (1 - q) = l_rms^3 / (sqrt(2) 6V). With d = grad log mu = 1.5 grad S / S - grad V' / V' (S mean squared edge,
V' = 6V), grad E = sum of p mu^p d, and the Hessian used is the sum of p mu^p (1.5 I / S + grad V' grad V'^T / V'^2 +
p d d^T), which is positive definite. Column i of a star describes tetrahedron i by n, d, m, k with V' = d - n.x and
6 S = 3 x.x - 2 m.x + k.

A star is one array, rows of `WIDE` numbers behind each other, and every loop does the same for all columns: compilers
turn such loops into instructions that treat several tetrahedra at a time. The sums keep the order of the tetrahedra.
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.meshes import FloatArray

#: most tetrahedra of a star; rows of a multiple of 512 would compete for the same lines of the cache
WIDE = 264
#: the rows of a star: n, d and m, k as above; mu^2; then what only the functions below use
_NX, _NY, _NZ, FLATNESS, _MX, _MY, _MZ, _K, MU2, _POWER = (WIDE * row for row in range(10))
_GX, _GY, _GZ, _XX, _XY, _XZ, _YY, _YZ, _ZZ = (WIDE * row for row in range(10, 19))
_ROWS = 19


def mu2_of(q: FloatArray | float) -> FloatArray | float:
    """mu^2 = (1 - q)^-2."""
    return (1.0 - q) ** -2.0


def q_of(mu2: FloatArray) -> FloatArray:
    """q = 1 - 1 / mu."""
    return 1 - 1 / np.sqrt(mu2)


@numba.njit(cache=True, error_model="numpy")
def empty_star():  # type: ignore[no-untyped-def]
    """Room for a star of at most `WIDE` tetrahedra."""
    return np.empty(_ROWS * WIDE)


@numba.njit(cache=True, error_model="numpy", inline="always")
def set_column(star, i, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]
    """Describe tetrahedron (v, a, b, c) with v at the origin, in column i."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = cx - bx, cy - by, cz - bz
    star[_NX + i], star[_NY + i], star[_NZ + i] = nx, ny, nz
    star[FLATNESS + i] = nx * ax + ny * ay + nz * az
    star[_MX + i], star[_MY + i], star[_MZ + i] = ax + bx + cx, ay + by + cy, az + bz + cz
    star[_K + i] = (
        ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
        + ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz + cx * cx + cy * cy + cz * cz
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def find_mu2(star, size, x, y, z):  # type: ignore[no-untyped-def]
    """Write mu^2 of each tetrahedron with v at (x, y, z) to row `MU2`; infinite unless its volume is positive."""
    xx = 3 * (x * x + y * y + z * z)
    for i in range(size):
        v6 = star[FLATNESS + i] - (star[_NX + i] * x + star[_NY + i] * y + star[_NZ + i] * z)
        s = (xx - 2 * (star[_MX + i] * x + star[_MY + i] * y + star[_MZ + i] * z) + star[_K + i]) / 6
        mu2 = s * s * s / (2 * v6 * v6)
        star[MU2 + i] = mu2 if v6 > 0 else np.inf


@numba.njit(cache=True, error_model="numpy")
def energy(star, size, x, y, z, half_power, cap):  # type: ignore[no-untyped-def]
    """Sum of mu^p with v at (x, y, z); infinite if some mu^2 exceeds `cap` or a volume is not positive.

    `half_power`, p / 2, is a power of two. Also fills row `MU2`.
    """
    find_mu2(star, size, x, y, z)
    for i in range(size):
        if not star[MU2 + i] <= cap:
            return np.inf
    for i in range(size):
        star[_POWER + i] = star[MU2 + i]
    while half_power > 1:
        for i in range(size):
            star[_POWER + i] *= star[_POWER + i]
        half_power >>= 1
    total = 0.0
    for i in range(size):
        total += star[_POWER + i]
    return total


@numba.njit(cache=True, error_model="numpy")
def derivatives(star, size, half_power):  # type: ignore[no-untyped-def]
    """Gradient and positive-definite Hessian at the origin: gx, gy, gz, hxx, hxy, hxz, hyy, hyz, hzz.

    Comes after `energy` at the origin with the same power.
    """
    power = 2.0 * half_power
    for i in range(size):
        v6, s = star[FLATNESS + i], star[_K + i] / 6
        weight = power * star[_POWER + i]
        nx, ny, nz = star[_NX + i] / v6, star[_NY + i] / v6, star[_NZ + i] / v6
        dx, dy, dz = nx - 0.5 * star[_MX + i] / s, ny - 0.5 * star[_MY + i] / s, nz - 0.5 * star[_MZ + i] / s
        r = 1.5 / s
        star[_GX + i], star[_GY + i], star[_GZ + i] = weight * dx, weight * dy, weight * dz
        star[_XX + i] = weight * (r + nx * nx + power * dx * dx)
        star[_YY + i] = weight * (r + ny * ny + power * dy * dy)
        star[_ZZ + i] = weight * (r + nz * nz + power * dz * dz)
        star[_XY + i] = weight * (nx * ny + power * dx * dy)
        star[_XZ + i] = weight * (nx * nz + power * dx * dz)
        star[_YZ + i] = weight * (ny * nz + power * dy * dz)
    gx = gy = gz = hxx = hxy = hxz = hyy = hyz = hzz = 0.0
    for i in range(size):
        gx, gy, gz = gx + star[_GX + i], gy + star[_GY + i], gz + star[_GZ + i]
        hxx, hyy, hzz = hxx + star[_XX + i], hyy + star[_YY + i], hzz + star[_ZZ + i]
        hxy, hxz, hyz = hxy + star[_XY + i], hxz + star[_XZ + i], hyz + star[_YZ + i]
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
