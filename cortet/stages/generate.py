"""S1: fill a closed surface with tetrahedra.

Two ways. `cgal` is the published one: Delaunay refinement and four optimisation passes (CGAL Mesh_3), by either of two
builds of the library: `pygalmesh` (CGAL 5, compiled from source, the published tool) and the `cgal` wheel (CGAL 6, no
compiling). Both read an OFF file and write a Medit file, with 17 significant digits. Refinement decides the topology.
With a coarse facet distance the two banks of a narrow sulcus pinch or fuse, silently, so the boundary is checked after
refinement, before the slow passes, and again after them; when its topology is not that of the input, the facet distance
(nothing else) is tightened. On surfaces with creases and banks closer than their own edges no distance helps; then the
other way is taken.

`lattice` remeshes the surface with triangles of one edge length, shorter where its shape asks for that, which keeps
its topology and leaves no point of it behind, and fills it with a body-centred cubic lattice (`cortet.meshers`). The
slivers between the two are reconnected at once, before anything moves. Where remeshed banks cross each other, the edges
are shortened, there first.

Reference: https://doc.cgal.org/latest/Mesh_3/index.html (criteria and passes).
"""

from __future__ import annotations

import ctypes
import importlib.util
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

import meshio
import numpy as np

from cortet.errors import InputError, StageError
from cortet.mesh import FloatArray, IntArray, TetMesh, TriSurface
from cortet.meshers.lattice import fill, graded_nodes
from cortet.meshers.remesh import Remeshed, remesh_apart, unsound, wanted
from cortet.ordering import ordered_along_curve
from cortet.quality import signed_volumes
from cortet.stages import baselines
from cortet.stages.reconnect import reconnect
from cortet.topology import (
    SurfaceTopology,
    boundary_faces,
    compact,
    components,
    edges,
    enclosed_volume,
    surface_topology,
)

VERSION: int = 4

MESHERS = ("cgal", "lattice")
#: CGAL's optimisation passes in the order it runs them; exude must be last, since moving a vertex undoes it
PASSES = ("odt", "lloyd", "perturb", "exude")
#: CGAL's own defaults for ODT and Lloyd, which the wheel wants spelled out
CONVERGENCE, FREEZE_BOUND = 0.02, 0.01
#: share of the surface's volume below which a remeshed boundary is too coarse to stand for it
LEAST_VOLUME = 0.8
#: "no limit" for the time limits, iteration limits and sliver bounds of CGAL's passes
NO_LIMIT = 0

#: time for the system to move this thread to an idle core before it is confined to where it is
_SETTLING_S = 0.05

logger = logging.getLogger(__name__)


class Criteria(NamedTuple):
    """What CGAL refines for; lengths in mm, the angle in degrees."""

    cell_size: float
    facet_angle: float
    facet_distance: float
    radius_edge_ratio: float


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
    """One meshing and the topology that came out of it."""

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
    #: None where the backend takes no seed
    seed: int | None
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
    mesher: str = "cgal",
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
) -> tuple[TetMesh, GenerateReport]:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    surface : a closed, connected manifold of any genus, without self-intersections
    cell_size : mm, upper bound of circumradii of tetrahedra and of surface Delaunay balls
    mesher : ``cgal``, ``lattice``, or one of `baselines.MESHERS`, which take the cell size and nothing else
    backend : ``pygalmesh``, ``cgal``, or ``auto``: pygalmesh where it is installed, else cgal
    facet_angle : degrees, lower bound of the angles of boundary triangles
    facet_distance : fractions of `cell_size`, tried in this order until the boundary has the topology of the surface;
        upper bound of the distance between the circumcentre of a boundary triangle and the centre of its surface ball
    radius_edge_ratio : upper bound of circumradius over shortest edge of tetrahedra
    odt, lloyd, perturb, exude : CGAL's optimisation passes
    seed : of CGAL's random numbers; pygalmesh only
    fallback : what to try when no facet distance gives the topology of the surface; None (published) for nothing
    edge_length : of the boundary triangles of ``lattice``, as fractions of `cell_size`, tried in this order until no
        two of them cross
    surface_distance : largest distance of the surface to the boundary triangles of ``lattice``, as a fraction of
        `cell_size`; later stages, which slide them, add to it
    core_ratio : of the cell sizes of core and cortex, ``lattice`` only
    core_depth : mm below the surface where the core begins

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
    if mesher not in (*MESHERS, *baselines.MESHERS):
        known = " or ".join([*MESHERS, *baselines.MESHERS])
        raise InputError(f"unknown mesher {mesher!r}", remedy=f"use {known}")
    if not cell_size > 0 or not np.isfinite(cell_size):
        raise InputError(f"cell size {cell_size} mm is not a positive length")
    if not facet_distance or min(facet_distance) <= 0:
        raise InputError(f"facet distances {list(facet_distance)} are not positive fractions of the cell size")
    if not edge_length or min(edge_length) <= 0:
        raise InputError(f"edge lengths {list(edge_length)} are not positive fractions of the cell size")
    topology = surface_topology(surface.faces)
    if not topology.is_closed_manifold:
        raise InputError(f"surface cannot be meshed: {'; '.join(topology.problems(int(topology.genus)))}")
    if mesher in baselines.MESHERS:
        return generate_with_baseline(surface, mesher, cell_size=cell_size)
    backend = installed_backend() if backend == "auto" else backend
    if backend not in BACKENDS:
        raise InputError(f"unknown mesher backend {backend!r}", remedy=f"use auto, {' or '.join(BACKENDS)}")

    attempts: list[Attempt] = []
    if mesher == "cgal":
        wanted = {"odt": odt, "lloyd": lloyd, "perturb": perturb, "exude": exude}
        passes = tuple(name for name in PASSES if wanted[name])
        criteria = [
            Criteria(cell_size, facet_angle, fraction * cell_size, radius_edge_ratio) for fraction in facet_distance
        ]
        mesh, attempts = _refined(surface, backend, criteria, passes, seed=seed, last=fallback is None)
        if attempts[-1].problems:
            logger.warning("facet distances of %s h: %s", list(facet_distance), "; ".join(attempts[-1].problems))
    if mesher == "lattice" or (attempts[-1].problems and fallback):
        backend, passes = "tetgen", ()
        mesh, tried = _filled_with_lattice(
            surface, cell_size, edge_length, surface_distance, core_ratio=core_ratio, core_depth=core_depth
        )
        attempts += tried

    final = attempts[-1]
    return mesh, GenerateReport(
        mesher=mesher,
        backend=backend,
        backend_version=version(backend),
        seed=seed if backend == "pygalmesh" else None,
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
    """Mesh the inside of a closed surface with one of `baselines.MESHERS`, as it comes; parameters as there.

    Exactly flat tetrahedra are left out. Raises `StageError` when there is no mesh.
    """
    began = time.perf_counter()
    points, cells = baselines.fill(surface, mesher, cell_size=cell_size, time_limit=time_limit)
    cells, flat = oriented(points, cells)
    points, cells, _ = compact(points, cells)
    mesh = TetMesh(*ordered_along_curve(points, cells))
    genus = int(surface_topology(surface.faces).genus)
    attempt = _judged(mesh, genus, passes=(), flat=flat)
    _log(mesher, attempt, time.perf_counter() - began)
    distribution, _ = baselines.MESHERS[mesher]
    return mesh, GenerateReport(
        mesher=mesher,
        backend=distribution,
        backend_version=version(distribution),
        seed=None,
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


def installed_backend() -> str:
    """The backend ``auto`` stands for on this machine."""
    return "pygalmesh" if importlib.util.find_spec("pygalmesh") else "cgal"


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
        _write_off(surface, off)
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
    medit = off.with_suffix(".mesh")
    try:
        BACKENDS[backend](off, medit, criteria, passes, seed)
    except ImportError as error:
        raise StageError(f"mesher backend {backend} is not installed: {error}", remedy="run cortet doctor") from error
    except RuntimeError as error:
        raise StageError(f"{backend} failed: {error}") from error
    mesh, flat = _read_medit(medit)
    what = f"{backend}, facet distance {criteria.facet_distance:g} mm, {', '.join(('refinement', *passes))}"
    attempt = _judged(mesh, genus, facet_distance=criteria.facet_distance, passes=passes, flat=flat)
    _log(what, attempt, time.perf_counter() - began)
    return mesh, attempt


def _filled_with_lattice(
    surface: TriSurface,
    cell_size: float,
    edge_length: Sequence[float],
    surface_distance: float,
    *,
    core_ratio: float,
    core_depth: float,
) -> tuple[TetMesh, list[Attempt]]:
    """Mesh by the longest edges with which no two boundary triangles cross.

    Raises `StageError` when they cross with all of them.
    """
    genus = int(surface_topology(surface.faces).genus)
    attempts: list[Attempt] = []
    for fraction in edge_length:
        began = time.perf_counter()
        made = remesh_apart(surface, wanted(surface, fraction * cell_size, surface_distance * cell_size))
        boundary = made.surface
        if problem := _fault(boundary, surface):
            topology = surface_topology(boundary.faces)
            attempt = Attempt(None, fraction * cell_size, (), len(boundary.points), 0, 0, topology, (problem,))
        else:
            nodes = graded_nodes(boundary, made.size, cell_size=cell_size, core_ratio=core_ratio, core_depth=core_depth)
            points, cells = fill(boundary, nodes)
            cells, flat = oriented(points, cells)
            mesh, _ = reconnect(TetMesh(*ordered_along_curve(*compact(points, cells)[:2])), surface)
            attempt = _judged(mesh, genus, edge_length=fraction * cell_size, passes=(), flat=flat)
        attempts.append(replace(attempt, refinement=_refinement(made)))
        _log(f"lattice, edges of {fraction * cell_size:g} mm", attempt, time.perf_counter() - began)
        if not attempt.problems:
            return mesh, attempts
    raise StageError(
        f"no edge length of {list(edge_length)} h gives a boundary to fill: {'; '.join(attempts[-1].problems)}",
        remedy="choose a smaller cell size, add a smaller generate.edge_length, or smooth the surface there",
    )


def _refinement(made: Remeshed) -> Refinement:
    start, end = edges(made.surface.faces).T
    return Refinement(
        vertices=len(made.surface.points),
        vertices_refined=int((made.size < 0.8 * made.size.max()).sum()),
        shortest_edge_mm=float(np.linalg.norm(made.surface.points[start] - made.surface.points[end], axis=1).min()),
        distance_mean_mm=float(made.distances.mean()),
        distance_max_mm=float(made.distances.max()),
        rounds=made.rounds,
    )


def _fault(boundary: TriSurface, surface: TriSurface) -> str:
    """Why a remeshed boundary cannot be filled, or nothing."""
    crossing = unsound(boundary)
    if len(crossing):
        x, y, z = boundary.points[boundary.faces[crossing[0]]].mean(axis=0)
        return f"{len(crossing)} boundary triangles cross, the first at ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    share = enclosed_volume(boundary.points, boundary.faces) / enclosed_volume(surface.points, surface.faces)
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


def _with_pygalmesh(off: Path, medit: Path, criteria: Criteria, passes: Sequence[str], seed: int) -> None:
    # Imported here, as CGAL is below, since either may be missing. pygalmesh's public function only wraps this one,
    # through temporary files of its own that outlive a failure.
    from _pygalmesh import _generate_from_off

    _generate_from_off(
        str(off),
        str(medit),
        **{name: name in passes for name in PASSES},
        min_facet_angle=criteria.facet_angle,
        max_radius_surface_delaunay_ball=criteria.cell_size,
        max_facet_distance=criteria.facet_distance,
        max_circumradius_edge_ratio=criteria.radius_edge_ratio,
        max_cell_circumradius=criteria.cell_size,
        verbose=False,
        seed=seed,
    )


def _with_cgal(off: Path, medit: Path, criteria: Criteria, passes: Sequence[str], _seed: int) -> None:
    from CGAL import CGAL_Mesh_3 as mesh_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    wanted = mesh_3.Default_mesh_criteria()
    wanted.facet_angle(criteria.facet_angle)
    wanted.facet_size(criteria.cell_size)
    wanted.facet_distance(criteria.facet_distance)
    wanted.cell_radius_edge_ratio(criteria.radius_edge_ratio)
    wanted.cell_size(criteria.cell_size)
    refinement_only = mesh_3.Mesh_3_parameters()
    refinement_only.no_perturb()
    refinement_only.no_exude()
    limits = (NO_LIMIT, NO_LIMIT, CONVERGENCE, FREEZE_BOUND)

    # the polyhedron must outlive the domain, which only refers to it
    polyhedron = Polyhedron_3(str(off))
    domain = mesh_3.Polyhedral_mesh_domain_3(polyhedron)
    with one_core():
        complex_3 = mesh_3.make_mesh_3(domain, wanted, refinement_only)
    run: dict[str, Callable[[], object]] = {
        "odt": lambda: mesh_3.odt_optimize_mesh_3(complex_3, domain, *limits),
        "lloyd": lambda: mesh_3.lloyd_optimize_mesh_3(complex_3, domain, *limits),
        "perturb": lambda: mesh_3.perturb_mesh_3(complex_3, domain, NO_LIMIT, NO_LIMIT),
        "exude": lambda: mesh_3.exude_mesh_3(complex_3, NO_LIMIT, NO_LIMIT),
    }
    for name in passes:
        began = time.perf_counter()
        with one_core():
            run[name]()
        logger.info("cgal: %s, %.1f s", name, time.perf_counter() - began)
    complex_3.output_to_medit(str(medit))


#: name of the distribution -> function that meshes an OFF file into a Medit file
BACKENDS: dict[str, Callable[[Path, Path, Criteria, Sequence[str], int], None]] = {
    "pygalmesh": _with_pygalmesh,
    "cgal": _with_cgal,
}


@contextmanager
def one_core() -> Iterator[None]:
    """Confine this thread, and the threads it starts, to the core it is running on, and undo that at the end.

    The `cgal` wheel starts one thread per core it may use, and more than one make the mesh depend on their timing.
    Each pass is confined anew, so that two jobs that happen to choose the same core do not share it for long.
    """
    if not hasattr(os, "sched_setaffinity"):
        logger.warning("no CPU affinity on this system: the cgal backend is not reproducible here")
        yield
        return
    allowed = os.sched_getaffinity(0)
    time.sleep(_SETTLING_S)
    os.sched_setaffinity(0, {ctypes.CDLL(None).sched_getcpu()})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _write_off(surface: TriSurface, path: Path) -> None:
    """Write an OFF file whose faces point outward, with every digit of the coordinates."""
    inward = enclosed_volume(surface.points, surface.faces) < 0
    points, faces, _ = compact(surface.points, surface.faces[:, ::-1] if inward else surface.faces)
    with path.open("w") as file:
        file.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        np.savetxt(file, points, "%.17g")
        np.savetxt(file, faces, "3 %d %d %d")


def _read_medit(path: Path) -> tuple[TetMesh, int]:
    """Read the mesher's result as a well-ordered mesh with positive volumes; also count its flat tetrahedra."""
    result = meshio.medit.read(path)
    points, cells = result.points, result.cells_dict.get("tetra", np.empty((0, 4), np.int32))
    cells, flat = oriented(points, cells)
    if not len(cells):
        raise StageError("the mesher returned no tetrahedra", remedy="use a smaller cell size")
    if flat:
        logger.warning("%d exactly flat tetrahedra left out", flat)
    points, cells, _ = compact(points, cells)
    return TetMesh(*ordered_along_curve(points, cells)), flat


def oriented(points: FloatArray, cells: IntArray) -> tuple[IntArray, int]:
    """Tetrahedra reordered to positive volume, without the exactly flat ones, whose number is returned too."""
    volumes = signed_volumes(points, cells)
    cells = np.where((volumes < 0)[:, None], cells[:, [0, 1, 3, 2]], cells)
    return cells[volumes != 0], int((volumes == 0).sum())
