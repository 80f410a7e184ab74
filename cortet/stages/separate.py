"""Move inner surfaces inward where they touch, cross or nearly touch the surface around them.

Where the cortex ends, at the medial wall, white and pial surface are the same, but each has its own error: in every
real pair, thousands of triangles cross there. A region between them needs room for a cell, so the inner surface gives
way smoothly along the outer surface's normals, and no farther than needed. In blades too thin for two gaps and
something between them, it gives way less.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cortet.config.stages import Regions
from cortet.errors import InputError, counted, place_mm
from cortet.geometry.closest_point import tree_of
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import depths, joined, parents, region_boundary, sheets
from cortet.geometry.separation import gaps_to_keep, kept_apart
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.meshes import TriSurface, region_names

VERSION: int = 4

#: shares of the requested gap that are tried, until no triangles cross
_SHARES = (1.0, 0.5, 0.25)

#: two surfaces are one where they are nearer than this share of the gap
_SAME = 0.02

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Separated:
    """What was done to one inner surface."""

    #: name of the region inside it
    name: str
    #: the gap that was kept: what was asked for, or less where triangles would have crossed
    min_gap_mm: float
    #: triangles of the two surfaces that crossed, before
    crossing_faces_before: int
    vertices: int
    vertices_moved: int
    #: mean over all vertices
    moved_mean_mm: float
    moved_max_mm: float
    #: volume enclosed by this surface, before and after
    volume_before_ml: float
    volume_ml: float
    #: volume of the region between it and the surface around it
    around_before_ml: float
    around_ml: float


@dataclass(frozen=True)
class SeparateReport:
    """One entry for each inner surface."""

    surfaces: tuple[Separated, ...]


def separate(
    surface: TriSurface,
    settings: Regions = Regions(),
    *,
    cell_size: float,
    most_the_same: float = 0.5,
) -> tuple[TriSurface, SeparateReport]:
    """Move inner surfaces inward until they keep a distance from the surfaces around them.

    Coordinates of the result are float32 values, so GIfTI files hold them exactly.

    Parameters
    ----------
    surface : with its inner surfaces, none of which crosses itself
    settings : as `Regions` describes them; `elements_across` is for S1
    cell_size : mm
    most_the_same : share of the area of an inner surface that may lie on the one around it, or outside

    Raises
    ------
    InputError
        a surface is not inside the one around it, lies on it, or cannot be moved there; says where
    """
    around = parents(surface)
    names = region_names(surface.inner)
    _check_volumes(surface)
    given, reports = surface, []
    gap = settings.min_gap * cell_size

    def around_it(whole: TriSurface, number: int) -> TriSurface:
        """The boundary of the region that a surface lies in, without what lies in that surface, which moves later."""
        others = [i for i in range(1, len(names)) if number not in _with_ancestors(i, around)]
        without = replace(whole, inner={names[i]: whole.inner[names[i]] for i in others})
        return region_boundary(without, [0, *others].index(around[number]))

    for number in range(1, len(names)):
        one = sheets(surface)[number]
        container = around_it(surface, number)
        # a surface precedes those that it contains; after it has moved, they may lie outside it through no fault of
        # their own
        before = around_it(given, number) if around[number] > 0 else container
        _require_inside(one, before, name=names[number], max_outside=settings.max_outside)
        _require_another(one, before, names[number], near=_SAME * gap, most=most_the_same)
        moved, report = _moved_inside(one, container, name=names[number], gap=gap)
        surface = replace(surface, inner={**surface.inner, names[number]: moved})
        reports.append(report)
    return surface, SeparateReport(tuple(reports))


def _with_ancestors(number: int, around: Sequence[int]) -> list[int]:
    """A surface and all surfaces around it."""
    return [number, *_with_ancestors(around[number], around)] if number >= 0 else []


def _check_volumes(surface: TriSurface) -> None:
    outer = enclosed_volume(surface.points, surface.faces)
    for name, one in surface.inner.items():
        volume = enclosed_volume(one.points, one.faces)
        if volume > outer:
            raise InputError(
                f"the inner surface {name} encloses {volume / 1000:.1f} mL, but the outer surface only "
                f"{outer / 1000:.1f} mL",
                remedy="swap the two surfaces",
            )


def _require_inside(surface: TriSurface, container: TriSurface, *, name: str, max_outside: float) -> None:
    depth, _, _ = depths(tree_of(container), container, surface.points)
    worst = int(depth.argmin())
    if depth[worst] < -max_outside:
        raise InputError(
            f"the inner surface {name} lies up to {-depth[worst]:.2f} mm outside the surface around it, at "
            f"{place_mm(surface.points[worst])}; {(depth < -max_outside).mean():.1%} of its vertices are more than "
            f"{max_outside:g} mm outside",
            remedy="check that both surfaces are of the same subject and in the same space; if they are, raise "
            "regions.max_outside",
        )


def _require_another(surface: TriSurface, container: TriSurface, name: str, *, near: float, most: float) -> None:
    """Raise InputError if more than a share of a surface is the one around it, up to the distance `near`, mm."""
    depth, _, _ = depths(tree_of(container), container, surface.points)
    share = float(
        np.average((depth < near)[surface.faces].all(axis=1), weights=face_areas(surface.points, surface.faces))
    )
    if share > most:
        raise InputError(
            f"{share:.0%} of the inner surface {name} lies on or outside the surface around it, so no tissue lies "
            "between them",
            remedy="give two surfaces, such as the pial and the white one, in this order",
        )


def _moved_inside(surface: TriSurface, container: TriSurface, *, name: str, gap: float) -> tuple[TriSurface, Separated]:
    tree = tree_of(container)
    crossing = len(self_intersections(joined([surface, container])))
    for share in _SHARES:  # a smaller gap asks for shorter moves, after which fewer triangles cross
        gaps = gaps_to_keep(container, tree, share * gap)
        moved, remaining = kept_apart(surface, container, tree, gaps, share * gap)
        if not len(remaining):
            break
    gap, points = share * gap, moved.points
    if len(remaining):
        both = joined([moved, container])
        first = both.points[both.faces[remaining[0]]].mean(axis=0)
        raise InputError(
            f"the inner surface {name} cannot be moved {gap:g} mm away from the surface around it: "
            f"{counted(len(remaining), 'triangle still intersects', 'triangles still intersect')}, the first at "
            f"{place_mm(first)}",
            remedy="edit the surfaces there, or choose a smaller regions.min_gap",
        )
    distance = np.linalg.norm(points - surface.points, axis=1)
    before, volume = (enclosed_volume(p, surface.faces) / 1000 for p in (surface.points, points))
    whole = enclosed_volume(container.points, container.faces) / 1000
    report = Separated(
        name=name,
        min_gap_mm=gap,
        crossing_faces_before=crossing,
        vertices=len(points),
        vertices_moved=int((distance > 0).sum()),
        moved_mean_mm=float(distance.mean()),
        moved_max_mm=float(distance.max()),
        volume_before_ml=before,
        volume_ml=volume,
        around_before_ml=whole - before,
        around_ml=whole - volume,
    )
    logger.info(
        "%s: %d of %d vertices moved by up to %.3f mm, %.3f on average",
        name,
        report.vertices_moved,
        report.vertices,
        report.moved_max_mm,
        report.moved_mean_mm,
    )
    return moved, report
