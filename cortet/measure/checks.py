"""The checks of a certificate: each number with its limit, in the order of the certificate."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from cortet.geometry.banks import Banks
from cortet.geometry.filling import WORDS
from cortet.geometry.topology import SurfaceTopology
from cortet.measure.fidelity import Fidelity
from cortet.measure.native import Native
from cortet.measure.regions import InterfaceRecord, RegionRecord

Comparison = Literal["<", "<=", "==", ">="]
_COMPARE: dict[Comparison, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    "==": operator.eq,
    ">=": operator.ge,
}
_WORDS: dict[Comparison, str] = {
    "<": "must be below",
    "<=": "must not exceed",
    "==": "must be",
    ">=": "must be at least",
}

#: identifier of a check -> what it measures, in words; {about} is the name of a region
NAMES = {
    **WORDS,
    "worst_q": "worst q",
    "flat_or_inverted_tetrahedra": "tetrahedra without positive volume",
    "volume_balance": "relative difference between the sum of volumes and the enclosed volume",
    "unused_nodes": "unused nodes",
    "boundary_components": "boundary components",
    "boundary_euler_number": "boundary Euler number",
    "open_edges": "boundary edges in one face only",
    "misoriented_edges": "boundary edges between inconsistently oriented faces",
    "meshing_topology": "topology problems after S1",
    "crossing_faces": "intersecting boundary faces",
    "bank_gap": "smallest gap between banks, relative to the gap of the surface",
    "node_distance": "largest distance from a boundary node to the surface",
    "face_centre_distance": "largest distance from the centre of a boundary face to the surface",
    "surface_distance": "largest distance from the surface to the boundary",
    "mean_surface_distance": "mean distance from the surface to the boundary",
    "area_change": "relative change of the area",
    "volume_change": "relative change of the volume",
    "native_distance": "largest distance between the boundary and the native surface",
    "mean_native_distance": "mean distance between the boundary and the native surface",
    "native_area_change": "relative change of the area from the native surface",
    "region_tetrahedra": "tetrahedra of region {about}",
    "region_volume_change": "relative change of the volume of region {about}",
    "interface_topology": "topology problems of the interface {about}",
    "interface_misplaced_faces": "faces of the interface {about} that are not between {about} and {around}",
    "interface_node_distance": "largest distance from a node of the interface {about} to its surface",
    "interface_surface_distance": "largest distance from the surface {about} to the interface",
    "interface_mean_surface_distance": "mean distance from the surface {about} to the interface",
    "interface_area_change": "relative change of the area of the interface {about}",
}

#: in a remedy stands for the advice to use a smaller cell size, and the factor by which it is smaller
SMALLER, _FINER = "{smaller}", 0.75
_NATIVE_REMEDY = f"smooth the surface less (`smooth_surface`), or {SMALLER}"


class Remedies(NamedTuple):
    """What to change where a mesh loses parts of its surface, and where its topology is another."""

    loss: str
    topology: str


def remedies(mesher: str | None) -> Remedies:
    """The remedies that fit a mesher; None: cortet did not make the mesh."""
    if mesher == "lattice":
        return Remedies(SMALLER, SMALLER)
    if mesher is None:
        return Remedies(*[f"{SMALLER}; if the mesh was made from another surface, name that surface"] * 2)
    return Remedies(
        f"{SMALLER}, or the mesher `lattice`, whose edges follow the shape",
        f"add a smaller fraction to `generate.facet_distance`, or {SMALLER}",
    )


def in_words(value: float, digits: int = 4) -> str:
    """A number as people write it: whole and large numbers with commas, others with the `digits` that count."""
    whole = 10**digits <= abs(value) < 1e15 or float(value).is_integer()
    return f"{value:,.0f}" if whole else f"{value:.{digits}g}"


def beside_limit(value: float, limit: float) -> tuple[str, str]:
    """A number and its limit as people write them, with the digits that tell on which side of the limit it is."""
    for digits in range(4, 18):  # 17 digits are the whole number
        texts = in_words(value, digits), f"{limit:g}" if float(f"{limit:g}") == limit else f"{limit:.{max(digits, 6)}g}"
        read, at = (float(text.replace(",", "")) for text in texts)
        if (read > at, read < at) == (value > limit, value < limit):
            break
    return texts


@dataclass(frozen=True)
class Check:
    """One number and the limit that checks it."""

    #: identifier, a key of `NAMES`; with a colon and the name of the region where the check is about one
    id: str
    #: what it measures, in words
    name: str
    value: float
    #: empty for counts and ratios
    unit: str
    #: None if the number has no limit
    comparison: Comparison | None
    limit: float | None
    passed: bool
    #: what to change when the check fails
    remedy: str

    @property
    def finding(self) -> str:
        """Name, value and limit in plain words."""
        unit = f" {self.unit}" if self.unit else ""
        if self.comparison is None or self.limit is None:
            return f"{self.name} {in_words(self.value)}{unit}, no limit"
        value, limit = beside_limit(self.value, self.limit)
        return f"{self.name} {value}{unit}, {_WORDS[self.comparison]} {limit}{unit}"


def checked(
    id: str,  # noqa: A002, the name of the field
    value: float,
    comparison: Comparison | None,
    limit: float | None,
    *,
    unit: str = "",
    remedy: str = "",
    about: str = "",
    around: str = "",
) -> Check:
    """The check of a number; without a limit it passes and states no comparison.

    Parameters
    ----------
    id : a key of `NAMES`
    about, around : the region that it is about, and the one around that
    """
    if limit is None:
        comparison = None
    passed = comparison is None or limit is None or _COMPARE[comparison](value, limit)
    name = NAMES[id].format(about=about, around=around)
    return Check(f"{id}:{about}" if about else id, name, value, unit, comparison, limit, passed, remedy)


def with_cell_size(check: Check, cell_size: float | None) -> Check:
    """The check with its remedy in full: if it failed and the cell size is known, with the size in mm to try next."""
    return replace(check, remedy=check.remedy.replace(SMALLER, smaller_cells(None if check.passed else cell_size)))


def smaller_cells(cell_size: float | None) -> str:
    """The advice to use smaller cells than those of a size, mm, if that is known."""
    return "use a smaller cell size" + ("" if cell_size is None else f" ({_FINER * cell_size:.2g} mm)")


def bank_check(found: Banks, *, share: float | None, remedy: str) -> Check:
    """How near the banks of the boundary come to each other, measured outside the mesh."""
    return checked("bank_gap", found.least_share, ">=", share, remedy=remedy)


def native_checks(
    found: Native | None, *, largest: float | None, mean: float | None, area: float | None
) -> Iterator[Check]:
    """How far the boundary is from the native surface; smoothing contributes most."""
    if found is None:
        return
    there, back = found.boundary_to_native_mm, found.native_to_boundary_mm
    for id, value, limit, unit in (  # noqa: A001
        ("native_distance", max(there.max, back.max), largest, "mm"),
        ("mean_native_distance", max(there.mean, back.mean), mean, "mm"),
        ("native_area_change", abs(found.relative_area_change), area, ""),
    ):
        yield checked(id, value, "<=", limit, unit=unit, remedy=_NATIVE_REMEDY)


def relative_difference(one: float, other: float) -> float:
    """Difference of two volumes over the larger one; 0 if both are 0."""
    largest = max(abs(one), abs(other))
    return abs(one - other) / largest if largest else 0.0


def times(fraction: float | None, length: float | None) -> float | None:
    """A fraction of a length; None if either is None."""
    return None if fraction is None or length is None else fraction * length


def topology_checks(boundary: SurfaceTopology, euler_number: int, *, remedy: str) -> Iterator[Check]:
    """Whether the boundary is one closed manifold with the Euler number of the surface."""
    wanted = {
        "boundary_components": (boundary.components, 1),
        "boundary_euler_number": (boundary.euler_number, euler_number),
        "open_edges": (boundary.open_edges, 0),
        "nonmanifold_edges": (boundary.nonmanifold_edges, 0),
        "misoriented_edges": (boundary.misoriented_edges, 0),
        "pinched_vertices": (boundary.pinched_vertices, 0),
    }
    for id, (value, limit) in wanted.items():  # noqa: A001
        yield checked(id, value, "==", limit, remedy=remedy)


def region_checks(regions: Sequence[RegionRecord], *, volume: float | None, remedy: str) -> Iterator[Check]:
    """Whether each region has tetrahedra, and how much its volume changed."""
    for one in regions:
        yield checked("region_tetrahedra", one.tetrahedra, ">=", 1, about=one.name)
        change = abs(one.relative_volume_change)
        yield checked("region_volume_change", change, "<=", volume, remedy=remedy, about=one.name)


def interface_checks(
    interfaces: Sequence[InterfaceRecord],
    *,
    nodes: float | None,
    largest: float | None,
    mean: float | None,
    area: float | None,
    remedy: str,
) -> Iterator[Check]:
    """The checks of the boundary, applied to each interface; limits of distances in mm."""
    for one in interfaces:
        problems = one.topology.problems((2 - one.surface_euler_number) // 2)
        mend = "; ".join([*problems, f"{SMALLER}, or a larger regions.min_gap"])
        yield checked("interface_topology", len(problems), "==", 0, remedy=mend, about=one.name)
        yield checked("interface_misplaced_faces", one.misplaced_faces, "==", 0, about=one.name, around=one.around)
        for id, value, limit, unit in (  # noqa: A001
            ("interface_node_distance", one.nodes_to_surface_mm.max, nodes, "mm"),
            ("interface_surface_distance", one.surface_to_interface_mm.max, largest, "mm"),
            ("interface_mean_surface_distance", one.surface_to_interface_mm.mean, mean, "mm"),
            ("interface_area_change", abs(one.relative_area_change), area, ""),
        ):
            yield checked(id, value, "<=", limit, unit=unit, remedy=remedy, about=one.name)


def meshing_checks(report: Mapping[str, Any] | None, *, remedy: str) -> Iterator[Check]:
    """Whether S1 reported a topology problem: a later stage can hide one, but not undo it."""
    if report is not None:
        yield checked("meshing_topology", int(not report["topology_ok"]), "==", 0, remedy=remedy)


def boundary_checks(found: Fidelity, *, nodes: float | None, centres: float | None, remedy: str) -> Iterator[Check]:
    """How far the boundary is from the surface, mm."""
    hold = "use `boundary: slide` in `clean` and `fixed` in `relocate`, or enable `snap`"
    yield checked("node_distance", found.nodes_to_surface_mm.max, "<=", nodes, unit="mm", remedy=hold)
    far = found.face_centres_to_surface_mm.max
    yield checked("face_centre_distance", far, "<=", centres, unit="mm", remedy=remedy)


def loss_checks(
    found: Fidelity,
    *,
    largest: float | None,
    mean: float | None,
    area: float | None,
    volume: float | None,
    remedy: str,
) -> Iterator[Check]:
    """How much of the surface the mesh does not follow: distances in mm, relative changes."""
    distance = found.surface_to_boundary_mm
    for id, value, limit, unit in (  # noqa: A001
        ("surface_distance", distance.max, largest, "mm"),
        ("mean_surface_distance", distance.mean, mean, "mm"),
        ("area_change", abs(found.relative_area_change), area, ""),
        ("volume_change", abs(found.relative_volume_change), volume, ""),
    ):
        yield checked(id, value, "<=", limit, unit=unit, remedy=remedy)
