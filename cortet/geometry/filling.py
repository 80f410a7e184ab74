"""Whether tetrahedra fill one body, each point of it exactly once.

Volumes that add up to the volume inside the boundary prove too little. An element that is listed twice makes up for a
void, and its faces, which are then in two tetrahedra, make up for the boundary of the void. So this module counts
faces, nodes and parts of the boundary.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, counted, place_mm
from cortet.geometry.counting import wrong_faces
from cortet.geometry.flaws import OVERLAPPING, VOIDS, WORDS
from cortet.geometry.mending import defective_vertices
from cortet.geometry.remembering import OncePerCells, once_per_object
from cortet.geometry.topology import (
    TET_FACES,
    boundary,
    boundary_surface,
    component_labels,
    neighbours,
    surface_topology,
    used_vertices,
)
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, IntArray, TetMesh

#: a part of the boundary is a slit without width if it encloses at most this share of the volume inside the boundary
_NO_VOLUME = 1e-12
#: how many locations of a flaw are listed
PLACES = 10

#: winding number above which a point is in two bodies
_TWICE = 1.5

_FOLDED, _OVERFULL = 1, 2


@dataclass(frozen=True)
class Flaw:
    """One way in which tetrahedra fail to fill a body, and how often it occurs."""

    #: identifier, a key of `WORDS`
    id: str
    count: int
    #: (k, 3) mm, the first few locations
    places: FloatArray

    @property
    def sentence(self) -> str:
        """Count and first location in plain words."""
        return f"{self.count} {WORDS[self.id]}, the first at {place_mm(self.places[0])}"


@once_per_object
def flaws(mesh: TetMesh) -> tuple[Flaw, ...]:
    """Every kind of flaw, including those that do not occur; an inverted tetrahedron counts as if it were turned.

    Parameters
    ----------
    mesh : all its indices are valid
    """
    wrong = wrong_faces(mesh.points, mesh.cells, TET_FACES, neighbours(mesh))
    doubled = _doubled_nodes(mesh.cells)
    # all faces of a tetrahedron that is listed twice are wrong, so a mesh without wrong faces has none
    repeated = _repeated(mesh.cells) if wrong.any() else np.zeros(0, np.int64)
    corners = mesh.points[mesh.cells[repeated[:PLACES]]]
    return (
        Flaw("tetrahedra_with_doubled_nodes", len(doubled), mesh.points[mesh.cells[doubled[:PLACES], 0]]),
        Flaw("repeated_tetrahedra", len(repeated), corners.mean(axis=1)),
        _wrong_faces(mesh, wrong == _OVERFULL, "overfull_faces"),
        _wrong_faces(mesh, wrong == _FOLDED, "folded_faces"),
        *_inside_others(mesh),
        _nodes_at_one_place(mesh.points),
    )


def broken_body(mesh: TetMesh) -> list[str]:
    """Reasons, in plain words, why tetrahedra fill no bodies that a solver can run on; empty if they do.

    Parameters
    ----------
    mesh : all its indices are valid; it may consist of several bodies that do not touch
    """
    return [flaw.sentence for flaw in (*flaws(mesh), *_touching(mesh)) if flaw.count]


def require_body(mesh: TetMesh, file: object = None) -> None:
    """Raise InputError if tetrahedra fill no bodies that a solver can run on.

    Parameters
    ----------
    file : the file that the mesh was read from; the message names it
    """
    broken = broken_body(mesh)
    if unused := len(mesh.points) - len(used_vertices(mesh.cells, len(mesh.points))):
        broken.append(f"{counted(unused, 'node belongs', 'nodes belong')} to no tetrahedron")
    if broken:
        raise InputError(
            f"the tetrahedra form no valid solid: {'; '.join(broken)}",
            file=file,
            remedy="repair it in the program that made the mesh",
        )


@OncePerCells
def folded_faces(mesh: TetMesh) -> int:
    """Number of faces with both their tetrahedra on one side; a mesh that fills space once has none.

    All volumes must be positive: then connectivity alone decides.
    """
    return int(np.count_nonzero(wrong_faces(mesh.points, mesh.cells, TET_FACES, neighbours(mesh)) == _FOLDED))


def _wrong_faces(mesh: TetMesh, flagged: NDArray[np.bool_], which: str) -> Flaw:
    """The flaw of flagged faces; each face counts once, however many tetrahedra flag it."""
    cell, corner = np.nonzero(flagged)
    faces = mesh.cells[cell[:, None], TET_FACES[corner]]
    first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    return Flaw(which, len(first), mesh.points[faces[np.sort(first)[:PLACES]]].mean(axis=1))


def _doubled_nodes(cells: IntArray) -> NDArray[np.int64]:
    """Tetrahedra that name a node twice."""
    a, b, c, d = cells.T
    return np.flatnonzero((a == b) | (a == c) | (a == d) | (b == c) | (b == d) | (c == d))


def _repeated(cells: IntArray) -> NDArray[np.int64]:
    """Tetrahedra whose four nodes are those of an earlier one."""
    first = np.unique(np.sort(cells, axis=1), axis=0, return_index=True)[1]
    return np.setdiff1d(np.arange(len(cells)), first)


def _inside_others(mesh: TetMesh) -> tuple[Flaw, ...]:
    """Parts of the boundary that enclose voids, and bodies that overlap others; none if the boundary is one part.

    The boundary of a void faces inward; that of a closed slit encloses nothing. Where bodies overlap, the boundary
    winds more than once around a point.
    """
    surface, _ = boundary_surface(mesh)
    number, part = np.unique(component_labels(surface.faces)[surface.faces[:, 0]], return_inverse=True)
    if len(number) < 2 or not np.isfinite(mesh.points).all():
        return Flaw(VOIDS, 0, np.zeros((0, 3))), Flaw(OVERLAPPING, 0, np.zeros((0, 3)))
    a, b, c = (surface.points - surface.points.mean(axis=0))[surface.faces].transpose(1, 0, 2)
    volumes = np.bincount(part, np.einsum("ij,ij->i", a, np.cross(b, c)))
    walls = np.flatnonzero(~(volumes > _NO_VOLUME * np.abs(volumes.sum())))
    behind = mesh.points[mesh.cells[boundary(mesh).cells]].mean(axis=1)
    overlapping = np.unique(part[winding_numbers(surface, behind) > _TWICE])
    centres = surface.points[surface.faces].mean(axis=1)
    return tuple(
        Flaw(which, len(found), np.array([centres[part == one].mean(axis=0) for one in found[:PLACES]]).reshape(-1, 3))
        for which, found in ((VOIDS, walls), (OVERLAPPING, overlapping))
    )


def _nodes_at_one_place(points: FloatArray) -> Flaw:
    order = np.lexsort(points.T)
    again = order[1:][(points[order[1:]] == points[order[:-1]]).all(axis=1)]
    return Flaw("coincident_nodes", len(again), points[np.sort(again)[:PLACES]])


def _touching(mesh: TetMesh) -> Iterator[Flaw]:
    """Edges and nodes at which parts of the boundary touch: hinges, however good the elements are."""
    boundary, _ = boundary_surface(mesh)
    topology = surface_topology(boundary.faces)
    if topology.nonmanifold_edges or topology.pinched_vertices:
        places = boundary.points[defective_vertices(boundary.faces)[:PLACES]]
        yield Flaw("nonmanifold_edges", topology.nonmanifold_edges, places)
        yield Flaw("pinched_vertices", topology.pinched_vertices, places)
