"""The certificate of a mesh: a verdict, every number beside the limit it is judged by, and where and why it fails.

A mesh can have q_max < 0.6 with two banks of a sulcus fused, and can be a perfect ball far from its surface. So the
verdict covers elements, volumes, the topology of the boundary, its crossings, and its distance to the surface in both
directions: a sulcus that was filled leaves every node on the surface, and changes no topology. The certificate holds no
date and no time: the same mesh gets the same file.
"""

from __future__ import annotations

import operator
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cortet import __version__
from cortet.errors import StageError
from cortet.formats.hashing import sha256
from cortet.geometry.defects import defective_vertices
from cortet.geometry.filling import flaws
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import (
    SurfaceTopology,
    boundary_faces,
    boundary_surface,
    enclosed_volume,
    surface_topology,
    used_vertices,
)
from cortet.measure.fidelity import Fidelity, fidelity
from cortet.measure.lost import LostPlace, lost_places
from cortet.measure.quality import QualitySummary, quality, signed_volumes, summarise
from cortet.measure.regions import (
    InterfaceRecord,
    RegionRecord,
    interface_records,
    region_records,
    sheets_of,
)
from cortet.measure.worst import ValenceBound, WorstElement, fans, valence_bound, worst_elements
from cortet.mesh import FloatArray, TetMesh, TriSurface

VERSION: int = 4

#: relative difference allowed between the sum of volumes and the volume inside the boundary
VOLUME_TOLERANCE = 1e-9
#: how many places of one kind are listed
PLACES = 10
#: distributions whose versions can change a mesh or its numbers
LIBRARIES = ("numpy", "scipy", "numba", "nibabel", "meshio", "pymeshlab", "pygalmesh", "cgal", "tetgen", "gmsh")

Comparison = Literal["<", "<=", "=="]
_COMPARE: dict[Comparison, Callable[[float, float], bool]] = {"<": operator.lt, "<=": operator.le, "==": operator.eq}
_WORDS: dict[Comparison, str] = {"<": "must be below", "<=": "must not exceed", "==": "must be"}

_SURFACE_DISTANCE = "distance of the surface to the boundary, at most"
_LOSS_REMEDY = "use a smaller cell size, or the mesher `lattice`, whose edges follow the shape"
_TOPOLOGY_REMEDY = "add a smaller fraction to `generate.facet_distance`, or use a smaller cell size"


@dataclass(frozen=True)
class Check:
    """One number and the limit it is judged by."""

    name: str
    value: float
    #: empty for counts and ratios
    unit: str
    #: None where the number is reported without a limit
    comparison: Comparison | None
    limit: float | None
    passed: bool
    #: what to change when it does not pass
    remedy: str

    @property
    def finding(self) -> str:
        """Name, value and limit in plain words."""
        unit = f" {self.unit}" if self.unit else ""
        limit = f"{_WORDS[self.comparison]} {self.limit:g}{unit}" if self.comparison else "no limit"
        return f"{self.name} {self.value:.6g}{unit}, {limit}"


@dataclass(frozen=True)
class Certificate:
    """Everything there is to say about one mesh; `dataclasses.asdict` gives the content of certificate.json."""

    #: name of the case, e.g. sub-01_ses-02_hemi-L
    case: str
    certified: bool
    #: why not, in plain words, with place and remedy; empty when certified
    reasons: tuple[str, ...]
    checks: tuple[Check, ...]
    #: worst first
    worst_elements: tuple[WorstElement, ...]
    valence_bound: ValenceBound
    #: parts of the surface that the boundary does not follow within the limit, the first few
    lost_places: tuple[LostPlace, ...]
    #: boundary vertices where it is open, pinched or fused, the first few
    defects_mm: tuple[tuple[float, ...], ...]
    #: centres of faces of the boundary or of an interface that cross others, the first few
    crossings_mm: tuple[tuple[float, ...], ...]
    quality: QualitySummary
    fidelity: Fidelity
    #: of the boundary
    topology: SurfaceTopology
    #: the regions of a mesh with inner surfaces, and what is between them; empty for one of a single region
    regions: tuple[RegionRecord, ...]
    interfaces: tuple[InterfaceRecord, ...]
    #: `file` and `sha256` of the input surface
    input: dict[str, str]
    #: whether it, or one of its inner surfaces, was repaired; `reports.repair` says what was done, and how far it went
    input_repaired: bool
    #: stage -> its parameters
    parameters: dict[str, Any]
    #: stage -> its report
    reports: dict[str, Any]
    #: name -> version
    versions: dict[str, str]


def certify(
    mesh: TetMesh,
    surface: TriSurface,
    *,
    q_max: float = 0.6,
    max_boundary_distance: float | None = 1e-3,
    cell_size: float | None = None,
    max_surface_distance: float | None = 0.5,
    max_mean_surface_distance: float | None = 0.1,
    max_area_change: float | None = 0.05,
    max_volume_change: float | None = 0.1,
    case: str = "",
    source: str | Path | None = None,
    parameters: Mapping[str, Any] | None = None,
    reports: Mapping[str, Any] | None = None,
) -> Certificate:
    """Judge a mesh.

    Parameters
    ----------
    mesh : the mesh to be exported
    surface : the closed surface it was made from; the boundary must have its Euler number, and each interface that of
        its inner surface
    q_max : limit that the worst q must stay below
    max_boundary_distance : mm, largest distance of a boundary node to `surface`
    cell_size : mm; None where it is not known, and the two limits that are fractions of it do not hold
    max_surface_distance, max_mean_surface_distance : fractions of `cell_size`, distance of points of `surface` to the
        boundary, largest and mean
    max_area_change, max_volume_change : relative change of area and of volume against `surface`, of either sign
    (of all limits, None reports the number without one)
    case : name of the case
    source : file of the input surface, to be identified by its hash
    parameters, reports : stage -> what it ran with and what it reported; S1's findings about topology are judged too

    Raises
    ------
    StageError
        coordinates are not finite, or there is no boundary, so nothing can be measured
    InputError
        `source` cannot be read
    """
    if bad := int((~np.isfinite(mesh.points)).any(axis=1).sum()):
        raise StageError(f"{bad} of {len(mesh.points)} nodes have coordinates that are not finite")
    reports = dict(reports or {})
    found = flaws(mesh)
    if not len(boundary_faces(mesh)):
        counted = "; ".join(flaw.sentence for flaw in found if flaw.count)
        raise StageError(f"every face is in two tetrahedra or more, so the mesh has no boundary: {counted}")
    boundary, _ = boundary_surface(mesh)
    topology = surface_topology(boundary.faces)
    measured, faithful = summarise(mesh), fidelity(mesh, surface)
    walls = sheets_of(mesh) if surface.inner else boundary  # beginning with the boundary
    crossing = self_intersections(walls)
    regions = region_records(mesh, surface) if surface.inner else ()
    interfaces = interface_records(mesh, surface) if surface.inner else ()
    around = fans(mesh)
    worst = worst_elements(mesh, around, count=PLACES, stages=reports)
    defects = boundary.points[defective_vertices(boundary.faces)[:PLACES]]
    centres = walls.points[walls.faces[crossing[:PLACES]]].mean(axis=1)

    volumes = signed_volumes(mesh.points, mesh.cells)
    enclosed = enclosed_volume(boundary.points, boundary.faces)
    checks = (
        _check("worst q", measured.q.max, "<", q_max, remedy=worst[0].remedy),
        _check("tetrahedra without positive volume", int((volumes <= 0).sum()), "==", 0),
        _check(
            "relative difference between the sum of volumes and the enclosed volume",
            _relative_difference(float(volumes.sum()), enclosed),
            "<=",
            VOLUME_TOLERANCE,
        ),
        *(_check(flaw.name, flaw.count, "==", 0) for flaw in found),
        _check("unused nodes", len(mesh.points) - len(used_vertices(mesh.cells, len(mesh.points))), "==", 0),
        *_topology_checks(topology, surface_topology(surface.faces).euler_number),
        *_meshing_checks(reports.get("generate")),
        _check("boundary faces that cross others", len(crossing), "==", 0, remedy=_TOPOLOGY_REMEDY),
        _check(
            "distance of a boundary node to the surface, at most",
            faithful.nodes_to_surface_mm.max,
            "<=" if max_boundary_distance is not None else None,
            max_boundary_distance,
            unit="mm",
            remedy="use `boundary: slide` in `clean` and `fixed` in `relocate`, or switch `snap` on",
        ),
        *_loss_checks(
            faithful,
            largest=_times(max_surface_distance, cell_size),
            mean=_times(max_mean_surface_distance, cell_size),
            area=max_area_change,
            volume=max_volume_change,
        ),
        *_region_checks(regions, volume=max_volume_change),
        *_interface_checks(
            interfaces,
            nodes=max_boundary_distance,
            largest=_times(max_surface_distance, cell_size),
            mean=_times(max_mean_surface_distance, cell_size),
            area=max_area_change,
        ),
    )
    limit = _times(max_surface_distance, cell_size)
    lost: list[LostPlace] = []
    if limit is not None and faithful.surface_to_boundary_mm.max > limit:
        lost = lost_places(boundary, surface, limit=limit)
    places = {
        "worst q": _worst_place(worst[0], int((quality(mesh.points, mesh.cells) >= q_max).sum())),
        **{flaw.name: _first(flaw.places) for flaw in found if flaw.count},
        "boundary faces that cross others": _first(centres),
        **dict.fromkeys(_PLACED_DEFECTS, _first(defects)),
        _SURFACE_DISTANCE: _lost(lost),
        "topology problems after S1": reports.get("generate", {}).get("reason", ""),
    }
    return Certificate(
        case=case,
        certified=all(check.passed for check in checks),
        reasons=tuple(_reason(check, places.get(check.name, "")) for check in checks if not check.passed),
        checks=checks,
        worst_elements=worst,
        valence_bound=valence_bound(around),
        lost_places=tuple(lost[:PLACES]),
        defects_mm=tuple(map(tuple, defects.tolist())),
        crossings_mm=tuple(map(tuple, centres.tolist())),
        quality=measured,
        fidelity=faithful,
        topology=topology,
        regions=regions,
        interfaces=interfaces,
        input={} if source is None else {"file": str(source), "sha256": sha256(source)},
        input_repaired=_repaired(reports.get("repair", {})),
        parameters=dict(parameters or {}),
        reports=reports,
        versions=versions(reports),
    )


def versions(reports: Mapping[str, Any]) -> dict[str, str]:
    """Versions of cortet, Python and the installed libraries that can change a mesh or its numbers.

    Parameters
    ----------
    reports : stage -> what it reported; a program that S4 called is named there
    """
    found = {"cortet": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    if program := reports.get("clean", {}).get("program_version"):
        found["meshtool"] = program
    return found


def _repaired(report: Mapping[str, Any]) -> bool:
    """Whether the report of `repair` is of a surface that was repaired, or holds one of an inner surface that was."""
    within = report.get("inner", {}).values()
    return any(bool(one.get("repaired")) for one in (report, *within))


def _check(
    name: str, value: float, comparison: Comparison | None, limit: float | None, *, unit: str = "", remedy: str = ""
) -> Check:
    passed = comparison is None or limit is None or _COMPARE[comparison](value, limit)
    return Check(name, value, unit, comparison, limit, passed, remedy)


#: checks whose failures have a place
_PLACED_DEFECTS = (
    "boundary edges in one face only",
    "boundary edges in more than two faces",
    "pinched boundary vertices",
)


def _topology_checks(boundary: SurfaceTopology, euler_number: int) -> Iterator[Check]:
    wanted = {
        "boundary components": (boundary.components, 1),
        "boundary Euler number": (boundary.euler_number, euler_number),
        "boundary edges in one face only": (boundary.open_edges, 0),
        "boundary edges in more than two faces": (boundary.nonmanifold_edges, 0),
        "boundary edges between inconsistently oriented faces": (boundary.misoriented_edges, 0),
        "pinched boundary vertices": (boundary.pinched_vertices, 0),
    }
    for name, (value, limit) in wanted.items():
        yield _check(name, value, "==", limit, remedy=_TOPOLOGY_REMEDY)


def _region_checks(regions: Sequence[RegionRecord], *, volume: float | None) -> Iterator[Check]:
    for one in regions:
        yield _check(f"tetrahedra of region {one.name}: none", int(one.tetrahedra == 0), "==", 0)
        yield _check(
            f"relative change of the volume of region {one.name}",
            abs(one.relative_volume_change),
            None if volume is None else "<=",
            volume,
            remedy=_LOSS_REMEDY,
        )


def _interface_checks(
    interfaces: Sequence[InterfaceRecord],
    *,
    nodes: float | None,
    largest: float | None,
    mean: float | None,
    area: float | None,
) -> Iterator[Check]:
    for one in interfaces:
        genus = (2 - one.surface_euler_number) // 2
        problems = one.topology.problems(genus)
        remedy = "; ".join([*problems, "use a smaller cell size, or a larger regions.min_gap"])
        yield _check(f"topology problems of the interface {one.name}", len(problems), "==", 0, remedy=remedy)
        yield _check(
            f"faces of the interface {one.name} that are not between {one.name} and {one.around}",
            one.misplaced_faces,
            "==",
            0,
        )
        for what, value, limit, unit in (
            (
                "distance of a node of the interface {} to its surface, at most",
                one.nodes_to_surface_mm.max,
                nodes,
                "mm",
            ),
            ("distance of the surface {} to the interface, at most", one.surface_to_interface_mm.max, largest, "mm"),
            ("distance of the surface {} to the interface, on average", one.surface_to_interface_mm.mean, mean, "mm"),
            ("relative change of the area of the interface {}", abs(one.relative_area_change), area, ""),
        ):
            comparison: Comparison | None = None if limit is None else "<="
            yield _check(what.format(one.name), value, comparison, limit, unit=unit, remedy=_LOSS_REMEDY)


def _meshing_checks(report: Mapping[str, Any] | None) -> Iterator[Check]:
    """What S1 found wrong with the topology; a later stage can hide it, not undo it."""
    if report is not None:
        yield _check("topology problems after S1", int(not report["topology_ok"]), "==", 0, remedy=_TOPOLOGY_REMEDY)


def _relative_difference(one: float, other: float) -> float:
    """Of two volumes, by the larger of them; 0 where both are."""
    largest = max(abs(one), abs(other))
    return abs(one - other) / largest if largest else 0.0


def _times(fraction: float | None, length: float | None) -> float | None:
    """A fraction of a length; None where one of them is not given."""
    return None if fraction is None or length is None else fraction * length


def _loss_checks(
    found: Fidelity, *, largest: float | None, mean: float | None, area: float | None, volume: float | None
) -> Iterator[Check]:
    """How much of the surface the mesh does not follow: distances in mm, changes relative."""
    distance = found.surface_to_boundary_mm
    for name, value, limit, unit in (
        (_SURFACE_DISTANCE, distance.max, largest, "mm"),
        ("distance of the surface to the boundary, on average", distance.mean, mean, "mm"),
        ("relative change of the area", abs(found.relative_area_change), area, ""),
        ("relative change of the volume", abs(found.relative_volume_change), volume, ""),
    ):
        yield _check(name, value, None if limit is None else "<=", limit, unit=unit, remedy=_LOSS_REMEDY)


def _lost(places: Sequence[LostPlace]) -> str:
    """Where the surface is not followed, in words; nothing where it is."""
    if not places:
        return ""
    counted = {kind: sum(place.kind == kind for place in places) for kind in ("filled", "cut off")}
    parts = [
        f"{counted['filled']} where a sulcus is filled" if counted["filled"] else "",
        f"{counted['cut off']} where a blade or tip is cut off" if counted["cut off"] else "",
    ]
    count = f"{len(places)} place{'s' if len(places) > 1 else ''} beyond the limit"
    worst = f"the worst, {places[0].kind}, at {_point(places[0].place_mm)} mm"
    return f"{count}: {' and '.join(filter(None, parts))}, {worst}"


def _reason(check: Check, place: str) -> str:
    return "; ".join(part for part in (check.finding, place, check.remedy) if part)


def _worst_place(worst: WorstElement, bad: int) -> str:
    count = f"{bad} element{'s' if bad > 1 else ''} at fault, the worst"
    return f"{count} at {_point(worst.centre_mm)} mm: {worst.reason}"


def _first(places: FloatArray) -> str:
    return "the first around " + ", ".join(map(_point, places[:3])) + " mm"


def _point(coordinates: Iterable[float]) -> str:
    return "({})".format(", ".join(f"{x:.2f}" for x in coordinates))
