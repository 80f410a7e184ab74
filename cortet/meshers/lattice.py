"""Our mesher: a remeshed boundary, filled with a body-centred cubic lattice.

The surface is remeshed with triangles of one edge length, shorter where its shape requires it (`meshers._remesh`). This
keeps its topology and stays near every point of it. The lattice fills the result (`meshers._lattice`). The slivers
between the two are reconnected at once, before anything moves. If remeshed banks cross each other, the edges are
shortened, first of all there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cortet.errors import StageError, place_mm
from cortet.meshers.mesher import OF_CGAL, Attempt, Facts, Filled, Mesher, Refinement
from cortet.meshes import FloatArray, TetMesh, TriSurface

if TYPE_CHECKING:
    from cortet.config.stages import Generate
    from cortet.meshers._remesh import Remeshed

#: a remeshed boundary is too coarse if it encloses less than this share of the surface's volume
LEAST_VOLUME = 0.8


def fill(surface: TriSurface, settings: Generate, facts: Facts) -> Filled:
    """Mesh with the longest edges for which no triangles of the boundary and its inner surfaces cross.

    Raises
    ------
    StageError
        triangles cross with every edge length
    """
    from cortet.geometry.nesting import sheets
    from cortet.geometry.topology import surface_topology
    from cortet.meshers._filled import log_attempt
    from cortet.meshers._nested import remesh_apart, wanted
    from cortet.meshers._sizes import sizes_on

    attempts: list[Attempt] = []
    for fraction in settings.edge_length:
        began = time.perf_counter()
        edge = fraction * facts.cell_size
        distance = settings.surface_distance * facts.cell_size
        followed = _coarsened(surface, edge, distance)
        sizes = sizes_on(followed, settings, facts.cell_size, facts.contacts)
        longest = None if sizes is None else [fraction * size for size in sizes]
        made = remesh_apart(followed, wanted(followed, edge, distance, across=facts.elements_across, longest=longest))
        if followed is not surface:
            made = [_on(given, one) for given, one in zip(sheets(surface), made, strict=True)]
        walls = [one.surface for one in made]
        if problem := _fault(walls, sheets(surface)):
            topology = surface_topology(walls[0].faces)
            attempt = Attempt(None, edge, (), sum(len(wall.points) for wall in walls), 0, 0, topology, (problem,))
        else:
            mesh, attempt = _meshed(surface, made, edge, settings, facts)
        attempts.append(replace(attempt, refinement=_refinement(made)))
        log_attempt(f"lattice, edges of {edge:g} mm", attempt, time.perf_counter() - began)
        if not attempt.problems:
            return Filled(mesh, tuple(attempts), "tetgen")
    remedy = "choose a smaller cell size, add a smaller generate.edge_length, or "
    raise StageError(
        f"no boundary edge length worked ({settings.edge_length} h): {'; '.join(attempts[-1].problems)}",
        remedy=remedy + ("take a larger regions.min_gap" if surface.inner else "smooth the surface there"),
    )


def _coarsened(surface: TriSurface, edge: float, distance: float) -> TriSurface:
    """The surface and its inner ones with no more vertices than remeshing to this edge length and distance needs."""
    from cortet.geometry.nesting import sheets
    from cortet.meshers._remesh import coarsened

    given = sheets(surface)
    outer, *inner = made = [coarsened(one, edge, distance) for one in given]
    if all(one is old for one, old in zip(made, given, strict=True)):
        return surface
    return replace(outer, inner=dict(zip(surface.inner, inner, strict=True)))


def _on(surface: TriSurface, made: Remeshed) -> Remeshed:
    """A remeshed surface, each vertex put onto the given surface unless the nearest point is on the opposite bank."""
    from cortet.geometry.closest_point import closest_points, tree_of
    from cortet.geometry.topology import face_normals, vertex_normals

    points, faces = made.surface.points, made.surface.faces
    found = closest_points(tree_of(surface), points)
    normals = face_normals(surface.points, surface.faces)[found.faces]
    same = np.einsum("kj,kj->k", vertex_normals(points, faces), normals) > 0
    return replace(made, surface=TriSurface(np.where(same[:, None], found.points, points), faces))


def _meshed(
    surface: TriSurface, made: Sequence[Remeshed], edge: float, settings: Generate, facts: Facts
) -> tuple[TetMesh, Attempt]:
    """Fill remeshed surfaces, whose edges are at most `edge` mm long, and compare the result with the given ones."""
    from cortet.geometry.nesting import joined
    from cortet.measure.quality import quality
    from cortet.meshers._filled import checked, well_ordered
    from cortet.meshers._lattice import CONSTANT, lattice_cells, tetrahedralised
    from cortet.meshers._nested import regions_of
    from cortet.optimise.reconnection import reconnected
    from cortet.optimise.soundness import require_sound

    walls = [one.surface for one in made]
    both = joined(walls)
    nodes = [_nodes(made, bounds, edge, settings, facts) for bounds in _bounds(surface)]
    firsts, constant = np.cumsum([0, *map(len, nodes[:-1])]), CONSTANT * facts.cell_size * settings.core_ratio
    known = [first + lattice_cells(both, own, constant) for first, own in zip(firsts, nodes, strict=True)]
    points, cells = tetrahedralised(both, np.concatenate(nodes), np.concatenate(known))
    mesh, flat = well_ordered(points, cells, regions_of(points, cells, walls) if surface.inner else None)
    require_sound(mesh, quality(mesh.points, mesh.cells))
    # the next stage improves the mean
    mesh = reconnected(mesh, surface, insert=False, mean=False, cell_size=facts.cell_size).mesh
    attempt = checked(mesh, surface, edge_length=edge, flat=flat)
    return mesh, replace(attempt, problems=attempt.problems + _interface_problems(mesh, surface))


def _bounds(surface: TriSurface) -> list[list[int]]:
    """The surfaces that bound each region, by number: the one around it, then those inside it."""
    from cortet.geometry.nesting import parents

    around = parents(surface)
    return [[number, *(one for one, parent in enumerate(around) if parent == number)] for number in range(len(around))]


def _nodes(
    made: Sequence[Remeshed], bounds: Sequence[int], edge: float, settings: Generate, facts: Facts
) -> FloatArray:
    """Nodes inside the region that some of the remeshed surfaces bound, (n, 3) mm."""
    from cortet.geometry.nesting import joined, turned
    from cortet.meshers._lattice import CORE_GROWTH, graded_nodes
    from cortet.meshers._remesh import GROWTH
    from cortet.meshers._sizes import size_of_contacts

    around = size_of_contacts(facts.contacts, facts.cell_size)
    first, *within = [made[one].surface for one in bounds]
    growth, plateau = GROWTH, 0.0
    if facts.elements_across > 1:
        # cells between the surfaces grow from neither side; elsewhere there is a layer of one size at least
        growth, plateau = CORE_GROWTH, (facts.elements_across if bounds[0] == 0 else 1) / 2
    return graded_nodes(
        joined([first, *map(turned, within)]),
        np.concatenate([made[one].size for one in bounds]),
        edge_length=edge,
        cell_size=facts.cell_size,
        core_ratio=settings.core_ratio,
        core_depth=settings.core_depth,
        growth=growth,
        plateau=plateau,
        layer=len(within) > 0,
        balls=np.column_stack([facts.contacts, edge / facts.cell_size * around]),
    )


def _interface_problems(mesh: TetMesh, surface: TriSurface) -> tuple[str, ...]:
    """Interfaces that do not have the topology of their surface, in plain words."""
    from cortet.geometry.topology import sheet, surface_topology

    found = []
    for number, (name, one) in enumerate(surface.inner.items(), start=1):
        genus = int(surface_topology(one.faces).genus)
        found += [f"{name}: {what}" for what in surface_topology(sheet(mesh, number)[0].faces).problems(genus)]
    return tuple(found)


def _refinement(made: Sequence[Remeshed]) -> Refinement:
    from cortet.geometry.nesting import joined
    from cortet.geometry.topology import edges

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
    """Why remeshed surfaces cannot be filled, or an empty text; `every` holds the given surfaces."""
    from cortet.geometry.nesting import joined
    from cortet.geometry.topology import enclosed_volume
    from cortet.meshers._half_edges import FLAT
    from cortet.meshers._remesh import shapes, unsound

    both = joined(walls)
    unusable = unsound(both)
    if len(unusable):
        flat = shapes(both)[unusable] < FLAT
        counts = {"cross": np.count_nonzero(~flat), "are flat": np.count_nonzero(flat)}
        what = " and ".join(f"{count} boundary triangles {fault}" for fault, count in counts.items() if count)
        return f"{what}, the first at {place_mm(both.points[both.faces[unusable[0]]].mean(axis=0))}"
    for wall, one in zip(walls, every, strict=True):
        share = enclosed_volume(wall.points, wall.faces) / enclosed_volume(one.points, one.faces)
        if share < LEAST_VOLUME:
            return f"the remeshed boundary encloses {100 * share:.0f} % of the volume"
    return ""


def _said(_parameters: Mapping[str, Any], _backend: str, mesher: str, meshes: str) -> str:
    return f"the mesher {mesher} (a remeshed boundary, filled with a body-centred cubic lattice by TetGen; {meshes})"


MESHERS = (
    Mesher(
        name="lattice",
        printed="Lattice",
        fill=fill,
        tets_per_cube=4.1,  # measured 3.3 to 4.0, most where blades are thin
        regions=True,
        sizes=True,
        ignores=OF_CGAL,
        said=_said,
    ),
)
