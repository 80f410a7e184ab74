"""What a mesher declares in its module: what it takes, what it returns, and what others need to know about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cortet.meshes import FloatArray, TetMesh, TriSurface

if TYPE_CHECKING:
    from cortet.config.stages import Generate
    from cortet.geometry.topology import SurfaceTopology


class Facts(NamedTuple):
    """What differs from mesh to mesh, beside the section `generate`."""

    #: mm
    cell_size: float
    #: least number of tetrahedra between the surface and those inside it
    elements_across: int
    #: minutes that a mesher of another project may take; None: no limit
    time_limit: float | None
    #: (k, 4) mm, locations and radii of contacts of electrodes, around which cells become smaller
    contacts: FloatArray = np.zeros((0, 4))


@dataclass(frozen=True)
class Refinement:
    """Where the triangles of ``lattice`` are smaller than elsewhere, and how near the surface they are."""

    vertices: int
    #: vertices whose target edges were shorter than elsewhere by more than a fifth
    vertices_refined: int
    shortest_edge_mm: float
    #: from the surface's vertices and face centres to the triangles, before anything slides
    distance_mean_mm: float
    distance_max_mm: float
    #: total number of remeshings; all but the last had crossing triangles
    rounds: int


@dataclass(frozen=True)
class Attempt:
    """One attempt to mesh the surface, and the topology of its result."""

    #: None if the boundary was given
    facet_distance_mm: float | None
    #: of the triangles in which the boundary was given; None if CGAL made it
    edge_length_mm: float | None
    #: the passes that ran; none when only the refinement was tried
    passes: tuple[str, ...]
    nodes: int
    tetrahedra: int
    #: number of exactly flat tetrahedra that were dropped
    flat_tetrahedra_dropped: int
    boundary: SurfaceTopology
    #: in plain words, what is wrong with the topology
    problems: tuple[str, ...]
    #: None if CGAL made the boundary, or if it was given
    refinement: Refinement | None = None


@dataclass(frozen=True)
class Filled:
    """What a mesher made from a surface."""

    #: of the last attempt; positive volumes, nodes in curve order (`meshers._filled.well_ordered`)
    mesh: TetMesh
    #: at least one; the last says what is wrong with the topology of `mesh`, if anything is
    attempts: tuple[Attempt, ...]
    #: distribution on PyPI that made it
    backend: str
    #: optimisation passes that were requested
    passes: tuple[str, ...] = ()


#: keys of the section `generate` that only CGAL reads
OF_CGAL = frozenset(
    ("backend", "facet_angle", "facet_distance", "radius_edge_ratio", "odt", "lloyd", "perturb", "exude", "fallback")
)


def _no_notice(_: Generate) -> str:
    return ""


def _named(_parameters: Mapping[str, Any], _backend: str, mesher: str, meshes: str) -> str:
    return f"the mesher {mesher} ({meshes})"


@dataclass(frozen=True, kw_only=True)
class Mesher:
    """One way to fill a closed surface with tetrahedra."""

    name: str
    #: its name in tables
    printed: str
    #: fills a closed, connected manifold without self-intersections; raises StageError if it cannot
    fill: Callable[[TriSurface, Generate, Facts], Filled]
    #: tetrahedra per cube of the cell size, as measured
    tets_per_cube: float = 4.2
    #: whether it belongs to the line; others run with their own defaults, for comparison
    own: bool = True
    #: keys of the section `generate` that change nothing about its meshes, so that records of these do not have them
    ignores: frozenset[str] = frozenset()
    #: whether it fills the regions between inner surfaces
    regions: bool = False
    #: whether it takes a field of cell sizes
    sizes: bool = False
    #: whether the topology of its boundary may differ from that of the surface, so that a fallback is tried
    may_change_topology: bool = False
    #: what a user should know before it runs; "" for nothing
    notice: Callable[[Generate], str] = _no_notice
    #: what the methods paragraph says about it, from its parameters, the backend, its name and the counted meshes
    said: Callable[[Mapping[str, Any], str, str, str], str] = _named
