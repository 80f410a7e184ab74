"""A smooth closed surface around given surfaces, at least some distance away from them: the space around a brain.

The given surfaces are filled on a grid. The filled body is closed morphologically: grown by a radius and shrunk by it
again, which bridges sulci and the fissure between hemispheres. Flying edges contour the smoothed distance to the closed
body, and vertices of the contour that lie too near are moved outward.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cortet.errors import InputError
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.label_surface import cut_at_zero
from cortet.geometry.limits import CLOSING_MM
from cortet.geometry.nesting import joined
from cortet.geometry.smoothing import taubin
from cortet.geometry.topology import enclosed_volume, neighbour_means, surface_topology, vertex_normals
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, TriSurface, single_precision

#: factor by which the closing radius grows if holes or handles are left, and the most attempts
_LARGER, _ATTEMPTS = 1.6, 3
#: voxel width as a share of the distance, and most voxels along the longest side
_VOXEL, _MOST_VOXELS = 0.5, 160
#: width of the Gaussian, voxels; steps and factors of Taubin's filter
_WIDTH, _STEPS, _LAMBDA, _MU = 1.5, 20, 0.5, -0.53
#: most rounds of moving outward; how much farther than asked, as a share; share of the distance that is enough
_ROUNDS, _FARTHER, _ENOUGH = 20, 0.02, 0.999


def envelope(surfaces: Sequence[TriSurface], distance: float, *, closing: float = CLOSING_MM) -> TriSurface:
    """A closed surface without handles around closed surfaces, triangles outward, float32 coordinates.

    Parameters
    ----------
    surfaces : mm; they may touch and cross each other
    distance : mm, least distance from the surfaces
    closing : mm; gaps narrower than twice this lie inside the envelope
    """
    every = joined(list(surfaces))
    used = every.points[np.unique(every.faces)]
    lowest, highest = used.min(axis=0), used.max(axis=0)
    voxel = max(_VOXEL * distance, float((highest - lowest).max()) / _MOST_VOXELS)
    for attempt in range(_ATTEMPTS):
        radius = closing * _LARGER**attempt
        margin = distance + radius + 4 * voxel
        shape = np.ceil((highest - lowest + 2 * margin) / voxel).astype(int) + 1
        body = _closed(_filled(surfaces, lowest - margin, voxel, tuple(shape)), radius / voxel)
        outside = ndimage.distance_transform_edt(~body)
        if ndimage.label(outside <= distance / voxel)[1] > 1:
            continue
        found = _around(outside - ndimage.distance_transform_edt(body), distance / voxel)
        found = TriSurface(found.points * voxel + lowest - margin, found.faces)
        if surface_topology(found.faces).euler_number == 2:
            return single_precision(_moved_out(found, every, distance))
    raise InputError(
        f"cannot enclose the {len(surfaces)} surfaces by one without holes at a distance of {distance:g} mm",
        remedy="give surfaces of one brain, or a larger distance",
    )


def _filled(
    surfaces: Sequence[TriSurface], lowest: FloatArray, voxel: float, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Voxels whose centres lie inside any of the surfaces, whichever way their triangles point."""
    centres = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(centres), bool)
    for one in surfaces:
        low, high = ((one.points.min(axis=0) - lowest) / voxel, (one.points.max(axis=0) - lowest) / voxel)
        near = np.flatnonzero(((centres >= low) & (centres <= high)).all(axis=1))
        inside[near] |= np.abs(winding_numbers(one, centres[near] * voxel + lowest)) > 0.5
    return inside.reshape(shape)


def _closed(body: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """The body grown and shrunk by a radius (voxels), with its cavities filled."""
    grown = ndimage.distance_transform_edt(~body) <= radius
    return np.asarray(ndimage.binary_fill_holes(ndimage.distance_transform_edt(grown) > radius) | body)


def _around(outside: FloatArray, distance: float) -> TriSurface:
    """The surface at a distance from a body, given the signed distance of each voxel; all in voxels."""
    points, faces = cut_at_zero(distance - ndimage.gaussian_filter(outside, _WIDTH))
    if enclosed_volume(points, faces) < 0:
        faces = faces[:, ::-1]
    return TriSurface(taubin(TriSurface(points, faces), steps=_STEPS, lambda_=_LAMBDA, mu=_MU), faces)


def _moved_out(surface: TriSurface, inside: TriSurface, distance: float) -> TriSurface:
    """The surface after vertices move along its normals until they and the centres of faces are far enough away."""
    tree, points, faces = tree_of(inside), surface.points, surface.faces
    for _ in range(_ROUNDS):
        of_points = closest_points(tree, points).distances
        of_faces = closest_points(tree, points[faces].mean(axis=1)).distances
        if min(of_points.min(), of_faces.min()) >= _ENOUGH * distance:
            break
        missing = distance * (1 + _FARTHER) - of_points
        np.maximum.at(missing, faces, (distance * (1 + _FARTHER) - of_faces)[:, None])
        step = np.maximum(missing, 0)[:, None] * vertex_normals(points, faces)
        points = points + np.where(step.any(axis=1, keepdims=True), step, neighbour_means(step, faces) / 2)
    return TriSurface(points, faces)
