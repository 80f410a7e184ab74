"""S1: fill a closed surface with tetrahedra by one of the meshers, and by the fallback if its topology is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.geometry.limits import CELL_SIZE_MM, require_within
from cortet.geometry.orientation import random_rotation
from cortet.geometry.topology import surface_topology
from cortet.meshers import MESHERS, Mesher
from cortet.meshers._sizes import require_sizes
from cortet.meshers.mesher import Attempt, Facts, Refinement
from cortet.meshes import FloatArray, TetMesh, TriSurface

VERSION: int = 18


@dataclass(frozen=True)
class GenerateReport:
    """What was run, and the result; the certificate refuses a mesh whose `topology_ok` is False."""

    mesher: str
    backend: str
    #: of the direction in which the surface was meshed
    seed: int
    cell_size_mm: float
    #: None if the boundary was given
    facet_distance_mm: float | None
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
    settings: Generate = Generate(),
    *,
    cell_size: float | None = None,
    mesher: str | None = None,
    elements_across: int = 1,
    time_limit: float | None = None,
    contacts: Sequence[tuple[float, float, float, float]] = (),
) -> tuple[TetMesh, GenerateReport]:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    surface : a closed, connected manifold of any genus, without self-intersections; its inner surfaces, which keep
        apart from it and from each other, bound separate regions, the mesh's cell data `region`
    settings : as `Generate` describes them
    cell_size : mm, upper bound of circumradii of tetrahedra and of surface Delaunay balls; None: the first of
        `settings`
    mesher : a key of `meshers.MESHERS`; those of other projects take the cell size and nothing else; None: the first of
        `settings`
    elements_across : number of tetrahedra between `surface` and those inside it; edges become shorter for this,
        down to `meshers._remesh.SHORTEST` of their length elsewhere
    time_limit : minutes that a mesher of another project may take; None for no limit
    contacts : location and radius, mm, of contacts of electrodes: where the mesher takes sizes, cells around each
        become smaller, down to a third of its radius or `meshers._remesh.SHORTEST` of the cell size

    Returns
    -------
    The mesh, even if no facet distance gives the topology of the surface: then the report says so.

    Raises
    ------
    InputError
        the surface is not one closed manifold, or the cell size or the mesher is not supported
    StageError
        the backend failed, is not installed, or returned nothing
    """
    cell_size = settings.cell_size[0] if cell_size is None else cell_size
    mesher = settings.meshers[0] if mesher is None else mesher
    if mesher not in MESHERS:
        raise InputError(f"unknown mesher {mesher!r}", remedy=f"use {' or '.join(MESHERS)}")
    require_within(cell_size, CELL_SIZE_MM, "the cell size in mm")
    chosen = MESHERS[mesher]
    _require_meshable(surface, chosen, settings)
    require_sizes(settings.sizes, surface, cell_size)
    seed = settings.seed if chosen.own else 0
    turn = random_rotation(seed)
    if seed:
        surface = _turned(surface, turn)
    around = np.array(contacts).reshape(-1, 4)
    around[:, :3] = around[:, :3] @ turn if seed else around[:, :3]
    facts = Facts(cell_size, elements_across, time_limit, around)
    filled = chosen.fill(surface, settings, facts)
    if chosen.may_change_topology and filled.attempts[-1].problems and settings.fallback:
        again = MESHERS[settings.fallback].fill(surface, settings, facts)
        filled = replace(again, attempts=filled.attempts + again.attempts)
    mesh, final = filled.mesh, filled.attempts[-1]
    if seed:
        mesh = replace(mesh, points=mesh.points @ turn.T)
    return mesh, GenerateReport(
        mesher=mesher,
        backend=filled.backend,
        seed=seed,
        cell_size_mm=cell_size,
        facet_distance_mm=final.facet_distance_mm,
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


def _require_meshable(surface: TriSurface, mesher: Mesher, settings: Generate) -> None:
    """Refuse a surface that is not a closed manifold, and settings that this mesher does not support."""
    topology = surface_topology(surface.faces)
    if not topology.is_closed_manifold:
        raise InputError(f"surface cannot be meshed: {'; '.join(topology.problems(int(topology.genus)))}")
    for asked, able, what in (
        (settings.size_field is not None, "sizes", "generate.size_field"),
        (bool(settings.sizes), "sizes", "generate.sizes"),
        (bool(surface.inner), "regions", "inner surfaces"),
    ):
        if asked and not getattr(mesher, able):
            others = " or ".join(name for name, other in MESHERS.items() if getattr(other, able))
            raise InputError(f"the mesher {mesher.name} does not support {what}", remedy=f"use the mesher {others}")


def _turned(surface: TriSurface, turn: FloatArray) -> TriSurface:
    """A surface and its inner surfaces, rotated."""
    inner = {name: replace(one, points=one.points @ turn) for name, one in surface.inner.items()}
    return replace(surface, points=surface.points @ turn, inner=inner)
