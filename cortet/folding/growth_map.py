"""Growth that varies in space, as it was measured on a surface, up to several ages.

The mesh has it as point data `growth_to_AGE`: the logarithm of the stretch along the surface from the age of the mesh
to AGE, six numbers per node (`folding.surface_growth`). Between two ages the logarithm changes linearly. Point data
`core_growth_to_AGE` are one number per node: how much more than average the core grows there, in all directions.

An element has three of its numbers for each age: half the trace, which is the growth alpha of the law, and two for how
much more one direction grows than the other. The law of an element has a single growth along the surface, so the rest
goes into the gradients of its shape functions: A_r^-1 Fg^-1 = (A_r^-1 exp(-S)) Fg(alpha)^-1, because S is traceless and
lies in the plane in which Fg(alpha) is a multiple of the identity. The growth of the core goes there, too, and into the
volumes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cortet.errors import InputError
from cortet.folding.body import Body
from cortet.folding.fields import node_field
from cortet.folding.law import combined, cross, dot, exponential, fast, growth_share, vector
from cortet.folding.surface_growth import matrices
from cortet.geometry.limits import FOLD_AGES
from cortet.meshes import FloatArray, TetMesh
from cortet.solver_files.names import GROWTH_FIELD, age_of_growth, growth_field

#: logarithm of a stretch beyond which a map cannot be a map of growth: more than a factor of seven
_LARGEST = 2.0


class GrowthMap(NamedTuple):
    """Logarithmic growth along the surface since the start of m elements, at k ages."""

    #: (k,) weeks, ascending; the first is the start
    ages: FloatArray
    #: (k, m, 4): half the trace; components t1 t1 - t2 t2 and t1 t2 + t2 t1 in the tangents of `tangents`; and the
    #: logarithm of the stretch of the core, less its mean over the volume
    values: FloatArray


def ages_of_maps(mesh: TetMesh) -> dict[float, str]:
    """Ages, weeks, up to which the point data of a mesh hold growth, ascending -> their names."""
    named = {age: name for name in mesh.point_data if (age := age_of_growth(name)) is not None}
    return dict(sorted(named.items()))


def map_of(mesh: TetMesh, body: Body, start: float) -> GrowthMap | None:
    """The map of growth in the point data of a mesh; None if there is none."""
    named = ages_of_maps(mesh)
    if not named:
        if wrong := next((name for name in mesh.point_data if name.startswith(GROWTH_FIELD)), None):
            raise InputError(
                f"the field {wrong} is not a map of growth",
                remedy="use `cortet mesh --field` with the .func.gii file that `cortet growth` wrote",
            )
        return None
    ages = list(named)
    if not (ages[0] > start and ages[-1] <= FOLD_AGES[1]):
        raise InputError(
            f"the age of the field {named[ages[0] if ages[0] <= start else ages[-1]]} must be above the age of the "
            f"mesh, {start:g} weeks, and at most {FOLD_AGES[1]:g} weeks",
            remedy="name each map by the age up to which it describes growth",
        )
    values = np.zeros((len(ages) + 1, len(body.cells), 4))
    for row, age in enumerate(ages, start=1):
        nodes = np.asarray(mesh.point_data[named[age]], float)
        _check(nodes, named[age], len(mesh.points))
        values[row, :, :3] = _on_elements(nodes[body.cells].mean(axis=1), body.normals)
        if (core := node_field(mesh, growth_field(age, core=True))) is not None:
            own = core[body.cells].mean(axis=1)
            values[row, :, 3] = own - np.average(own, weights=body.volumes)  # the mean belongs to the frame
    return GrowthMap(np.array([start, *ages]), values)


def _check(values: FloatArray, name: str, count: int) -> None:
    """Raise InputError for a field that cannot be logarithmic growth."""
    remedy = "make the field with `cortet growth`"
    if values.shape != (count, 6):
        raise InputError(f"the field {name} has the shape {values.shape}, not ({count}, 6)", remedy=remedy)
    if not np.isfinite(values).all():
        raise InputError(f"the field {name} is not finite everywhere", remedy=remedy)
    if np.abs(values).max() > _LARGEST:
        node = int(np.abs(values).max(axis=1).argmax())
        raise InputError(
            f"the field {name} stretches node {node} by exp({np.abs(values[node]).max():.3g}), more than sevenfold",
            remedy=remedy,
        )


def _on_elements(tensors: FloatArray, normals: FloatArray) -> FloatArray:
    """The three numbers of tensors (m, 6), in the planes perpendicular to `normals` (m, 3): (m, 3)."""
    t1, t2 = _all_tangents(np.ascontiguousarray(normals))
    own = matrices(tensors)
    a, b, c = (np.einsum("mi,mij,mj->m", u, own, v) for u, v in ((t1, t1), (t2, t2), (t1, t2)))
    return np.stack([(a + b) / 2, (a - b) / 2, c], axis=1)


def grown_body(body: Body, growth: GrowthMap, age: float, core: float) -> Body:
    """The body with its map at an age; its core has grown by `core`.

    `amount` becomes the growth itself, for a law of the cortex that is 1; `gradients` and `volumes` hold the rest.

    Parameters
    ----------
    core : stretch of the core since the start
    """
    after = min(int(np.searchsorted(growth.ages, age, side="right")), len(growth.ages) - 1)
    before = after - 1
    part = float(np.clip((age - growth.ages[before]) / (growth.ages[after] - growth.ages[before]), 0, 1))
    amount, gradients, volumes = _grown(body, growth.values[before], growth.values[after], part, core)
    return body._replace(amount=amount, gradients=gradients, volumes=volumes)


@fast
def _grown(body, before, after, part, core):  # type: ignore[no-untyped-def]
    """Growth of each element, its gradients and its volume: (m,), (m, 3, 3) and (m,)."""
    amount, gradients, volumes = np.empty(len(body.volumes)), np.empty_like(body.gradients), body.volumes.copy()
    for e in range(len(amount)):
        half, p, q = combined(1 - part, vector(before, e), part, vector(after, e))
        share = growth_share(body.depth[e], body.thickness[e], body.mask[e])
        amount[e] = exponential(half) / core - 1
        stretch = exponential((1 - share) * ((1 - part) * before[e, 3] + part * after[e, 3]))
        volumes[e] *= stretch * stretch * stretch
        t1, t2 = tangents(vector(body.normals, e))
        for k in range(3):
            own = sheared(vector(body.gradients[e], k), t1, t2, share * p, share * q)
            gradients[e, k, 0], gradients[e, k, 1], gradients[e, k, 2] = combined(1 / stretch, own, 0.0, own)
    return amount, gradients, volumes


@fast
def sheared(a, t1, t2, p, q):  # type: ignore[no-untyped-def]
    """exp(-S) a for S = p (t1 t1 - t2 t2) + q (t1 t2 + t2 t1): S S is r^2 in the plane, r^2 = p^2 + q^2."""
    r = np.sqrt(p * p + q * q)
    cosine, sine = np.cosh(r), np.sinh(r) / r if r > 1e-12 else 1.0
    x, y = dot(a, t1), dot(a, t2)
    dx, dy = cosine * x - sine * (p * x + q * y) - x, cosine * y - sine * (q * x - p * y) - y
    return combined(1.0, combined(1.0, a, dx, t1), dy, t2)


@fast
def tangents(n):  # type: ignore[no-untyped-def]
    """Two unit vectors perpendicular to a unit vector and to each other; zero vectors for the zero vector."""
    length = dot(n, n)
    if length < 0.5:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    # perpendicular to an axis that is far from n, so that nothing cancels
    axis = (1.0, 0.0, 0.0) if abs(n[0]) < 0.6 else (0.0, 1.0, 0.0)
    t = cross(n, axis)
    first = combined(1 / np.sqrt(dot(t, t)), t, 0.0, t)
    return first, cross(n, first)


@fast
def _all_tangents(normals):  # type: ignore[no-untyped-def]
    first, second = np.empty_like(normals), np.empty_like(normals)
    for e in range(len(normals)):
        t1, t2 = tangents(vector(normals, e))
        first[e, 0], first[e, 1], first[e, 2] = t1
        second[e, 0], second[e, 1], second[e, 2] = t2
    return first, second
