"""The certificate of a mesh: a verdict, every number beside its limit, and where and why the mesh fails.

A mesh can have q_max < 0.6 and still fuse two banks of a sulcus, or be a perfect ball far from its surface. So the
verdict covers elements, volumes, the topology of the boundary, its crossings, and its distance to the surface. The
distance is measured in both directions: a filled sulcus leaves every node on the surface and changes no topology.
The certificate holds no date and no time, so the same mesh gets the same file.
"""

from __future__ import annotations

import html
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from cortet.config.sections import Certify
from cortet.errors import InputError, StageError, counted, place_mm
from cortet.formats.certificates import SCHEMA
from cortet.formats.hashing import input_sha256, mesh_sha256
from cortet.geometry.banks import Banks, banks
from cortet.geometry.filling import flaws
from cortet.geometry.intersection import self_intersections
from cortet.geometry.limits import CELL_SIZE_MM, require_within
from cortet.geometry.mending import defective_vertices
from cortet.geometry.nesting import sheets
from cortet.geometry.topology import (
    SurfaceTopology,
    boundary_faces,
    boundary_surface,
    enclosed_volume,
    surface_topology,
    used_vertices,
)
from cortet.measure.checks import (
    Check,
    Number,
    checked,
    fidelity_numbers,
    interface_numbers,
    limits_in_mm,
    native_numbers,
    remedies,
    smaller_cells,
    topology_numbers,
)
from cortet.measure.electrodes import ElectrodeRecord, electrode_remarks
from cortet.measure.fidelity import Fidelity, Native, fidelity, native_record
from cortet.measure.layers import LayerRecord, layer_records
from cortet.measure.lost import LostPlace, lost_places
from cortet.measure.quality import QualitySummary, quality, signed_volumes, summarise
from cortet.measure.regions import (
    InterfaceRecord,
    RegionRecord,
    interface_records,
    region_records,
    require_known_regions,
    sheets_of,
)
from cortet.measure.remarks import remarks
from cortet.measure.verdict import bulging_share, relaxed_limits, repaired_share, surfaces_of, verdict_in_words
from cortet.measure.worst import ValenceBound, WorstElement, fans, valence_bound, worst_elements
from cortet.meshes import FloatArray, TetMesh, TriSurface, require_measurable
from cortet.version import __version__

VERSION: int = 16

#: relative difference allowed between the sum of volumes and the volume inside the boundary
VOLUME_TOLERANCE = 1e-9
#: remedy for a surface of which repair made too much
_COMPLETE = "complete the surface, or raise this limit if the missing part does not matter"
#: most locations of one kind to list
PLACES = 10
#: distributions whose versions can change a mesh or its numbers
LIBRARIES = ("numpy", "scipy", "numba", "nibabel", "meshio", "pymeshlab", "pygalmesh", "cgal", "tetgen", "gmsh")


@dataclass(frozen=True)
class Certificate:
    """All that is certified about one mesh; `formats.certificates` has its file."""

    #: version of this content, `SCHEMA`
    schema: int
    #: name of the case, e.g. sub-01_ses-02_hemi-L
    case: str
    certified: bool
    #: the verdict in words, with the part of the surface that was repaired, and the limits that are weaker than usual
    verdict: str
    #: the limits that are weaker than those of the default preset, in words; empty if none is
    relaxed: str
    #: why the mesh is not certified, in plain words, with location and remedy; empty if it is certified
    reasons: tuple[str, ...]
    #: what should be known of a mesh even if it is certified, such as how far a repair went
    remarks: tuple[str, ...]
    checks: tuple[Check, ...]
    #: worst first
    worst_elements: tuple[WorstElement, ...]
    valence_bound: ValenceBound
    #: the first few parts of the surface that are farther from the boundary than the limit
    lost_places: tuple[LostPlace, ...]
    #: the first few boundary vertices at which the boundary is open, pinched or fused
    defects_mm: tuple[tuple[float, ...], ...]
    #: centres of the first few boundary or interface faces that cross others
    crossings_mm: tuple[tuple[float, ...], ...]
    quality: QualitySummary
    fidelity: Fidelity
    banks: Banks
    #: None if the native surface is not given, or has no triangle with finite coordinates
    native: Native | None
    #: topology of the boundary
    topology: SurfaceTopology
    #: the regions of a mesh with inner surfaces; empty for a mesh of a single region
    regions: tuple[RegionRecord, ...]
    interfaces: tuple[InterfaceRecord, ...]
    #: the layers of the cortex, if some are asked for
    layers: tuple[LayerRecord, ...]
    #: the contacts of electrodes, if there are any
    electrodes: tuple[ElectrodeRecord, ...]
    #: `file` and `sha256` of the input surface
    input: dict[str, str]
    #: hash of the nodes and tetrahedra, which identifies the mesh
    mesh_sha256: str
    #: whether the surface or an inner surface was repaired; `reports.repair` says what was done and how far it went
    input_repaired: bool
    #: stage -> its parameters
    parameters: dict[str, Any]
    #: stage -> its report
    reports: dict[str, Any]
    #: name -> version
    versions: dict[str, str]

    def __repr__(self) -> str:
        q, passed = self.quality.q, sum(check.passed for check in self.checks)
        return (
            f"<Certificate: {self.verdict}, "
            f"{passed} of {len(self.checks)} checks passed\n"
            f" {self.quality.tets:,} tetrahedra, worst q {q.max:.3f}, mean {q.mean:.3f}\n"
            f" {'; '.join(self.reasons or self.remarks) or 'no remarks'}>"
        )

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{'✓' if check.passed else '✗'}</td>"
            f'<td style="text-align: left">{html.escape(check.finding)}</td></tr>'
            for check in self.checks
        )
        return f"<table>{rows}</table>"


def certify(
    mesh: TetMesh,
    surface: TriSurface,
    limits: Certify = Certify(),
    *,
    cell_size: float | None = None,
    native: TriSurface | None = None,
    case: str = "",
    source: str | Path | None = None,
    parameters: Mapping[str, Any] | None = None,
    reports: Mapping[str, Any] | None = None,
    layers: Sequence[float] | None = None,
) -> Certificate:
    """Check a mesh.

    Parameters
    ----------
    mesh : the mesh to be exported
    surface : the closed surface that was meshed; the boundary must have its Euler number, and each interface that of
        its inner surface
    limits : as `Certify` describes them; a number whose limit is None is reported, not checked
    cell_size : mm; if None, the limits that are fractions of it are not checked
    native : mm, the surface as it was read, or of a repaired surface as repair made it, before smoothing; it may be
        broken. None: the mesh is not compared with it
    case : name of the case
    source : file of the input surface, which is identified by its hash
    parameters, reports : stage -> its parameters and its report; the topology that S1 reports is checked too
    layers : of the cortex, as `measure.layers.bounds_of` takes them

    Raises
    ------
    StageError : the mesh has no boundary, so nothing can be measured
    InputError : the cell size is larger than the surface
    """
    if cell_size is not None:
        require_within(cell_size, CELL_SIZE_MM, "the cell size in mm")
    require_measurable(mesh)
    for one in sheets(surface):
        require_measurable(one)
    if cell_size is not None and (length := float(np.ptp(surface.points, axis=0).max())) < cell_size:
        what = f"the surface is {length:.3g} mm long, shorter than one cell of {cell_size:g} mm"
        raise InputError(what, remedy="give coordinates in mm; if they are metres, multiply by 1000")
    if surface.inner:
        require_known_regions(mesh, surface)
    reports = dict(reports or {})
    if not len(boundary_faces(mesh)):
        found = "; ".join(flaw.sentence for flaw in flaws(mesh) if flaw.count)
        raise StageError(f"every face is in two tetrahedra or more, so the mesh has no boundary: {found}")
    boundary, _ = boundary_surface(mesh)
    walls = sheets_of(mesh) if surface.inner else boundary  # the boundary comes first
    crossing = self_intersections(walls)
    measured, faithful, around = summarise(mesh), fidelity(mesh, surface), fans(mesh)
    smaller = smaller_cells(None if measured.q.max < limits.q_max else cell_size)
    repairs, relaxed = reports.get("repair", {}), relaxed_limits(limits)
    regions = region_records(mesh, surface) if surface.inner else ()
    layered = layer_records(mesh, surface.inner, layers)
    in_mm = limits_in_mm(limits, cell_size)
    lost: list[LostPlace] = []
    if in_mm.max_surface_distance is not None and faithful.surface_to_boundary_mm.max > in_mm.max_surface_distance:
        lost = lost_places(boundary, surface, limit=in_mm.max_surface_distance)
    measurements = Certificate(
        schema=SCHEMA,
        case=case,
        certified=False,
        verdict="",
        relaxed=relaxed,
        reasons=(),
        remarks=remarks(reports, parameters or {}, regions, cell_size, layered if layers else None),
        checks=(),
        worst_elements=worst_elements(mesh, around, count=PLACES, limit=limits.q_max, stages=reports, smaller=smaller),
        valence_bound=valence_bound(around),
        lost_places=tuple(lost[:PLACES]),
        defects_mm=_in_tuples(boundary.points[defective_vertices(boundary.faces)[:PLACES]]),
        crossings_mm=_in_tuples(walls.points[walls.faces[crossing[:PLACES]]].mean(axis=1)),
        quality=measured,
        fidelity=faithful,
        banks=banks(boundary, surface),
        native=None if native is None else native_record(mesh, native),
        topology=surface_topology(boundary.faces),
        regions=regions,
        interfaces=interface_records(mesh, surface) if surface.inner else (),
        layers=layered,
        electrodes=(),
        input={} if source is None else {"file": str(source), "sha256": input_sha256(source)},
        mesh_sha256=mesh_sha256(mesh),
        input_repaired=bool(surfaces_of(repairs)),
        parameters=dict(parameters or {}),
        reports=reports,
        versions=versions(reports),
    )
    euler_number = surface_topology(surface.faces).euler_number
    checks = tuple(
        checked(number, cell_size) for number in _numbers(mesh, measurements, in_mm, euler_number, len(crossing))
    )
    places, certified = _places(mesh, measurements, limits, lost), all(check.passed for check in checks)
    repaired = repaired_share(repairs) if measurements.input_repaired else None
    return replace(
        measurements,
        certified=certified,
        verdict=verdict_in_words(certified=certified, relaxed=relaxed, repaired=repaired),
        reasons=tuple(
            "; ".join(filter(None, (check.finding, places.get(check.id, ""), check.remedy)))
            for check in checks
            if not check.passed
        ),
        checks=checks,
    )


def _numbers(mesh: TetMesh, found: Certificate, limits: Certify, euler_number: int, crossing: int) -> Iterator[Number]:
    """The numbers to check, in the order of the certificate.

    Parameters
    ----------
    limits : `limits_in_mm`
    euler_number : of the surface
    crossing : number of crossing faces
    """
    volumes, boundary = signed_volumes(mesh.points, mesh.cells), boundary_surface(mesh)[0]
    total, enclosed = float(volumes.sum()), enclosed_volume(boundary.points, boundary.faces)
    largest = max(abs(total), abs(enclosed))
    unused = len(mesh.points) - len(used_vertices(mesh.cells, len(mesh.points)))
    meshing = found.reports.get("generate")
    remedy = remedies((meshing or {}).get("mesher"))
    yield Number("worst_q", found.quality.q.max, limits.q_max, found.worst_elements[0].remedy)
    yield Number("flat_or_inverted_tetrahedra", int((volumes <= 0).sum()))
    yield Number("volume_balance", abs(total - enclosed) / largest if largest else 0.0, VOLUME_TOLERANCE)
    yield from (Number(flaw.id, flaw.count) for flaw in flaws(mesh))
    yield Number("unused_nodes", unused)
    yield from topology_numbers(found.topology, euler_number, remedy.topology)
    if meshing is not None:  # a later stage can hide a topology problem of S1, but not undo it
        yield Number("meshing_topology", int(not meshing["topology_ok"]), 0, remedy.topology)
    yield Number("crossing_faces", crossing, 0, remedy.topology)
    yield Number("bank_gap", found.banks.least_share, limits.min_bank_gap, remedy.loss)
    yield from fidelity_numbers(found.fidelity, limits, remedy.loss)
    if found.native is not None:
        yield from native_numbers(found.native, limits)
    if repairs := found.reports.get("repair"):
        yield Number("repaired_area", repaired_share(repairs), limits.max_repaired_area, _COMPLETE)
        yield Number("repaired_volume", bulging_share(repairs), limits.max_repaired_volume, _COMPLETE)
    for region in found.regions:
        change = abs(region.relative_volume_change)
        yield Number("region_tetrahedra", region.tetrahedra, 1, "", region.name)
        yield Number("region_volume_change", change, limits.max_volume_change, remedy.loss, region.name)
    for interface in found.interfaces:
        yield from interface_numbers(interface, limits, remedy.loss)


def _places(mesh: TetMesh, found: Certificate, limits: Certify, lost: Sequence[LostPlace]) -> dict[str, str]:
    """Identifier of a check -> where and why it fails, in words."""
    worst, gap = found.worst_elements[0], found.banks
    bad = int((quality(mesh.points, mesh.cells) >= limits.q_max).sum())
    return {
        "worst_q": f"{counted(bad, 'element')} at fault, the worst at {place_mm(worst.centre_mm)}: {worst.reason}",
        **{flaw.id: _first(flaw.places) for flaw in flaws(mesh) if flaw.count},
        "crossing_faces": _first(found.crossings_mm),
        **dict.fromkeys(("open_edges", "nonmanifold_edges", "pinched_vertices"), _first(found.defects_mm)),
        "bank_gap": f"the gap is {gap.gap_mm:.3g} mm at {place_mm(gap.place_mm)}, "
        f"that of the surface {gap.surface_gap_mm:.3g} mm",
        "surface_distance": _lost(lost),
        "meshing_topology": found.reports.get("generate", {}).get("reason", ""),
    }


def with_remarks(certificate: Certificate, more: Sequence[str]) -> Certificate:
    """The certificate with sentences on what was found beside the mesh, such as in its volumes."""
    return replace(certificate, remarks=(*certificate.remarks, *more))


def with_contacts(certificate: Certificate, mesh: TetMesh, records: Sequence[ElectrodeRecord]) -> Certificate:
    """The certificate with the contacts of its mesh, as `with_electrodes` gives both, and remarks on them."""
    return with_remarks(replace(certificate, electrodes=tuple(records)), electrode_remarks(mesh, records))


def versions(reports: Mapping[str, Any]) -> dict[str, str]:
    """Versions of cortet, of Python, and of the installed libraries that can change a mesh or its numbers.

    Parameters
    ----------
    reports : stage -> its report, which names the program that S4 called
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


def _lost(places: Sequence[LostPlace]) -> str:
    """Where the boundary does not follow the surface, in words; empty if it does everywhere."""
    if not places:
        return ""
    of_kind = {kind: sum(place.kind == kind for place in places) for kind in ("filled", "cut off")}
    parts = [
        f"{of_kind['filled']} where a sulcus is filled" if of_kind["filled"] else "",
        f"{of_kind['cut off']} where a blade or tip is cut off" if of_kind["cut off"] else "",
    ]
    count = f"{counted(len(places), 'location')} beyond the limit"
    worst = f"the worst, {places[0].kind}, at {place_mm(places[0].place_mm)}"
    return f"{count}: {' and '.join(filter(None, parts))}, {worst}"


def _in_tuples(places: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, places.tolist()))


def _first(places: FloatArray | Sequence[Sequence[float]]) -> str:
    return "the first around " + ", ".join(map(place_mm, places[:3]))
