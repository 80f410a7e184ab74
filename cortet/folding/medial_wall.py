"""The medial wall of half a brain: where the other half would continue, and no cortex grows.

A surface of one hemisphere is cut at the midline, through the corpus callosum, the thalamus and the brain stem. The
cut faces the midline and is flat. It is not a surface of the brain, so nothing grows on it. Because the other half is
the mirror image, its nodes slide in the sagittal plane and never leave it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.folding.fields import node_field
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.geometry.topology import boundary_faces, component_labels, face_areas, face_normals
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface

#: hemisphere -> direction along x, in RAS coordinates, in which its other half lies
TOWARDS_MIDLINE = {"L": 1.0, "R": -1.0}

#: cosine of the largest angle between a face's normal and the midline: for a face of a flat cut, and of any wall
_FLAT_COSINE, _COSINE = 0.9, 0.2
#: in units of length of the simulation: how far a cut may be from flat, and radius around its first face
_FLATNESS, _PLACE = 0.013, 0.15
#: faces from which a cut is searched, and rounds in which its plane is refined
_PLACES, _ROUNDS = 100, 5
#: smallest share of the surface that a cut has; flat bits of cortex are smaller
_LEAST_SHARE = 0.02
#: callosum, thalamus and brain stem lie in this ellipse of the medial plane: centre and half axes along y and z, in
#: units of length from the middle; the cortex above faces the midline, too, and can be as flat
_CENTRE, _HALF_AXES = np.array([0.1, -0.05]), np.array([0.6, 0.45])
#: share of these half axes that counts as the wall if there is no cut
_UNCUT = 0.85


class Wall(NamedTuple):
    """The medial wall of a run, and how it was found."""

    #: (n,), whether a node of the mesh, or a vertex of the surface, belongs to it
    nodes: NDArray[np.bool_]
    #: its area, and its share of the whole surface
    area_mm2: float
    share: float
    #: its source, in words
    found: str


def medial_wall(mesh: TetMesh | TriSurface, hemisphere: str, origin: FloatArray, length: float) -> Wall:
    """The medial wall of half a brain in RAS coordinates, a mesh or its closed surface.

    Point data or a set of faces named `medial_wall` define it if there are any. Otherwise, it is a connected part of
    the faces towards the midline, around the middle of the medial plane. The first choice is the part with most area in
    one plane, if it is at least 2 % of the whole surface. If there is none, as on a surface that was never cut, it is
    the connected part with most area.

    Parameters
    ----------
    hemisphere : "L" or "R"
    origin, length : middle of the medial plane, mm (3,), and unit of length, mm
    """
    faces = mesh.faces if isinstance(mesh, TriSurface) else boundary_faces(mesh)
    areas = face_areas(mesh.points, faces)
    marked = _marked(mesh, faces)
    if marked is not None:
        return _wall(mesh, faces, areas, marked, f"{_what(mesh)} marks it ({MEDIAL_WALL})")
    cosine = face_normals(mesh.points, faces)[:, 0] * TOWARDS_MIDLINE[hemisphere] / (2 * areas)
    centres = (mesh.points[faces].mean(axis=1) - origin) / length
    from_middle = np.linalg.norm((centres[:, 1:] - _CENTRE) / _HALF_AXES, axis=1)
    flat = _flat_cut(centres, areas, (from_middle < 1) & (cosine > _FLAT_COSINE), faces)
    if areas[flat].sum() >= _LEAST_SHARE * areas.sum():
        return _wall(mesh, faces, areas, flat, "it faces the midline and is flat")
    around = _largest_part(faces, areas, (from_middle < _UNCUT) & (cosine > _COSINE))
    return _wall(mesh, faces, areas, around, "it faces the midline around its middle; no part of the surface is flat")


def _what(mesh: TetMesh | TriSurface) -> str:
    return "the surface" if isinstance(mesh, TriSurface) else "the mesh"


def _wall(
    mesh: TetMesh | TriSurface, faces: IntArray, areas: FloatArray, chosen: NDArray[np.bool_], found: str
) -> Wall:
    nodes = np.zeros(len(mesh.points), bool)
    nodes[faces[chosen]] = True
    area = float(areas[chosen].sum())
    return Wall(nodes, area, area / float(areas.sum()), found)


def _marked(mesh: TetMesh | TriSurface, faces: IntArray) -> NDArray[np.bool_] | None:
    """Faces of the wall that the mesh or surface itself marks, (k,): those whose nodes are all marked."""
    if (marks := node_field(mesh, MEDIAL_WALL)) is not None:
        nodes = marks != 0
    elif isinstance(mesh, TetMesh) and MEDIAL_WALL in mesh.sets.faces:
        nodes = np.zeros(len(mesh.points), bool)
        nodes[mesh.sets.faces[MEDIAL_WALL]] = True
    else:
        return None
    chosen: NDArray[np.bool_] = nodes[faces].all(axis=1)
    if chosen.all() or not chosen.any():
        raise InputError(
            f"the field {MEDIAL_WALL} marks {'all' if chosen.all() else 'none'} of the surface",
            remedy="mark the cut through the corpus callosum, or leave the field out",
        )
    return chosen


def _flat_cut(centres: FloatArray, areas: FloatArray, facing: NDArray[np.bool_], faces: IntArray) -> NDArray[np.bool_]:
    """Faces that face the midline, near one plane, and connected with a face near the middle: (k,).

    Of the planes through many such faces, it is the one with most area.

    Parameters
    ----------
    centres : (k, 3), in units of length
    """
    best, most = np.zeros(len(faces), bool), 0.0
    candidates = np.flatnonzero(facing & (np.linalg.norm(centres[:, 1:] - _CENTRE, axis=1) < _PLACE))
    for place in candidates[:: max(len(candidates) // _PLACES, 1)]:
        chosen = facing & (np.linalg.norm(centres - centres[place], axis=1) < _PLACE)
        for _ in range(_ROUNDS):
            middle, normal = _plane(centres[chosen], areas[chosen])
            part = _parts(faces, facing & (np.abs((centres - middle) @ normal) < _FLATNESS))
            if part[place] < 0:
                break
            chosen = part == part[place]
        area = float(areas[chosen].sum())
        if part[place] >= 0 and area > most:
            best, most = chosen, area
    return best


def _plane(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted mean of points (k, 3), and the normal of the plane that fits them best."""
    middle = np.average(points, axis=0, weights=weights)
    spread = np.cov((points - middle).T, aweights=weights) if len(points) > 1 else np.eye(3)
    return middle, np.linalg.eigh(spread)[1][:, 0]


def _largest_part(faces: IntArray, areas: FloatArray, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The connected part of the `chosen` faces (k,) with the largest area."""
    if not chosen.any():
        return chosen
    part = _parts(faces, chosen)
    return part == np.bincount(part[chosen], areas[chosen]).argmax()


def _parts(faces: IntArray, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the connected part of each `chosen` face, -1 for the others: (k,)."""
    part = np.full(len(faces), -1, np.int64)
    part[chosen] = component_labels(faces[chosen])[faces[chosen, 0]]
    return part
