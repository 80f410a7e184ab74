"""Steps that repair a broken surface, in the order that changes it least."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.config.stages import Repair
from cortet.errors import InputError, counted, place_mm
from cortet.geometry import mending
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.handles import without_handles
from cortet.geometry.holes import capped, closed_volume, replaced, rim_length, rims
from cortet.geometry.interpolation import at_triangles
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import CAP, REPLACED, Triangles, flat_faces
from cortet.geometry.orientation import outward
from cortet.geometry.topology import enclosed_volume, face_normals, neighbour_means, surface_topology
from cortet.geometry.uncrossing import uncrossed
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FILLED, FloatArray, IntArray, TriSurface, single_precision

#: most locations listed of one kind, and their least distance from each other, mm
PLACES, APART_MM = 10, 5.0
#: vertices of open edges coincide within this share of the longest side: the rounding of single precision
_ROUNDING = 1e-6
#: a vertex is a spike if its distance from the middle of its neighbours exceeds this many mean edges around it
_SPIKE = 5.0
#: and if its faces point so differently that their normals add up to less than this share of their areas, as those of a
#: cone do whose sides are steeper than 60 degrees; the hub of a flat fan lies off the middle without standing out
_STEEP = 0.5
#: and if its faces are less than this share of the area: a cone is a shape, and its tip no flaw
_SMALL = 0.1
#: triangles of which the largest piece has less than this share of the area are no surface with a few loose parts
_LEAST_KEPT = 0.5
#: the copies of a split vertex move this share of the way to the middle of their neighbours, so that they separate
_PARTED = 0.1


@dataclass(frozen=True)
class RepairStep:
    """One kind of flaw, and what was done to it."""

    #: what was done, in words
    done: str
    #: how many things it was done to
    count: int
    of: str
    #: the first few locations that are apart from each other
    places_mm: tuple[tuple[float, ...], ...]


def has_flaw(surface: TriSurface, allow_genus: int) -> bool:
    """Whether there is anything to repair."""
    if not (mending.finite(surface.points).all() and len(surface.faces)):
        return True
    topology = surface_topology(surface.faces)
    return (
        not topology.is_closed_manifold
        or topology.genus > allow_genus
        or bool(len(flat_faces(surface.points, surface.faces)))
        or bool(len(_spikes(surface.points, surface.faces)))
        or bool(len(self_intersections(surface)))
    )


def _spikes(points: FloatArray, faces: IntArray) -> IntArray:
    """Vertices that stand out, far from the middle of their neighbours relative to the edges between the neighbours."""
    away = np.linalg.norm(points - neighbour_means(points, faces), axis=1)
    corners = points[faces]
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    vertex, count = faces.ravel(), len(points)
    ring = np.bincount(vertex, opposite.ravel(), minlength=count) / np.maximum(np.bincount(vertex, minlength=count), 1)
    normals = np.repeat(face_normals(points, faces) / 2, 3, axis=0)
    area = np.bincount(vertex, np.linalg.norm(normals, axis=1), count)
    total = [np.bincount(vertex, of_axis, count) for of_axis in normals.T]
    steep = np.linalg.norm(total, axis=0) < _STEEP * area
    small = 3 * area < _SMALL * area.sum()  # the sum counts each face at its three corners
    return np.flatnonzero((away > _SPIKE * ring) & steep & small).astype(np.int32)


class BrokenSurface:
    """A surface under repair, with what has been done to it so far."""

    def __init__(self, surface: TriSurface, limits: Repair, allow_genus: int) -> None:
        self.given, self.limits, self.allow_genus = surface, limits, allow_genus
        points = surface.points.astype(np.float32).astype(np.float64)
        self.work = mending.triangles(points, surface.faces)
        #: (n,), vertices of the file whose faces this repair removed: a hole there is not in the file
        self.touched = np.zeros(len(points), np.bool_)
        self.steps: list[RepairStep] = []
        #: mm, how far crossing triangles were moved
        self.displacement = 0.0
        #: mm3, with the holes of the file filled
        self.volume_before = 0.0
        #: mm3, between the caps on these holes and flat ones
        self.bulge = 0.0
        #: mm2, of separate pieces
        self.dropped = 0.0

    def set_right(self) -> None:
        """Run all steps in their order."""
        for step in (
            self._unknown_places,
            self._coinciding,
            self._duplicates,
            self._branches,
            self._small_pieces,
            self._orientation,
            self._holes,
            self._misshapen,
            self._handles,
            self._crossings,
        ):
            step()
            if not len(self.work.faces):
                raise InputError("repair would remove every triangle", remedy="export the surface again")

    def result(self) -> TriSurface:
        """The repaired surface with its fields, if it is one closed manifold and within the limits."""
        work = self.work = mending.compacted(self.work)
        made = single_precision(TriSurface(work.points, work.faces))
        topology = surface_topology(made.faces)
        problems = topology.problems(genus=int(topology.genus))
        problems += [counted(count, "self-intersecting triangle") for count in [len(self_intersections(made))] if count]
        problems += [counted(count, "flat triangle") for count in [len(flat_faces(made.points, made.faces))] if count]
        if problems:
            raise InputError(f"after repair the surface still has {'; '.join(problems)}")
        volume = enclosed_volume(made.points, made.faces)
        change = volume / self.volume_before - 1 if self.volume_before else np.inf
        if abs(change) > self.limits.max_volume_change:
            raise InputError(
                f"repair would change the volume by {change:+.1%}; at most {self.limits.max_volume_change:.1%} is "
                f"allowed ({self.done()})",
                remedy="edit the surface, or raise repair.max_volume_change",
            )
        return replace(made, point_data=self._fields(made), frame=self.given.frame, inner=self.given.inner)

    def done(self) -> str:
        """What was done, in words."""
        steps = [f"{step.count} {step.done}" for step in self.steps]
        return "; ".join(steps) or "coordinates rounded to float32"

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

    def _branches(self) -> None:
        count = len(self.work.points)
        self.work, centres, cut = mending.without_branches(self.work)
        if len(centres):
            self.touched[cut] = True
            self._note("edges in more than two triangles split", len(centres), "edges", centres)
        work, vertices = mending.split_fans(self.work)
        if len(vertices):
            self._replace(work, "vertices with several fans of triangles split", len(vertices), "vertices", vertices)
        self._part(count)

    def _part(self, count: int) -> None:
        """Move the copies of split vertices, numbered from `count`, a little towards their own triangles."""
        copies = np.arange(count, len(self.work.points))
        parted = np.flatnonzero(np.isin(self.work.origin, self.work.origin[copies]))
        if len(parted):
            points = self.work.points.copy()
            points[parted] += _PARTED * (neighbour_means(points, self.work.faces)[parted] - points[parted])
            points[~np.isfinite(points)] = 0  # no triangle uses these vertices any more
            self.work = self.work._replace(points=points)

    def _small_pieces(self) -> None:
        piece, area = mending.pieces(self.work)
        share = area / area.sum()
        large = np.flatnonzero(share > self.limits.max_piece)
        if len(large) > 1:
            shares = ", ".join(f"{value:.1%}" for value in share[large[:4]])
            where = in_mm(np.array([self._middle(piece == number) for number in large[:2]]))
            if walls := self._inside_the_first(piece, large):
                raise InputError(
                    f"{walls} of {len(large)} pieces lie inside the largest, such as the walls of a ventricle; "
                    f"shares of the area: {shares}; centres: {where}",
                    remedy="give the outer surface alone, and the others as inner surfaces (--inner NAME=FILE)",
                )
            raise InputError(
                f"the surface has {len(large)} separate pieces, and cortet cannot tell which one to mesh; "
                f"shares of the area: {shares}; centres: {where}",
                remedy=f"keep one of the pieces, or raise repair.max_piece (now {self.limits.max_piece:g})",
            )
        if share[0] < _LEAST_KEPT and self.limits.max_piece < _LEAST_KEPT:
            raise InputError(
                f"the surface has {len(area)} pieces, of which the largest has {share[0]:.1%} of the area",
                remedy="export the surface again: its triangles do not belong together",
            )
        if len(area) > 1:
            centres = np.array([self._middle(piece == number) for number in range(1, min(len(area), PLACES + 1))])
            self._note("small separate pieces dropped", len(area) - 1, "pieces", centres)
            self.dropped = float(area[1:].sum())
            self.work = mending.chosen_faces(self.work, piece == 0)

    def _inside_the_first(self, piece: IntArray, large: NDArray[np.int64]) -> int:
        """How many of the `large` pieces, all closed, lie inside the first of them."""
        faces = [self.work.faces[piece == number] for number in large]
        if not all(surface_topology(one).is_closed_manifold for one in faces):
            return 0
        points = np.array([self.work.points[one[0, 0]] for one in faces[1:]])
        winding = winding_numbers(TriSurface(self.work.points, faces[0]), points)
        return int((np.abs(winding) > 0.5).sum())

    def _orientation(self) -> None:
        topology = surface_topology(self.work.faces)
        turned = outward(self.work.points, self.work.faces)
        changed = np.flatnonzero((turned != self.work.faces).any(axis=1))
        if topology.misoriented_edges:
            places = self.work.faces[changed, 0]
            self._note("triangles turned outward", len(changed), "faces", self.work.points[places])
        self.work = self.work._replace(faces=turned)
        if surface_topology(turned).misoriented_edges:
            what = "the surface is not orientable, so it has no inside"
            raise InputError(what, remedy="export the surface again")
        if closed_volume(self.work) < 0:
            self.work = self.work._replace(faces=np.ascontiguousarray(turned[:, ::-1]))

    def _holes(self) -> None:
        found = rims(self.work.faces)
        for rim in found:
            length = rim_length(self.work.points, rim)
            if length > self.limits.max_hole:
                where, rounded = in_mm(self.work.points[rim].mean(axis=0)), math.ceil(10 * length) / 10
                most = self.limits.max_hole
                raise InputError(
                    f"the hole at {where} has a rim of {rounded:g} mm, longer than the limit of {most:g} mm",
                    remedy="close the hole, or raise repair.max_hole",
                )
        # the file had no hole where the steps above removed faces
        ours = [bool(self.touched[self.work.origin[rim]].any()) for rim in found]
        cut, of_file = ([rim for rim, own in zip(found, ours, strict=True) if own == which] for which in (True, False))
        if of_file:
            middles = np.array([self.work.points[rim].mean(axis=0) for rim in of_file])
            longest = max(rim_length(self.work.points, rim) for rim in of_file)
            self._note(f"holes filled, with a rim of up to {longest:.1f} mm", len(of_file), "holes", middles)
        for rim, made in [*((rim, CAP) for rim in of_file), *((rim, REPLACED) for rim in cut)]:
            faces = len(self.work.faces)
            self.work = capped(self.work, rim, made)
            if made == CAP:
                self.bulge += abs(
                    closed_volume(mending.chosen_faces(self.work, np.arange(len(self.work.faces)) >= faces))
                )
        self.volume_before = enclosed_volume(self.work.points, self.work.faces)

    def _misshapen(self) -> None:
        """Cut out flat triangles and spikes, and close the holes smoothly."""
        work = self.work = mending.compacted(self.work)
        if len(spikes := _spikes(work.points, work.faces)):
            self._note("spikes cut off", len(spikes), "vertices", work.points[spikes])
            cut = replaced(work, spikes, self.limits.max_piece, counted(len(spikes), "spike"))
            work = self.work = mending.compacted(cut)
        if len(flat := work.faces[flat_faces(work.points, work.faces)]):
            self._note("triangles without area replaced", len(flat), "faces", work.points[flat].mean(axis=1))
            self.work = replaced(work, flat.ravel(), self.limits.max_piece, counted(len(flat), "flat triangle"))

    def _handles(self) -> None:
        limits = self.limits
        cuts = without_handles(
            mending.compacted(self.work), keep=self.allow_genus, max_loop=limits.max_loop, max_piece=limits.max_piece
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
                f"repairing {len(found.centres)} self-intersecting triangles would move the surface by "
                f"{found.displacement:.2f} mm at {in_mm(found.place)}; at most {limits.max_displacement:g} mm is "
                "allowed",
                remedy="edit the surface there, or raise repair.max_displacement",
            )

    def _fields(self, made: TriSurface) -> dict[str, NDArray[Any]]:
        """The file's values at its vertices; at a new vertex, those of the nearest point of the file."""
        fields: dict[str, NDArray[Any]] = {}
        new = np.flatnonzero(self.work.origin < 0)
        if self.given.point_data and len(new):
            file = mending.measurable(self.given)
            found = closest_points(tree_of(file), made.points[new])
            corners = file.faces[found.faces]
        for name, values in self.given.point_data.items():
            taken = values[np.maximum(self.work.origin, 0)].copy()
            if len(new):
                taken[new] = at_triangles(values, corners, found.barycentric)
            fields[name] = taken
        if (self.work.made == CAP).any():
            filled = np.ones(len(made.points), np.int32)
            filled[made.faces[self.work.made != CAP]] = 0
            fields[FILLED] = filled
        return fields

    def _neighbours(self, vertices: IntArray) -> IntArray:
        """Vertices with finite coordinates in the faces at some vertices."""
        near = self.work.faces[np.isin(self.work.faces, vertices).any(axis=1)]
        return np.setdiff1d(near, np.flatnonzero(~mending.finite(self.work.points)))

    def _replace(self, work: Triangles, done: str, count: int, of: str, vertices: IntArray) -> None:
        self._note(done, count, of, self.work.points[vertices])
        self.work = work

    def _note(self, done: str, count: int, of: str, places: FloatArray) -> None:
        listed = tuple(map(tuple, _apart(np.atleast_2d(places)).round(3).tolist()))
        done, of = (_singular(words) if count == 1 else words for words in (done, of))
        self.steps.append(RepairStep(done, count, of, listed))

    def _middle(self, faces: NDArray[np.bool_]) -> FloatArray:
        middle: FloatArray = self.work.points[self.work.faces[faces]].mean(axis=(0, 1))
        return middle


def _singular(words: str) -> str:
    """What was done to several things, as it is said of one."""
    plural = r"vertices|(triangle|face|edge|piece|hole|spike|handle)s"
    one = re.sub(plural, lambda found: found[1] or "vertex", words, count=1)
    return one.replace("tunnels", "tunnel")


def in_mm(places: FloatArray) -> str:
    """Locations (k, 3) or (3,), mm, as messages name them."""
    return " and ".join(place_mm(place) for place in np.atleast_2d(places).tolist())


def _apart(places: FloatArray) -> FloatArray:
    """The first few of the locations (k, 3), each farther than `APART_MM` from those before it."""
    listed: list[FloatArray] = []
    while len(places) and len(listed) < PLACES:
        listed.append(places[0])
        places = places[np.linalg.norm(places - places[0], axis=1) > APART_MM]
    return np.array(listed).reshape(-1, 3)
