"""S1: fill a closed surface with tetrahedra by one of the meshers, and by the fallback if its topology is wrong."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from cortet.errors import InputError
from cortet.geometry.limits import CELL_SIZE_MM, require_within
from cortet.meshers import MESHERS, OWN, Mesher
from cortet.meshers.cgal import installed_backend
from cortet.meshers.mesher import Attempt, Refinement, Settings
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.sections import AsList, CellSize, Cost, Fraction, NonNegativeInt, Positive, Section
from cortet.stages.stage import Certificate, Stage, counted

if TYPE_CHECKING:
    MesherName = str
    Fallback = str
else:  # the names of all meshers, and of those that always keep the topology
    MesherName = Literal[tuple(MESHERS)]
    Fallback = Literal[tuple(name for name, mesher in OWN.items() if not mesher.may_change_topology)]

VERSION: int = 11

logger = logging.getLogger(__name__)


class Generate(Section):
    """S1: tetrahedra inside the surface."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"cell_size", "meshers"}

    cell_size: Annotated[list[CellSize], AsList, Field(min_length=1)] = [0.6]
    """Cell size h, mm, a multiple of 0.001: bound of circumradius and surface ball. A list makes one mesh per size."""
    meshers: Annotated[list[MesherName], AsList, Field(min_length=1)] = ["lattice"]
    """Meshers: lattice (ours: better elements, ten times faster), cgal (published), or with its own defaults one of
    tetgen, ftetwild, gmsh and netgen. Every stage after S1 is the same for all of them."""
    backend: Literal["auto", "pygalmesh", "cgal"] = "auto"
    """Package that runs CGAL: pygalmesh (compiled from source), cgal (wheel), auto: pygalmesh where installed."""
    facet_angle: Annotated[float, Field(gt=0, le=30)] = 25.0
    """Smallest angle of a boundary triangle, degrees; refinement ends for certain only up to 30."""
    facet_distance: Annotated[list[Fraction], AsList, Field(min_length=1)] = [0.5, 0.2, 0.1, 0.05]
    """Distance of a boundary triangle's circumcentre to that of its surface ball, as fractions of h, tried in this
    order until the boundary is a closed manifold of the input's genus: narrow sulci fuse when it is too large."""
    radius_edge_ratio: Positive = 2.0
    """Largest ratio of circumradius to shortest edge."""
    odt: bool = True
    """Optimal Delaunay triangulation smoothing."""
    lloyd: bool = True
    """Lloyd smoothing."""
    perturb: bool = True
    """Vertex perturbation against slivers."""
    exude: bool = True
    """Sliver exudation, last."""
    seed: NonNegativeInt = 0
    """Seed of CGAL's random numbers, and of the direction in which the surface is meshed (0: as it stands)."""
    fallback: Fallback | None = "lattice"
    """Mesher to take where no facet distance gives the right topology; null: none."""
    edge_length: Annotated[list[Positive], AsList, Field(min_length=1)] = [
        1.25,
        1.2,
        1.15,
        1.1,
        1.0,
        0.9,
        0.8,
        0.7,
        0.6,
    ]
    """lattice: edges of the boundary triangles, as fractions of h, tried in this order until no triangles cross."""
    surface_distance: Annotated[float, Field(gt=0, le=1)] = 0.4
    """lattice: largest distance of the surface to the boundary triangles, a fraction of h; edges get shorter where it
    takes that. S4 and S4+ slide the boundary and may add 0.07 h."""
    core_ratio: Annotated[float, Field(ge=1, le=8)] = 1.0
    """lattice: how many times larger cells are in the core; the cortex keeps h."""
    core_depth: Positive = 6.0
    """lattice: depth below the surface where the core begins, mm."""
    size_field: str | None = None
    """lattice: field of the surface that says the cell size at each vertex, mm, where it is to be smaller than h (down
    to 0.35 h); cells grow to h away from there."""

    sizes: dict[str, Positive | None] = {}
    """lattice: cell sizes, mm, at the surface of a region or inside labels of a volume, where they are to be smaller
    than h (down to 0.35 h): {white: 0.5, dseg.nii.gz:thalamus: 0.4}; {sizes.nii.gz: null} takes them from the voxels.
    Volumes for `cortet mesh` alone; cells grow to h away from there."""

    def excludes_inner_surfaces(self) -> str:
        """Not all meshers fill several regions."""
        able = all(MESHERS[name].regions for name in self.meshers)
        return "" if able else f"generate.meshers: {', '.join(self.meshers)}"


DEFAULT = Generate()


@dataclass(frozen=True)
class GenerateReport:
    """What was run, and the result; the certificate refuses a mesh whose `topology_ok` is False."""

    mesher: str
    backend: str
    backend_version: str
    #: of the direction in which the surface was meshed
    seed: int
    cell_size_mm: float
    #: None if the boundary was given
    facet_distance_mm: float | None
    facet_distance_fraction: float | None
    #: None if CGAL made the boundary
    edge_length_mm: float | None
    #: likewise
    refinement: Refinement | None
    passes: tuple[str, ...]
    nodes: int
    tetrahedra: int
    flat_tetrahedra_dropped: int
    topology_ok: bool
    #: why `topology_ok` is False; empty otherwise
    reason: str
    attempts: tuple[Attempt, ...]


def generate(
    surface: TriSurface,
    *,
    cell_size: float,
    mesher: str = DEFAULT.meshers[0],
    backend: str = DEFAULT.backend,
    facet_angle: float = DEFAULT.facet_angle,
    facet_distance: Sequence[float] = DEFAULT.facet_distance,
    radius_edge_ratio: float = DEFAULT.radius_edge_ratio,
    odt: bool = DEFAULT.odt,
    lloyd: bool = DEFAULT.lloyd,
    perturb: bool = DEFAULT.perturb,
    exude: bool = DEFAULT.exude,
    seed: int = DEFAULT.seed,
    fallback: str | None = DEFAULT.fallback,
    edge_length: Sequence[float] = DEFAULT.edge_length,
    surface_distance: float = DEFAULT.surface_distance,
    core_ratio: float = DEFAULT.core_ratio,
    core_depth: float = DEFAULT.core_depth,
    size_field: str | None = DEFAULT.size_field,
    sizes: Mapping[str, float | None] | None = None,
    elements_across: int = 1,
    time_limit: float | None = None,
) -> tuple[TetMesh, GenerateReport]:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    surface : a closed, connected manifold of any genus, without self-intersections; its inner surfaces, which keep
        apart from it and from each other, bound separate regions, the mesh's cell data `region`
    cell_size : mm, upper bound of circumradii of tetrahedra and of surface Delaunay balls
    mesher : a key of `meshers.MESHERS`; those of other projects take the cell size and nothing else
    backend : ``pygalmesh``, ``cgal``, or ``auto``: pygalmesh if it is installed, else cgal
    facet_angle : degrees, lower bound of the angles of boundary triangles
    facet_distance : fractions of `cell_size`, tried in this order until the boundary has the topology of the surface;
        upper bound of the distance between the circumcentre of a boundary triangle and the centre of its surface ball
    radius_edge_ratio : upper bound of circumradius over shortest edge of tetrahedra
    odt, lloyd, perturb, exude : CGAL's optimisation passes
    seed : of CGAL's random numbers, pygalmesh only; and of the direction in which the surface is meshed, 0: as it
        stands. CGAL's numbers alone make the same mesh nearly always
    fallback : mesher to try if no facet distance gives the topology of the surface; None (published): none
    edge_length : of the boundary triangles of ``lattice``, as fractions of `cell_size`, tried in this order until no
        two of them cross
    surface_distance : largest distance of the surface to the boundary triangles of ``lattice``, as a fraction of
        `cell_size`; later stages, which slide them, add to it
    core_ratio : of the cell sizes of core and cortex, ``lattice`` only
    core_depth : mm below the surface where the core begins
    size_field : field of `surface` or its inner surfaces, (n,) mm per vertex: cell size there, if it is smaller than
        `cell_size`, graded inward; ``lattice`` only
    sizes : region -> mm at its surface, or volume -> mm inside its labels (`FILE:5,6`), or None for the values of its
        voxels (`FILE`): cell size there, where it is smaller, graded from there; ``lattice`` only
    elements_across : least number of tetrahedra between `surface` and those inside it; edges become shorter for this,
        down to `meshers._remesh.SHORTEST` of their length elsewhere
    time_limit : minutes that a mesher of another project may take; None for no limit

    Returns
    -------
    The mesh, even if no facet distance gives the topology of the surface: then the report says so.

    Raises
    ------
    InputError
        the surface is not one closed manifold, or a parameter is out of range
    StageError
        the backend failed, is not installed, or returned nothing
    """
    from cortet.formats.placement import require_precision
    from cortet.geometry.orientation import random_rotation
    from cortet.meshers._sizes import checked

    if unknown := {mesher, fallback} - {None, *MESHERS}:
        raise InputError(f"unknown mesher {unknown.pop()!r}", remedy=f"use {' or '.join(MESHERS)}")
    if not cell_size > 0 or not np.isfinite(cell_size):
        raise InputError(f"cell size {cell_size} mm is not a positive length")
    require_within(cell_size, CELL_SIZE_MM, "the cell size in mm")
    require_precision(surface.points, cell_size)
    if not facet_distance or min(facet_distance) <= 0:
        raise InputError(f"facet distances {list(facet_distance)} are not positive fractions of the cell size")
    if not edge_length or min(edge_length) <= 0:
        raise InputError(f"edge lengths {list(edge_length)} are not positive fractions of the cell size")
    _require_meshable(surface, MESHERS[mesher], size_field, sizes)
    sources, _ = checked(sizes or {}, surface, cell_size)
    chosen = {"odt": odt, "lloyd": lloyd, "perturb": perturb, "exude": exude}
    settings = Settings(
        cell_size=cell_size,
        backend=backend,
        facet_angle=facet_angle,
        facet_distance=facet_distance,
        radius_edge_ratio=radius_edge_ratio,
        passes=tuple(name for name, runs in chosen.items() if runs),
        seed=seed if MESHERS[mesher].own else 0,
        fallback=fallback,
        edge_length=edge_length,
        surface_distance=surface_distance,
        core_ratio=core_ratio,
        core_depth=core_depth,
        size_field=size_field,
        sizes=sizes or {},
        sources=sources,
        elements_across=elements_across,
        time_limit=time_limit,
    )
    turn = random_rotation(settings.seed)
    if settings.seed:
        surface = _turned(surface, turn)
        settings = replace(settings, sources=settings.sources._replace(points=settings.sources.points @ turn))
    filled = MESHERS[mesher].fill(surface, settings)
    if MESHERS[mesher].may_change_topology and filled.attempts[-1].problems and fallback:
        again = MESHERS[fallback].fill(surface, settings)
        filled = replace(again, attempts=filled.attempts + again.attempts)
    mesh, final = filled.mesh, filled.attempts[-1]
    if settings.seed:
        mesh = replace(mesh, points=mesh.points @ turn.T)
    return mesh, GenerateReport(
        mesher=mesher,
        backend=filled.backend,
        backend_version=version(filled.backend),
        seed=settings.seed,
        cell_size_mm=cell_size,
        facet_distance_mm=final.facet_distance_mm,
        facet_distance_fraction=None if final.facet_distance_mm is None else final.facet_distance_mm / cell_size,
        edge_length_mm=final.edge_length_mm,
        refinement=final.refinement,
        passes=filled.passes,
        nodes=len(mesh.points),
        tetrahedra=len(mesh.cells),
        flat_tetrahedra_dropped=final.flat_tetrahedra_dropped,
        topology_ok=not final.problems,
        reason="; ".join(final.problems),
        attempts=filled.attempts,
    )


def _require_meshable(
    surface: TriSurface, mesher: Mesher, size_field: str | None, sizes: Mapping[str, float | None] | None
) -> None:
    """Refuse a surface that is no closed manifold, and settings that this mesher does not support."""
    from cortet.geometry.topology import surface_topology

    topology = surface_topology(surface.faces)
    if not topology.is_closed_manifold:
        raise InputError(f"surface cannot be meshed: {'; '.join(topology.problems(int(topology.genus)))}")
    for asked, able, what in (
        (size_field is not None, "sizes", "generate.size_field"),
        (bool(sizes), "sizes", "generate.sizes"),
        (bool(surface.inner), "regions", "inner surfaces"),
    ):
        if asked and not getattr(mesher, able):
            others = " or ".join(name for name, other in MESHERS.items() if getattr(other, able))
            raise InputError(f"the mesher {mesher.name} knows no {what}", remedy=f"use the mesher {others}")


def _turned(surface: TriSurface, turn: FloatArray) -> TriSurface:
    """A surface and its inner surfaces, rotated."""
    inner = {name: replace(one, points=one.points @ turn) for name, one in surface.inner.items()}
    return replace(surface, points=surface.points @ turn, inner=inner)


def _settled(values: dict[str, Any], config: Any, facts: Mapping[str, Any]) -> dict[str, Any]:
    """One backend for all meshes of a cohort; cells across the cortex only if there is an inner surface."""
    if values["backend"] == "auto":
        values = {**values, "backend": installed_backend()}
    return {**values, "elements_across": config.regions.elements_across} if facts.get("nested") else values


def _sentence(certificates: Sequence[Certificate]) -> str:
    every = [content["parameters"]["generate"] for content in certificates]
    sizes = " and ".join(f"{size:g}" for size in sorted({done["cell_size"] for done in every}))
    backends = [content["reports"]["generate"]["backend"] for content in certificates]
    ways = []
    for (name, backend), count in sorted(Counter(zip((d["mesher"] for d in every), backends, strict=True)).items()):
        mesher, meshes = MESHERS[name], counted(count, "mesh")
        if mesher.may_change_topology and backend not in ("pygalmesh", "cgal"):
            fallback = every[0]["fallback"]
            ways.append(f"the fallback {fallback}, where CGAL's boundary had another topology ({count})")
        else:
            ways.append(mesher.said(every[0], backend, name, meshes))
    return f"They were filled with tetrahedra of cell size h = {sizes} mm by {' and '.join(ways)}."


STAGE = Stage(
    name="generate",
    order=60,
    does="fills the surface with tetrahedra",
    label="Generated",
    takes=("surface",),
    gives="mesh",
    number="S1",
    parameters=Generate,
    facts=("cell_size", "mesher"),
    settle=_settled,
    cost=Cost((330, 550), (5, 370)),
    sentence=_sentence,
    shared_by_settings=True,
)
