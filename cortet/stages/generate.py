"""S1: fill a closed surface with tetrahedra.

There are two meshers of our own line. `cgal` is the published one (`cortet.meshers.cgal`). Its refinement decides the
topology: with a coarse facet distance the two banks of a narrow sulcus pinch or fuse, silently. So the boundary is
checked after refinement, before the slow passes, and again after them; when its topology is not that of the input, the
facet distance (nothing else) is tightened. On surfaces with creases, or with banks closer than their own edges, no
distance helps; then the fallback is taken.

`lattice` remeshes the surface with triangles of one edge length, shorter where its shape asks for that, which keeps
its topology and leaves no point of it behind, and fills it with a body-centred cubic lattice (`cortet.meshers`). The
slivers between the two are reconnected at once, before anything moves. Where remeshed banks cross each other, the edges
are shortened, there first.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from cortet.errors import InputError, StageError
from cortet.geometry.filling import folded_faces
from cortet.geometry.limits import CELL_SIZE_MM, require_within
from cortet.geometry.nesting import joined, sheets
from cortet.geometry.ordering import ordered_along_curve
from cortet.geometry.topology import (
    SurfaceTopology,
    boundary_faces,
    compact,
    components,
    edges,
    enclosed_volume,
    sheet,
    surface_topology,
)
from cortet.measure.quality import signed_volumes
from cortet.mesh import REGION, FloatArray, IntArray, TetMesh, TriSurface
from cortet.meshers import BASELINES, MESHERS, baselines, cgal, installed_backend
from cortet.meshers.cgal import BACKENDS, PASSES, Criteria, write_off
from cortet.meshers.lattice import graded_nodes, tetrahedralised
from cortet.meshers.nested import regions_of, remesh_apart, wanted
from cortet.meshers.remesh import SHORTEST, Remeshed, shapes, unsound
from cortet.meshers.triangles import FLAT
from cortet.stages.reconnect import reconnect

VERSION: int = 8

#: share of the surface's volume below which a remeshed boundary is too coarse to stand for it
LEAST_VOLUME = 0.8
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Refinement:
    """Where the triangles of ``lattice`` are smaller than elsewhere, and how near the surface they are."""

    vertices: int
    #: vertices whose edges were to be shorter than elsewhere by more than a fifth
    vertices_refined: int
    shortest_edge_mm: float
    #: from the surface's vertices and face centres to the triangles, before anything slides
    distance_mean_mm: float
    distance_max_mm: float
    #: remeshings in all; all but the last had triangles that cross
    rounds: int


@dataclass(frozen=True)
class Attempt:
    """One attempt to mesh the surface, and the topology of its result."""

    #: None where the boundary was given
    facet_distance_mm: float | None
    #: of the triangles the boundary was given as; None where CGAL made it
    edge_length_mm: float | None
    #: the passes that ran; none when only the refinement was tried
    passes: tuple[str, ...]
    nodes: int
    tetrahedra: int
    #: exactly flat tetrahedra that were left out
    flat_tetrahedra_dropped: int
    boundary: SurfaceTopology
    #: in plain words, what is wrong with the topology
    problems: tuple[str, ...]
    #: None where CGAL made the boundary, or it was given
    refinement: Refinement | None = None


@dataclass(frozen=True)
class GenerateReport:
    """What was run and what came of it; `topology_ok` False is for the certificate to refuse."""

    mesher: str
    backend: str
    backend_version: str
    #: of the direction in which the surface was meshed
    seed: int
    cell_size_mm: float
    #: None where the boundary was given
    facet_distance_mm: float | None
    facet_distance_fraction: float | None
    #: None where CGAL made the boundary
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
    mesher: str = "lattice",
    backend: str = "auto",
    facet_angle: float = 25.0,
    facet_distance: Sequence[float] = (0.5, 0.2, 0.1, 0.05),
    radius_edge_ratio: float = 2.0,
    odt: bool = True,
    lloyd: bool = True,
    perturb: bool = True,
    exude: bool = True,
    seed: int = 0,
    fallback: Literal["lattice"] | None = "lattice",
    edge_length: Sequence[float] = (1.25, 1.2, 1.15, 1.1, 1.0, 0.9, 0.8, 0.7, 0.6),
    surface_distance: float = 0.4,
    core_ratio: float = 1.0,
    core_depth: float = 6.0,
    size_field: str | None = None,
    elements_across: int = 1,
) -> tuple[TetMesh, GenerateReport]:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    surface : a closed, connected manifold of any genus, without self-intersections; its inner surfaces, which keep
        apart from it and from each other, bound regions of their own, the mesh's cell data `region`
    cell_size : mm, upper bound of circumradii of tetrahedra and of surface Delaunay balls
    mesher : ``lattice``, ``cgal``, or one of `meshers.BASELINES`, which take the cell size and nothing else
    backend : ``pygalmesh``, ``cgal``, or ``auto``: pygalmesh where it is installed, else cgal
    facet_angle : degrees, lower bound of the angles of boundary triangles
    facet_distance : fractions of `cell_size`, tried in this order until the boundary has the topology of the surface;
        upper bound of the distance between the circumcentre of a boundary triangle and the centre of its surface ball
    radius_edge_ratio : upper bound of circumradius over shortest edge of tetrahedra
    odt, lloyd, perturb, exude : CGAL's optimisation passes
    seed : of CGAL's random numbers, pygalmesh only; and of the direction in which the surface is meshed, 0: as it
        stands. CGAL's numbers alone make the same mesh nearly always
    fallback : what to try when no facet distance gives the topology of the surface; None (published) for nothing
    edge_length : of the boundary triangles of ``lattice``, as fractions of `cell_size`, tried in this order until no
        two of them cross
    surface_distance : largest distance of the surface to the boundary triangles of ``lattice``, as a fraction of
        `cell_size`; later stages, which slide them, add to it
    core_ratio : of the cell sizes of core and cortex, ``lattice`` only
    core_depth : mm below the surface where the core begins
    size_field : of `surface` or its inner ones, (n,) mm per vertex: cell size there, where it is smaller, graded from
        there inward; ``lattice`` only
    elements_across : tetrahedra between `surface` and those inside it, at least; edges become shorter for it, down to
        `SHORTEST` of what they are elsewhere

    Returns
    -------
    The mesh, also when no facet distance gives the topology of the surface: then the report says so.

    Raises
    ------
    InputError
        the surface is not one closed manifold, or a parameter is out of range
    StageError
        the backend failed, is not installed, or returned nothing
    """
    if mesher not in MESHERS | BASELINES:
        known = " or ".join(MESHERS | BASELINES)
        raise InputError(f"unknown mesher {mesher!r}", remedy=f"use {known}")
    if not cell_size > 0 or not np.isfinite(cell_size):
        raise InputError(f"cell size {cell_size} mm is not a positive length")
    require_within(cell_size, CELL_SIZE_MM, "the cell size in mm")
    if not facet_distance or min(facet_distance) <= 0:
        raise InputError(f"facet distances {list(facet_distance)} are not positive fractions of the cell size")
    if not edge_length or min(edge_length) <= 0:
        raise InputError(f"edge lengths {list(edge_length)} are not positive fractions of the cell size")
    topology = surface_topology(surface.faces)
    if not topology.is_closed_manifold:
        raise InputError(f"surface cannot be meshed: {'; '.join(topology.problems(int(topology.genus)))}")
    if size_field is not None and mesher != "lattice":
        raise InputError(f"the mesher {mesher} knows no generate.size_field", remedy="use the mesher lattice")
    if surface.inner and mesher != "lattice":
        raise InputError(f"the mesher {mesher} knows no inner surfaces", remedy="use the mesher lattice")
    if mesher in BASELINES:
        return generate_with_baseline(surface, mesher, cell_size=cell_size)
    backend = installed_backend() if backend == "auto" else backend
    if backend not in BACKENDS:
        raise InputError(f"unknown mesher backend {backend!r}", remedy=f"use auto, {' or '.join(BACKENDS)}")

    turn = _rotation(seed)
    if seed:
        surface = _turned(surface, turn)
    attempts: list[Attempt] = []
    if mesher == "cgal":
        chosen = {"odt": odt, "lloyd": lloyd, "perturb": perturb, "exude": exude}
        passes = tuple(name for name in PASSES if chosen[name])
        criteria = [
            Criteria(cell_size, facet_angle, fraction * cell_size, radius_edge_ratio) for fraction in facet_distance
        ]
        mesh, attempts = _refined(surface, backend, criteria, passes, seed=seed, last=fallback is None)
        if attempts[-1].problems:
            logger.warning("facet distances of %s h: %s", list(facet_distance), "; ".join(attempts[-1].problems))
    if mesher == "lattice" or (attempts[-1].problems and fallback):
        backend, passes = "tetgen", ()
        mesh, tried = _filled_with_lattice(
            surface,
            cell_size,
            edge_length,
            surface_distance,
            core_ratio=core_ratio,
            core_depth=core_depth,
            elements_across=elements_across,
            sizes=None if size_field is None else _sizes_of(surface, size_field, cell_size),
        )
        attempts += tried

    if seed:
        mesh = replace(mesh, points=mesh.points @ turn.T)
    final = attempts[-1]
    return mesh, GenerateReport(
        mesher=mesher,
        backend=backend,
        backend_version=version(backend),
        seed=seed,
        cell_size_mm=cell_size,
        facet_distance_mm=final.facet_distance_mm,
        facet_distance_fraction=None if final.facet_distance_mm is None else final.facet_distance_mm / cell_size,
        edge_length_mm=final.edge_length_mm,
        refinement=final.refinement,
        passes=passes,
        nodes=len(mesh.points),
        tetrahedra=len(mesh.cells),
        flat_tetrahedra_dropped=final.flat_tetrahedra_dropped,
        topology_ok=not final.problems,
        reason="; ".join(final.problems),
        attempts=tuple(attempts),
    )


def generate_with_baseline(
    surface: TriSurface, mesher: str, *, cell_size: float, time_limit: float | None = None
) -> tuple[TetMesh, GenerateReport]:
    """Mesh the inside of a closed surface with one of `meshers.BASELINES` and its own defaults.

    Exactly flat tetrahedra are left out. Raises `StageError` when there is no mesh, or one that overlaps itself, which
    no later stage could work on.
    """
    began = time.perf_counter()
    points, cells = baselines.fill(surface, mesher, cell_size=cell_size, time_limit=time_limit)
    mesh, flat = _well_ordered(points, cells)
    if folded := folded_faces(mesh):
        raise StageError(
            f"{mesher} returned tetrahedra that overlap: both those of {folded} faces are on one side of it"
        )
    genus = int(surface_topology(surface.faces).genus)
    attempt = _judged(mesh, genus, passes=(), flat=flat)
    _log(mesher, attempt, time.perf_counter() - began)
    distribution, _ = baselines.TOOLS[mesher]
    return mesh, GenerateReport(
        mesher=mesher,
        backend=distribution,
        backend_version=version(distribution),
        seed=0,
        cell_size_mm=cell_size,
        facet_distance_mm=None,
        facet_distance_fraction=None,
        edge_length_mm=None,
        refinement=None,
        passes=(),
        nodes=len(mesh.points),
        tetrahedra=len(mesh.cells),
        flat_tetrahedra_dropped=flat,
        topology_ok=not attempt.problems,
        reason="; ".join(attempt.problems),
        attempts=(attempt,),
    )


def _refined(
    surface: TriSurface,
    backend: str,
    criteria: Sequence[Criteria],
    passes: tuple[str, ...],
    *,
    seed: int,
    last: bool,
) -> tuple[TetMesh, list[Attempt]]:
    """Mesh by the first criteria that give the topology of the surface; `last`: nothing is tried after them."""
    genus = int(surface_topology(surface.faces).genus)
    attempts: list[Attempt] = []
    with TemporaryDirectory(prefix="cortet-generate-") as folder:
        off = Path(folder) / "surface.off"
        write_off(surface, off)
        for candidate in criteria:
            may_retry = bool(passes) and (candidate != criteria[-1] or not last)
            for trial in [(), passes] if may_retry else [passes]:
                mesh, attempt = _attempt(off, backend, candidate, trial, seed=seed, genus=genus)
                attempts.append(attempt)
                if attempt.problems:
                    break
            if not attempts[-1].problems:
                break
    return mesh, attempts


def _attempt(
    off: Path, backend: str, criteria: Criteria, passes: tuple[str, ...], *, seed: int, genus: int
) -> tuple[TetMesh, Attempt]:
    """Mesh once and compare the topology of the result with a surface of `genus` handles."""
    began = time.perf_counter()
    mesh, flat = _well_ordered(*cgal.fill(off, backend=backend, criteria=criteria, passes=passes, seed=seed))
    if flat:
        logger.warning("%d exactly flat tetrahedra left out", flat)
    what = f"{backend}, facet distance {criteria.facet_distance:g} mm, {', '.join(('refinement', *passes))}"
    attempt = _judged(mesh, genus, facet_distance=criteria.facet_distance, passes=passes, flat=flat)
    _log(what, attempt, time.perf_counter() - began)
    return mesh, attempt


def _rotation(seed: int) -> FloatArray:
    """A rotation (3, 3), any of them equally likely (Mezzadri, Notices of the AMS 54, 2007)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def _turned(surface: TriSurface, turn: FloatArray) -> TriSurface:
    """A surface and those inside it, in other directions."""
    inner = {name: replace(one, points=one.points @ turn) for name, one in surface.inner.items()}
    return replace(surface, points=surface.points @ turn, inner=inner)


def _filled_with_lattice(
    surface: TriSurface,
    cell_size: float,
    edge_length: Sequence[float],
    surface_distance: float,
    *,
    core_ratio: float,
    core_depth: float,
    elements_across: int,
    sizes: Sequence[FloatArray] | None,
) -> tuple[TetMesh, list[Attempt]]:
    """Mesh by the longest edges with which no two triangles cross, of the boundary and of the surfaces inside it.

    Parameters
    ----------
    sizes : for each sheet (n,) mm, the cell size at its vertices, where that is smaller than `cell_size`

    Raises `StageError` when triangles cross with all edge lengths.
    """
    every = sheets(surface)
    genus = int(surface_topology(surface.faces).genus)
    attempts: list[Attempt] = []
    for fraction in edge_length:
        began = time.perf_counter()
        edge = fraction * cell_size
        longest = None if sizes is None else [fraction * size for size in sizes]
        made = remesh_apart(
            surface, wanted(surface, edge, surface_distance * cell_size, across=elements_across, longest=longest)
        )
        walls = [one.surface for one in made]
        if problem := _fault(walls, every):
            topology = surface_topology(walls[0].faces)
            attempt = Attempt(None, edge, (), sum(len(wall.points) for wall in walls), 0, 0, topology, (problem,))
        else:
            nodes = graded_nodes(
                walls[0],
                np.concatenate([one.size for one in made]),
                edge_length=edge,
                cell_size=cell_size,
                core_ratio=core_ratio,
                core_depth=core_depth,
                walls=joined(walls),
                plateau=elements_across / 2 if elements_across > 1 else 0,  # from both sides to the middle
            )
            points, cells = tetrahedralised(joined(walls), nodes)
            region = regions_of(points, cells, walls) if surface.inner else None
            mesh, flat = _well_ordered(points, cells, region)
            mesh, _ = reconnect(mesh, surface, insert=False, cell_size=cell_size)
            attempt = _judged(mesh, genus, edge_length=edge, passes=(), flat=flat)
            attempt = replace(attempt, problems=attempt.problems + _interface_problems(mesh, surface))
        attempts.append(replace(attempt, refinement=_refinement(made)))
        _log(f"lattice, edges of {edge:g} mm", attempt, time.perf_counter() - began)
        if not attempt.problems:
            return mesh, attempts
    remedy = "choose a smaller cell size, add a smaller generate.edge_length, or "
    raise StageError(
        f"no edge length of {list(edge_length)} h gives a boundary to fill: {'; '.join(attempts[-1].problems)}",
        remedy=remedy + ("take a larger regions.min_gap" if surface.inner else "smooth the surface there"),
    )


def _sizes_of(surface: TriSurface, name: str, cell_size: float) -> list[FloatArray]:
    """Values of a field of sizes on each sheet, (n,) mm; infinite on one that has none."""
    every = sheets(surface)
    if not any(name in one.point_data for one in every):
        known = ", ".join(surface.point_data) or "none"
        raise InputError(
            f"generate.size_field: the surface has no field {name} (it has: {known})",
            remedy="name a field of the surface, or give it: `--field NAME=FILE`, in a sheet `cohort.fields`",
        )
    found = []
    for one in every:
        values = np.asarray(one.point_data.get(name, np.full(len(one.points), np.inf)), np.float64)
        least = SHORTEST * cell_size
        bad = ~(values >= least) if values.ndim == 1 else np.ones(1, np.bool_)
        if bad.any():
            what = f"{np.count_nonzero(bad)} values that are no cell size of at least {least:g} mm ({SHORTEST:g} h)"
            shown = f", the first {values[bad.argmax()]} at vertex {bad.argmax()}"
            raise InputError(
                f"generate.size_field: {name} has {what}{shown}",
                remedy="give one size in mm per vertex; where finer cells are wanted, choose a smaller cell size",
            )
        found.append(values)
    return found


def _interface_problems(mesh: TetMesh, surface: TriSurface) -> tuple[str, ...]:
    """In plain words, where an interface has not the topology of its surface."""
    found = []
    for number, (name, one) in enumerate(surface.inner.items(), start=1):
        genus = int(surface_topology(one.faces).genus)
        found += [f"{name}: {what}" for what in surface_topology(sheet(mesh, number)[0].faces).problems(genus)]
    return tuple(found)


def _refinement(made: Sequence[Remeshed]) -> Refinement:
    both = joined([one.surface for one in made])
    size, distances = (np.concatenate([getattr(one, name) for one in made]) for name in ("size", "distances"))
    start, end = edges(both.faces).T
    return Refinement(
        vertices=len(both.points),
        vertices_refined=int((size < 0.8 * size.max()).sum()),
        shortest_edge_mm=float(np.linalg.norm(both.points[start] - both.points[end], axis=1).min()),
        distance_mean_mm=float(distances.mean()),
        distance_max_mm=float(distances.max()),
        rounds=made[0].rounds,
    )


def _fault(walls: Sequence[TriSurface], every: Sequence[TriSurface]) -> str:
    """Why remeshed surfaces cannot be filled, or nothing; `every` holds the given ones."""
    both = joined(walls)
    unusable = unsound(both)
    if len(unusable):
        flat = shapes(both)[unusable] < FLAT
        counts = {"cross": np.count_nonzero(~flat), "are flat": np.count_nonzero(flat)}
        what = " and ".join(f"{count} boundary triangles {fault}" for fault, count in counts.items() if count)
        x, y, z = both.points[both.faces[unusable[0]]].mean(axis=0)
        return f"{what}, the first at ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    for wall, one in zip(walls, every, strict=True):
        share = enclosed_volume(wall.points, wall.faces) / enclosed_volume(one.points, one.faces)
        if share < LEAST_VOLUME:
            return f"the remeshed boundary encloses {100 * share:.0f} % of the volume"
    return ""


def _log(what: str, attempt: Attempt, seconds: float) -> None:
    found = "; ".join(attempt.problems) or "topology of the surface"
    logger.info("%s: %d nodes, %d tetrahedra, %s, %.1f s", what, attempt.nodes, attempt.tetrahedra, found, seconds)


def _judged(
    mesh: TetMesh,
    genus: int,
    *,
    facet_distance: float | None = None,
    edge_length: float | None = None,
    passes: tuple[str, ...],
    flat: int,
) -> Attempt:
    """Compare the topology of a mesh with a surface of `genus` handles."""
    boundary = surface_topology(boundary_faces(mesh))
    problems = boundary.problems(genus)
    if (bodies := components(mesh.cells)) != 1:
        problems.append(f"{bodies} bodies instead of one")
    return Attempt(
        facet_distance_mm=facet_distance,
        edge_length_mm=edge_length,
        passes=passes,
        nodes=len(mesh.points),
        tetrahedra=len(mesh.cells),
        flat_tetrahedra_dropped=flat,
        boundary=boundary,
        problems=tuple(problems),
    )


def _well_ordered(points: FloatArray, cells: IntArray, region: IntArray | None = None) -> tuple[TetMesh, int]:
    """Tetrahedra of a mesher with positive volumes, numbered along a curve; and how many flat ones were left out.

    Parameters
    ----------
    region : (m,) of the tetrahedra, where there are several
    """
    kept = signed_volumes(points, cells) != 0
    cells, flat = oriented(points, cells)
    points, cells, _ = compact(points, cells)
    points, cells, order = ordered_along_curve(points, cells)
    return TetMesh(points, cells, cell_data={} if region is None else {REGION: region[kept][order]}), flat


def oriented(points: FloatArray, cells: IntArray) -> tuple[IntArray, int]:
    """Tetrahedra reordered to positive volume, without the exactly flat ones, whose number is returned too."""
    volumes = signed_volumes(points, cells)
    cells = np.where((volumes < 0)[:, None], cells[:, [0, 1, 3, 2]], cells)
    return cells[volumes != 0], int((volumes == 0).sum())
