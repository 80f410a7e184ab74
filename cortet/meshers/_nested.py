"""Triangles on nested surfaces that leave room for each other, and the tetrahedra between the surfaces.

Edge lengths follow the thickness of each region, be it a blade of the only one or the cortex between two surfaces.
TetGen keeps the triangles of all surfaces, so each tetrahedron lies in one region.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cortet.errors import StageError
from cortet.geometry.banks import slits
from cortet.geometry.closest_point import tree_of
from cortet.geometry.limits import LEAST_BANK_GAP
from cortet.geometry.nesting import joined, parents, region_boundary, sheets
from cortet.geometry.thickness import gaps, thickness
from cortet.geometry.topology import TET_FACES, bodies, enclosed_volume, neighbours, packed, vertex_normals
from cortet.meshers._remesh import (
    CREST,
    EDGE_OVER_THICKNESS,
    REACH,
    ROUNDS,
    SHARE_OF_GAP,
    SHORTEST,
    Remeshed,
    Wanted,
    opened,
    remesh,
    tightened,
    unsound,
)
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface

#: edges over the thickness of a layer of tetrahedra between two surfaces; some lead through two layers already
EDGE_OF_LAYERS = 1.25

logger = logging.getLogger(__name__)


def wanted(
    surface: TriSurface,
    edge_length: float,
    distance: float,
    *,
    across: int = 1,
    longest: Sequence[FloatArray] | None = None,
) -> list[Wanted]:
    """For each surface, edge lengths that follow the thickness of adjacent layers, and distances that follow the gaps.

    Parameters
    ----------
    surface : with its inner ones, whose triangles then all point outward
    edge_length, distance : mm, where everything is thick
    across : number of tetrahedra between the outer surface and those inside it; fewer where the shortest edges are too
        long for it
    longest : for each surface (n,) mm, the largest edge length at its vertices
    """
    every, around = sheets(surface), parents(surface)
    trees = [tree_of(region_boundary(surface, number)) for number in range(len(every))]
    outward = enclosed_volume(surface.points, surface.faces) > 0
    most = 4 * edge_length
    found = []
    for number, (one, parent) in enumerate(zip(every, around, strict=True)):
        normals = vertex_normals(one.points, one.faces)
        within = thickness(trees[number], one.points, normals, most, inside=outward)
        filled = opened(one, within, below=edge_length / EDGE_OVER_THICKNESS, radius=CREST * distance)
        cortex = filled
        beyond = [every[other] for other in _beyond(around, number)]
        if beyond:
            # a ball that reaches through the layer must not end at the next one, which faces the same way
            cortex = gaps(tree_of(joined(beyond)), one.points, -normals if parent < 0 else normals, most)
            filled = np.minimum(filled, cortex)
        gap = filled
        if parent < 0:
            gap = np.minimum(filled, thickness(tree_of(one), one.points, normals, most, inside=not outward))
        size = EDGE_OVER_THICKNESS * filled
        if surface.inner and parent <= 0:
            # cells that are too large for this many layers, and too small for fewer, would be flat or long
            fit = np.clip(np.floor(EDGE_OF_LAYERS * cortex / (SHORTEST * edge_length)), 1, across)
            size = np.minimum(size, EDGE_OF_LAYERS / fit * cortex)
        if longest is not None:
            size = np.minimum(size, longest[number])
        size = np.clip(size, SHORTEST * edge_length, edge_length)
        found.append(Wanted(size, np.clip(SHARE_OF_GAP * gap, SHORTEST * distance, distance)))
    return found


def _beyond(around: Sequence[int], number: int) -> list[int]:
    """The surfaces across the layer around a surface, or, for the outer one, the layer inside it, by number."""
    layer = max(around[number], 0)
    return [one for one, parent in enumerate(around) if one != number and layer in (one, parent)]


def remesh_apart(surface: TriSurface, want: Sequence[Wanted]) -> list[Remeshed]:
    """Remesh all surfaces; then repeat, finer and nearer to them, around triangles that cross, are flat or close a gap.

    A gap of the outer surface is closed if less than `LEAST_BANK_GAP` is left of it. After a few rounds the last result
    is returned, in which some such triangles may remain.
    """
    every, wants = sheets(surface), list(want)
    made = [remesh(one, its) for one, its in zip(every, wants, strict=True)]
    for number in range(2, ROUNDS + 1):
        both = joined([one.surface for one in made])
        # the triangles of the outer surface come first
        bad = np.union1d(unsound(both), slits(made[0].surface, every[0], LEAST_BANK_GAP))
        if not len(bad):
            break
        corners = both.faces[bad]
        centres = both.points[corners].mean(axis=1)
        radius = REACH * np.concatenate([one.size for one in made])[corners].max(axis=1)
        logger.info("%d triangles cross, are flat or close a gap: again, finer around them", len(bad))
        for sheet, one in enumerate(every):
            tighter = tightened(one, wants[sheet], centres, radius)
            again = made[sheet] if tighter is wants[sheet] else remesh(one, tighter)
            wants[sheet], made[sheet] = tighter, replace(again, rounds=number)
    return made


def regions_of(points: FloatArray, cells: IntArray, walls: Sequence[TriSurface]) -> IntArray:
    """The region of each tetrahedron, 1 inside the outer surface alone: (m,) int32.

    Parameters
    ----------
    points, cells : of either orientation, with every triangle of the walls among their faces; the vertices of the walls
        come first, in their order
    walls : the surfaces; none touches another
    """
    sheet_of_node = np.full(len(points), -1)
    count = sum(len(wall.points) for wall in walls)
    sheet_of_node[:count] = np.repeat(np.arange(len(walls)), [len(wall.points) for wall in walls])
    behind = neighbours(TetMesh(points, cells))
    on = sheet_of_node[cells[:, TET_FACES]]
    cell, corner = np.nonzero((on[..., 0] > 0) & (on == on[..., :1]).all(axis=2) & (behind >= 0))
    faces = cells[cell[:, None], TET_FACES[corner]]
    facets = joined(walls).faces
    facets = facets[len(walls[0].faces) :]
    keys = packed(np.concatenate([facets, faces]))
    order = np.argsort(keys[: len(facets)], kind="stable")
    facet = np.searchsorted(keys[: len(facets)], keys[len(facets) :], sorter=order)
    facet = order[np.minimum(facet, len(facets) - 1)]
    is_facet = keys[facet] == keys[len(facets) :]
    cell, corner, facet = cell[is_facet], corner[is_facet], facet[is_facet]
    parted = behind.copy()
    parted[cell, corner] = -1
    part = bodies(parted)
    # a body lies inside a surface where its tetrahedra are below the triangles
    corners = points[facets[facet]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    below = np.einsum("kj,kj->k", normal, points[cells[cell]].mean(axis=1) - corners.mean(axis=1)) < 0
    inside = np.zeros((part.max() + 1, len(walls)), np.int64)
    np.add.at(inside, (part[cell], sheet_of_node[facets[facet, 0]]), np.where(below, 1, -1))
    label = np.where((inside > 0).any(axis=1), inside.argmax(axis=1), 0)
    if not np.array_equal(np.sort(label), np.arange(len(walls))):
        raise StageError(
            f"the surfaces divide the mesh into {len(label)} bodies instead of {len(walls)}",
            remedy="mesh each surface alone and check its certificate, or use a smaller cell size",
        )
    return (1 + label[part]).astype(np.int32)
