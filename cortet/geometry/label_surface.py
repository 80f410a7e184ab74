"""Closed, smooth surfaces around the voxels of one label.

The signed distance to the voxels' boundary is smoothed by a Gaussian, kept within half a voxel of what it was, and cut
at zero by flying edges (Schroeder et al., IEEE LDAV 2015; in VTK), whose surfaces are closed and manifold. The surface
is then moved along its normals until it encloses the volume of the voxels, since smoothing shrinks what is round.

Noise leaves handles: white matter at 1 mm has more than a hundred. They are cut, or their tunnels closed, on the voxels
(`grid_topology`) before there is a surface; there it takes seconds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cortet.geometry.grid_topology import as_ball
from cortet.geometry.smoothing import taubin
from cortet.geometry.topology import (
    compact,
    component_labels,
    enclosed_volume,
    face_areas,
    surface_topology,
    vertex_normals,
)
from cortet.meshes import FloatArray, TriSurface

#: width of the Gaussian, and how far smoothing may move the boundary, voxels
_WIDTH, _MOST_MOVED = 1.0, 0.45
#: width of the empty border around the label, voxels
_MARGIN = 4
#: steps of Taubin's filter, its factors, and rounds of restoring the volume
_STEPS, _LAMBDA, _MU, _ROUNDS = 10, 0.5, -0.53, 2


class Handles(NamedTuple):
    """What is done about the handles of a label."""

    #: a component with more handles becomes a ball; None: all stay
    most: int | None = None
    #: share of a component's voxels that may change sides for it; else its handles stay
    changed: float = 1.0


#: the topology of the voxels stays as it is
AS_THEY_ARE = Handles()


class LabelSurface(NamedTuple):
    """One component of a label."""

    surface: TriSurface
    #: volume of its voxels, mm3, without cavities
    volume: float
    #: voxels of cavities that were filled
    filled: int
    #: handles of its voxels, and those that are left after some voxels changed sides
    handles: int
    left: int
    changed: int
    #: largest distance of a vertex from the boundary of the voxels, smallest voxel widths
    furthest: float


def label_surfaces(
    mask: NDArray[np.bool_],
    affine: FloatArray,
    *,
    smallest: int = 30,
    handles: Handles = AS_THEY_ARE,
) -> tuple[list[LabelSurface], list[int]]:
    """The closed surface, in mm, of each component of some voxels, the largest first.

    Parameters
    ----------
    mask : (i, j, k); voxels belong together if they share a face
    affine : (4, 4) from voxels to mm
    smallest : components of fewer voxels are left out

    Returns
    -------
    the surfaces, and the numbers of voxels of the components that were left out
    """
    parts, count = ndimage.label(mask)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    order = np.argsort(-sizes, kind="stable")
    boxes = ndimage.find_objects(parts)
    made = []
    for number in order[sizes[order] >= smallest].tolist():
        start = np.array([one.start for one in boxes[number]])
        own = np.pad(parts[boxes[number]] == number + 1, _MARGIN)
        moved = affine.copy()
        moved[:3, 3] += affine[:3, :3] @ (start - _MARGIN)
        made.append(_surface(own, moved, handles))
    return made, sizes[order[sizes[order] < smallest]].tolist()


def _surface(mask: NDArray[np.bool_], affine: FloatArray, handles: Handles) -> LabelSurface:
    """The surface of one component that does not touch the border of its array."""
    solid = ndimage.binary_fill_holes(mask)
    filled = int(solid.sum() - mask.sum())
    widths = np.linalg.norm(affine[:3, :3], axis=0)
    voxel = float(widths.min())
    distance = _signed_distance(solid, widths)
    soft = _smoothed(distance, widths)
    points, faces = cut_at_zero(_thin_as_voxels(soft, distance))
    found = left = int(surface_topology(faces).genus)
    changed = 0
    if handles.most is not None and found > handles.most:
        ball = as_ball(soft)
        differing = int((ball != solid).sum())
        if differing <= handles.changed * solid.sum():
            changed_distance = _signed_distance(ball, widths)
            points, faces = cut_at_zero(_thin_as_voxels(_smoothed(changed_distance, widths), changed_distance))
            solid, left, changed = ball, int(surface_topology(faces).genus), differing
    points = points @ affine[:3, :3].T + affine[:3, 3]
    if enclosed_volume(points, faces) < 0:
        faces = faces[:, ::-1]
    points = taubin(TriSurface(points, faces), steps=_STEPS, lambda_=_LAMBDA, mu=_MU)
    volume = float(solid.sum() * abs(np.linalg.det(affine[:3, :3])))
    for _ in range(_ROUNDS):
        missing = volume - enclosed_volume(points, faces)
        points = points + missing / face_areas(points, faces).sum() * vertex_normals(points, faces)
    where = (points - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
    furthest = float(np.abs(ndimage.map_coordinates(distance, where.T, order=1)).max() / voxel)
    return LabelSurface(TriSurface(points, faces), volume, filled, found, left, changed, furthest)


def _signed_distance(solid: NDArray[np.bool_], widths: FloatArray) -> FloatArray:
    """Distance of each voxel's centre to the boundary of the voxels, mm, positive inside."""
    inside = ndimage.distance_transform_edt(solid, widths)
    outside = ndimage.distance_transform_edt(~solid, widths)
    half = widths.min() / 2
    return np.asarray(np.where(solid, inside - half, half - outside))


def _smoothed(distance: FloatArray, widths: FloatArray) -> FloatArray:
    """A signed distance to voxels, smoothed by less than half a voxel, so that every sign stays."""
    most = _MOST_MOVED * widths.min()
    soft = ndimage.gaussian_filter(distance, _WIDTH * widths.min() / widths)
    return np.asarray(np.clip(soft, distance - most, distance + most))


def _thin_as_voxels(soft: FloatArray, distance: FloatArray) -> FloatArray:
    """The smoothed values; where the body or a gap is one voxel wide, the values of the voxels.

    Smoothing from both sides would leave next to nothing of such a thin body, and no useful tetrahedra could fill it.
    """
    block = np.ones((2, 2, 2), np.bool_)
    thin = np.zeros(distance.shape, np.bool_)
    for side in (distance > 0, distance < 0):
        thin |= side & ~ndimage.binary_opening(side, block)
    return np.asarray(np.where(ndimage.binary_dilation(thin), distance, soft))


def cut_at_zero(values: FloatArray) -> tuple[FloatArray, NDArray[Any]]:
    """Vertices (n, 3), in voxels, and triangles (m, 3) of the surface on which values are 0: its largest component."""
    return _largest(*contour(values))


def contour(values: FloatArray) -> tuple[FloatArray, NDArray[Any]]:
    """`cut_at_zero` with all components."""
    import pyvista

    grid = pyvista.ImageData(dimensions=values.shape)
    grid.point_data["values"] = values.ravel(order="F")
    options = {"method": "flying_edges", "compute_normals": False, "compute_scalars": False}
    found = grid.contour([0.0], scalars="values", **options)
    return np.asarray(found.points, float), np.asarray(found.regular_faces, np.int32)


def _largest(points: FloatArray, faces: NDArray[Any]) -> tuple[FloatArray, NDArray[Any]]:
    """The component with the most triangles: smoothing may cut off what hangs by one voxel."""
    of_face = component_labels(faces)[faces[:, 0]]
    points, faces, _ = compact(points, faces[of_face == np.bincount(of_face).argmax()])
    return points, faces
