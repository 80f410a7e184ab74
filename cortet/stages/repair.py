"""Repair of a broken surface, within limits: what has one right answer is done and recorded, the rest is refused.

A surface without a flaw passes with the very same arrays. The steps run in the order that changes least: what equal
places and indices decide comes first, then new triangles in holes, then cuts through handles, and at last triangles
that cross. As a last resort, the whole surface is made anew on a grid instead.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.gifti import single_precision
from cortet.formats.surface_sets import FILLED
from cortet.geometry import mending
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.handles import without_handles
from cortet.geometry.holes import capped, closed_volume, replaced, rim_length, rims
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import CAP, REPLACED, Triangles
from cortet.geometry.rebuilding import rebuilt
from cortet.geometry.topology import (
    enclosed_volume,
    face_areas,
    neighbour_means,
    surface_topology,
)
from cortet.geometry.uncrossing import uncrossed
from cortet.measure.fidelity import Distances, summary
from cortet.measure.lost import distances_to
from cortet.mesh import FloatArray, IntArray, TriSurface
from cortet.stages.gate import outward

VERSION: int = 1

#: how a broken surface is repaired
Method = Literal["local", "voxel"]

#: how many places of one kind are listed, and how far from each other they are, mm
PLACES, APART_MM = 10, 5.0
#: vertices of open edges are one within this share of the longest side: rounding of single precision
_ROUNDING = 1e-6
#: a vertex so many times the mean edge around it away from the middle of its neighbours is a spike
_SPIKE = 5.0
#: share of the way to the middle of their neighbours that the parts of a split vertex are moved, so that they part
_PARTED = 0.1

#: where nothing better is known
_REMEDY = "edit the surface there, or remesh it"

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RepairStep:
    """One kind of flaw, and what was done to it."""

    #: in words
    done: str
    #: how many, and of what
    count: int
    of: str
    #: where, the first few that are apart
    places_mm: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class RepairReport:
    """What was done to a surface, and how far it is from the file."""

    source: str | None
    #: false: the surface passed as it is, and what follows is as in the file
    repaired: bool
    steps: tuple[RepairStep, ...]
    vertices_before: int
    vertices: int
    faces_before: int
    faces: int
    #: vertices and face centres of the file to the nearest point of the repaired surface, and the other way round
    file_to_surface_mm: Distances
    surface_to_file_mm: Distances
    #: farthest that a triangle was moved, or lies from one in whose place it is; caps and cuts apart
    displacement_max_mm: float
    area_before_mm2: float
    area_mm2: float
    #: of caps on holes of the file
    filled_area_mm2: float
    #: of the file with its holes filled
    volume_before_ml: float
    volume_ml: float
    relative_area_change: float
    relative_volume_change: float


@dataclass(frozen=True)
class Limits:
    """What may be done; beyond it a surface is refused."""

    max_displacement: float
    max_volume_change: float
    max_hole: float
    max_loop: float
    max_piece: float
    method: Method
    spacing: float
    allow_genus: int
    source: Any


def repair(
    surface: TriSurface,
    *,
    source: Any,
    max_displacement: float = 1.0,
    max_volume_change: float = 0.02,
    max_hole: float = 200.0,
    max_loop: float = 30.0,
    max_piece: float = 0.01,
    method: Method = "local",
    spacing: float = 0.3,
    allow_genus: int = 0,
) -> tuple[TriSurface, RepairReport]:
    """Make one closed manifold without crossing triangles of a surface, where that has one right answer.

    Values of fields are kept, new vertices take those of the nearest point of the given surface; where a hole was
    filled, the field `filled` is 1 on the vertices of its cap. Coordinates of a repaired surface are float32 values.

    Parameters
    ----------
    surface : as read; coordinates need not be finite; its inner surfaces stay as they are
    source : where it comes from, for messages and the report
    max_displacement : mm, farthest that triangles may be moved or lie from those in whose place they are
    max_volume_change : relative
    max_hole : mm, longest rim of a hole that is filled
    max_loop : mm, longest loop along which a handle is cut or a tunnel closed
    max_piece : share of the area up to which a separate piece is dropped
    method : ``local``, or ``voxel``, which makes a broken surface anew as a sphere, on a grid (`geometry.rebuilding`)
    spacing : mm, of that grid
    allow_genus : number of handles that may stay

    Raises
    ------
    InputError
        something is beyond these limits, or has no single right answer; says what and where
    """
    limits = Limits(
        max_displacement, max_volume_change, max_hole, max_loop, max_piece, method, spacing, allow_genus, source
    )
    if not _has_flaw(surface, allow_genus):
        return surface, _untouched(surface, source)
    work = _Repair(surface, limits)
    try:
        work.set_right()
        return work.result()
    except InputError as error:  # what refuses knows no files
        raise InputError(error.what, file=source, remedy=error.remedy or _REMEDY) from None


def _has_flaw(surface: TriSurface, allow_genus: int) -> bool:
    """Whether there is anything to repair."""
    if not (mending.finite(surface.points).all() and len(surface.faces)):
        return True
    topology = surface_topology(surface.faces)
    return (
        not topology.is_closed_manifold
        or topology.genus > allow_genus
        or bool(len(_flat(surface.points, surface.faces)))
        or bool(len(_spikes(surface.points, surface.faces)))
        or bool(len(self_intersections(surface)))
    )


def _flat(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces without area, to within the rounding of their coordinates, which the gate refuses."""
    corners = points[faces].astype(np.float32).astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.flatnonzero(area <= np.finfo(np.float32).eps * longest**2).astype(np.int32)


def _spikes(points: FloatArray, faces: IntArray) -> IntArray:
    """Vertices far from the middle of their neighbours, compared with the edges between these."""
    away = np.linalg.norm(points - neighbour_means(points, faces), axis=1)
    corners = points[faces]
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    vertex, count = faces.ravel(), len(points)
    ring = np.bincount(vertex, opposite.ravel(), minlength=count) / np.maximum(np.bincount(vertex, minlength=count), 1)
    return np.flatnonzero(away > _SPIKE * ring).astype(np.int32)


class _Repair:
    """A surface that is being repaired, with what has been done to it so far."""

    def __init__(self, surface: TriSurface, limits: Limits) -> None:
        self.given, self.limits = surface, limits
        points = surface.points.astype(np.float32).astype(np.float64)
        self.work = mending.triangles(points, surface.faces)
        #: (n,) of the file: vertices whose faces this repair removed; a hole there is ours
        self.touched = np.zeros(len(points), np.bool_)
        self.steps: list[RepairStep] = []
        #: mm, of crossing triangles
        self.displacement = 0.0
        #: mm3, with the holes of the file filled
        self.volume_before = 0.0

    def set_right(self) -> None:
        """All steps, in their order."""
        local = (
            self._branches,
            self._small_pieces,
            self._orientation,
            self._holes,
            self._misshapen,
            self._handles,
            self._crossings,
        )
        how = {"local": local, "voxel": (self._rebuilding,)}[self.limits.method]
        for step in (self._unknown_places, self._coinciding, self._duplicates, *how):
            step()
            if not len(self.work.faces):
                raise InputError("no triangle is left", remedy="export the surface again")

    def result(self) -> tuple[TriSurface, RepairReport]:
        """The repaired surface, if it is one and within the limits."""
        work = self.work = mending.compacted(self.work)
        made = single_precision(TriSurface(work.points, work.faces))
        topology = surface_topology(made.faces)
        problems = topology.problems(genus=int(topology.genus))
        problems += [f"{count} triangles that cross others" for count in [len(self_intersections(made))] if count]
        problems += [f"{count} triangles without area" for count in [len(_flat(made.points, made.faces))] if count]
        if problems:
            raise InputError(f"repair leaves {'; '.join(problems)}")
        volume = enclosed_volume(made.points, made.faces)
        change = volume / self.volume_before - 1 if self.volume_before else np.inf
        if abs(change) > self.limits.max_volume_change:
            raise InputError(
                f"repair would change the volume by {change:+.1%}, where {self.limits.max_volume_change:.1%} are "
                f"allowed ({self._done()})",
                remedy="edit the surface, or set repair.max_volume_change",
            )
        made = replace(made, point_data=self._fields(made), frame=self.given.frame, inner=self.given.inner)
        report = self._report(made)
        logger.warning("%s: repaired: %s", self.limits.source, self._done())
        return made, report

    def _unknown_places(self) -> None:
        work, vertices = mending.with_known_places(self.work)
        if len(vertices):
            around = self._neighbours(vertices)
            self.touched[around] = True
            self._replace(work, "vertices without finite coordinates removed", len(vertices), "vertices", around)

    def _coinciding(self) -> None:
        tolerance = _ROUNDING * float(np.ptp(self.work.points, axis=0).max())
        work, gone = mending.merged(self.work, tolerance)
        if len(gone):
            self._replace(work, "coinciding vertices merged", len(gone), "vertices", gone)
        work, gone = mending.collapsed(self.work, 0.0)
        if len(gone):
            self._replace(work, "edges without length collapsed", len(gone), "vertices", gone)
        self.work, _ = mending.without_lines(self.work)

    def _duplicates(self) -> None:
        work, gone = mending.without_duplicates(self.work)
        if len(gone):
            places = self.work.faces[gone, 0]
            self._replace(work, "doubled triangles removed", len(gone), "faces", places)

    def _rebuilding(self) -> None:
        turned = TriSurface(self.work.points, outward(self.work.points, self.work.faces))
        made, self.volume_before = rebuilt(turned, self.limits.spacing)
        self._note(f"surface made anew on a grid of {self.limits.spacing:g} mm", 1, "surface", made.points.mean(axis=0))
        work = mending.triangles(made.points, made.faces)
        self.work = work._replace(origin=np.full(len(made.points), -1, np.int32), made=work.made + REPLACED)

    def _branches(self) -> None:
        count = len(self.work.points)
        self.work, centres, cut = mending.without_branches(self.work)
        if len(centres):
            self.touched[cut] = True
            self._note("edges in more than two triangles parted", len(centres), "edges", centres)
        work, vertices = mending.split_fans(self.work)
        if len(vertices):
            self._replace(work, "vertices with several fans of triangles split", len(vertices), "vertices", vertices)
        self._part(count)

    def _part(self, count: int) -> None:
        """Move the parts of split vertices, which are numbered from `count`, a little towards their own triangles."""
        copies = np.arange(count, len(self.work.points))
        parted = np.flatnonzero(np.isin(self.work.origin, self.work.origin[copies]))
        if len(parted):
            points = self.work.points.copy()
            points[parted] += _PARTED * (neighbour_means(points, self.work.faces)[parted] - points[parted])
            points[~np.isfinite(points)] = 0  # of vertices that no triangle uses any more
            self.work = self.work._replace(points=points)

    def _small_pieces(self) -> None:
        piece, area = mending.pieces(self.work)
        share = area / area.sum()
        large = np.flatnonzero(share > self.limits.max_piece)
        if len(large) > 1:
            shares = ", ".join(f"{value:.1%}" for value in share[large[:4]])
            where = _words(np.array([self._middle(piece == number) for number in large[:2]]))
            raise InputError(
                f"{len(large)} separate pieces with {shares} of the area, around {where}: which one is meant is not "
                "known",
                remedy=f"keep one of them, or set repair.max_piece (now {self.limits.max_piece:g})",
            )
        if len(area) > 1:
            centres = np.array([self._middle(piece == number) for number in range(1, min(len(area), PLACES + 1))])
            self._note("small separate pieces dropped", len(area) - 1, "pieces", centres)
            self.work = mending.chosen_faces(self.work, piece == 0)

    def _orientation(self) -> None:
        topology = surface_topology(self.work.faces)
        turned = outward(self.work.points, self.work.faces)
        changed = np.flatnonzero((turned != self.work.faces).any(axis=1))
        if topology.misoriented_edges:
            places = self.work.faces[changed, 0]
            self._note("triangles turned outward", len(changed), "faces", self.work.points[places])
        self.work = self.work._replace(faces=turned)
        if surface_topology(turned).misoriented_edges:
            raise InputError("this surface has no inside: it cannot be oriented", remedy="export the surface again")
        if closed_volume(self.work) < 0:
            self.work = self.work._replace(faces=np.ascontiguousarray(turned[:, ::-1]))

    def _holes(self) -> None:
        found = rims(self.work.faces)
        for rim in found:
            length = rim_length(self.work.points, rim)
            if length > self.limits.max_hole:
                raise InputError(
                    f"a hole with a rim of {length:.0f} mm around {_words(self.work.points[rim].mean(axis=0))}, "
                    f"where up to {self.limits.max_hole:g} mm are filled",
                    remedy="close the surface there, or set repair.max_hole",
                )
        # where faces were removed above, the file had no hole
        ours = [bool(self.touched[self.work.origin[rim]].any()) for rim in found]
        cut, of_file = ([rim for rim, own in zip(found, ours, strict=True) if own == which] for which in (True, False))
        if of_file:
            middles = np.array([self.work.points[rim].mean(axis=0) for rim in of_file])
            longest = max(rim_length(self.work.points, rim) for rim in of_file)
            self._note(f"holes filled, with a rim of up to {longest:.1f} mm", len(of_file), "holes", middles)
        for rim, made in [*((rim, CAP) for rim in of_file), *((rim, REPLACED) for rim in cut)]:
            self.work = capped(self.work, rim, made)
        self.volume_before = enclosed_volume(self.work.points, self.work.faces)

    def _misshapen(self) -> None:
        """Flat triangles and spikes are cut out, and the holes closed smoothly."""
        work = self.work = mending.compacted(self.work)
        if len(spikes := _spikes(work.points, work.faces)):
            self._note("spikes cut off", len(spikes), "vertices", work.points[spikes])
            work = self.work = mending.compacted(replaced(work, spikes, self.limits.max_piece))
        if len(flat := work.faces[_flat(work.points, work.faces)]):
            self._note("triangles without area replaced", len(flat), "faces", work.points[flat].mean(axis=1))
            self.work = replaced(work, flat.ravel(), self.limits.max_piece)

    def _handles(self) -> None:
        limits = self.limits
        cuts = without_handles(
            mending.compacted(self.work), keep=limits.allow_genus, max_loop=limits.max_loop, max_piece=limits.max_piece
        )
        self.work = cuts.work
        if len(cuts.centres):
            done = f"handles cut or tunnels closed, along loops of up to {cuts.longest:.1f} mm"
            self._note(done, len(cuts.centres), "handles", cuts.centres)

    def _crossings(self) -> None:
        limits = self.limits
        found = uncrossed(
            mending.compacted(self.work), max_displacement=limits.max_displacement, max_piece=limits.max_piece
        )
        self.work = found.work
        if not len(found.centres):
            return
        how = "moved apart or replaced" if found.replaced else "moved apart"
        self._note(f"crossing triangles {how}", len(found.centres), "faces", found.centres)
        self.displacement = found.displacement
        if self.displacement > limits.max_displacement:
            raise InputError(
                f"repair of {len(found.centres)} crossing triangles would move the surface by "
                f"{found.displacement:.2f} mm at {_words(found.place)}, where {limits.max_displacement:g} mm are "
                "allowed",
                remedy="edit the surface there, or set repair.max_displacement",
            )

    def _fields(self, made: TriSurface) -> dict[str, NDArray[Any]]:
        """Values of the file at its vertices, at new ones those of the nearest point of the file."""
        fields: dict[str, NDArray[Any]] = {}
        new = np.flatnonzero(self.work.origin < 0)
        if self.given.point_data and len(new):
            file = mending.measurable(self.given)
            found = closest_points(tree_of(file), made.points[new])
            corners = file.faces[found.faces]
        for name, values in self.given.point_data.items():
            taken = values[np.maximum(self.work.origin, 0)].copy()
            if len(new):
                if np.issubdtype(values.dtype, np.integer):
                    taken[new] = values[corners[np.arange(len(new)), found.barycentric.argmax(axis=1)]]
                else:
                    taken[new] = np.einsum("kc,kc...->k...", found.barycentric, values[corners])
            fields[name] = taken
        if (self.work.made == CAP).any():
            filled = np.ones(len(made.points), np.int32)
            filled[made.faces[self.work.made != CAP]] = 0
            fields[FILLED] = filled
        return fields

    def _report(self, made: TriSurface) -> RepairReport:
        file = mending.measurable(self.given)
        used = np.unique(file.faces)
        from_file = distances_to(made, file)
        from_file = np.r_[from_file[used], from_file[len(file.points) :]]
        areas = face_areas(made.points, made.faces)
        before = float(face_areas(file.points, file.faces).sum())
        volume = enclosed_volume(made.points, made.faces)
        return RepairReport(
            source=None if self.limits.source is None else str(self.limits.source),
            repaired=True,
            steps=tuple(self.steps),
            vertices_before=len(self.given.points),
            vertices=len(made.points),
            faces_before=len(self.given.faces),
            faces=len(made.faces),
            file_to_surface_mm=summary(from_file),
            surface_to_file_mm=summary(distances_to(file, made)),
            displacement_max_mm=self.displacement,
            area_before_mm2=before,
            area_mm2=float(areas.sum()),
            filled_area_mm2=float(areas[self.work.made == CAP].sum()),
            volume_before_ml=self.volume_before / 1000,
            volume_ml=volume / 1000,
            relative_area_change=float(areas.sum()) / before - 1,
            relative_volume_change=volume / self.volume_before - 1,
        )

    def _neighbours(self, vertices: IntArray) -> IntArray:
        """Vertices with known places in the faces of some vertices."""
        near = self.work.faces[np.isin(self.work.faces, vertices).any(axis=1)]
        return np.setdiff1d(near, np.flatnonzero(~mending.finite(self.work.points)))

    def _replace(self, work: Triangles, done: str, count: int, of: str, vertices: IntArray) -> None:
        self._note(done, count, of, self.work.points[vertices])
        self.work = work

    def _note(self, done: str, count: int, of: str, places: FloatArray) -> None:
        listed = tuple(map(tuple, _apart(np.atleast_2d(places)).round(3).tolist()))
        self.steps.append(RepairStep(done, count, of, listed))

    def _middle(self, faces: NDArray[np.bool_]) -> FloatArray:
        middle: FloatArray = self.work.points[self.work.faces[faces]].mean(axis=(0, 1))
        return middle

    def _done(self) -> str:
        return "; ".join(f"{step.count} {step.done}" for step in self.steps)


def _apart(places: FloatArray) -> FloatArray:
    """The first few of some places (k, 3), each farther than `APART_MM` from those before it."""
    listed: list[FloatArray] = []
    while len(places) and len(listed) < PLACES:
        listed.append(places[0])
        places = places[np.linalg.norm(places - places[0], axis=1) > APART_MM]
    return np.array(listed).reshape(-1, 3)


def _words(places: FloatArray) -> str:
    """Places (k, 3) or (3,), as messages name them."""
    named = (f"({', '.join(f'{x:.2f}' for x in place)})" for place in np.atleast_2d(places).tolist())
    return " and ".join(named) + " mm"


def _untouched(surface: TriSurface, source: Any) -> RepairReport:
    area = float(face_areas(surface.points, surface.faces).sum())
    volume = enclosed_volume(surface.points, surface.faces) / 1000
    none = Distances(0.0, 0.0, 0.0)
    return RepairReport(
        source=None if source is None else str(source),
        repaired=False,
        steps=(),
        vertices_before=len(surface.points),
        vertices=len(surface.points),
        faces_before=len(surface.faces),
        faces=len(surface.faces),
        file_to_surface_mm=none,
        surface_to_file_mm=none,
        displacement_max_mm=0.0,
        area_before_mm2=area,
        area_mm2=area,
        filled_area_mm2=0.0,
        volume_before_ml=volume,
        volume_ml=volume,
        relative_area_change=0.0,
        relative_volume_change=0.0,
    )
