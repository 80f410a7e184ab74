"""The checks of a certificate: each number with its limit, in the order of the certificate."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from cortet.geometry.banks import Banks
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

SURFACE_DISTANCE = "distance of the surface to the boundary, at most"
#: words of a remedy, and the factor by which it reduces the cell size
_SMALLER, _FINER = "a smaller cell size", 0.75
LOSS_REMEDY = "use a smaller cell size, or the mesher `lattice`, whose edges follow the shape"
BANKS = "smallest gap between banks of the boundary, over that of the surface"
_NATIVE_REMEDY = "smooth the surface less (`smooth_surface`), or use a smaller cell size"
TOPOLOGY_REMEDY = "add a smaller fraction to `generate.facet_distance`, or use a smaller cell size"


@dataclass(frozen=True)
class Check:
    """One number and the limit that checks it."""

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
        limit = f"{_WORDS[self.comparison]} {self.limit:g}{unit}" if self.comparison else "no limit"
        return f"{self.name} {self.value:.6g}{unit}, {limit}"


def checked(
    name: str, value: float, comparison: Comparison | None, limit: float | None, *, unit: str = "", remedy: str = ""
) -> Check:
    """The check of a number; without a limit it passes and states no comparison."""
    if limit is None:
        comparison = None
    passed = comparison is None or limit is None or _COMPARE[comparison](value, limit)
    return Check(name, value, unit, comparison, limit, passed, remedy)


def for_mesher(check: Check, mesher: str | None) -> Check:
    """The check with a remedy that fits the mesher; None means that cortet did not make the mesh."""
    if mesher == "lattice":
        fitting = dict.fromkeys((LOSS_REMEDY, TOPOLOGY_REMEDY), "use a smaller cell size")
    elif mesher is None:
        remedy = "use a smaller cell size; if the mesh was made from another surface, name that surface"
        fitting = dict.fromkeys((LOSS_REMEDY, TOPOLOGY_REMEDY), remedy)
    else:
        return check
    return replace(check, remedy=fitting.get(check.remedy, check.remedy))


def for_cell_size(check: Check, cell_size: float | None) -> Check:
    """The check, with a size in mm if it failed, its remedy is a smaller cell size and the mesh's own is known."""
    if check.passed or cell_size is None:
        return check
    size = f"{_SMALLER} ({_FINER * cell_size:.2g} mm)"
    return replace(check, remedy=check.remedy.replace(_SMALLER, size, 1))


def bank_checks(found: Banks, *, share: float | None) -> Iterator[Check]:
    """How near the banks of the boundary come to each other, measured outside the mesh."""
    yield checked(BANKS, found.least_share, ">=", share, remedy=LOSS_REMEDY)


def native_checks(
    found: Native | None, *, largest: float | None, mean: float | None, area: float | None
) -> Iterator[Check]:
    """How far the boundary is from the native surface; smoothing contributes most."""
    if found is None:
        return
    there, back = found.boundary_to_native_mm, found.native_to_boundary_mm
    for name, value, limit, unit in (
        ("distance between the boundary and the native surface, at most", max(there.max, back.max), largest, "mm"),
        ("distance between the boundary and the native surface, on average", max(there.mean, back.mean), mean, "mm"),
        ("relative change of the area against the native surface", abs(found.relative_area_change), area, ""),
    ):
        yield checked(name, value, "<=", limit, unit=unit, remedy=_NATIVE_REMEDY)


def relative_difference(one: float, other: float) -> float:
    """Difference of two volumes over the larger one; 0 if both are 0."""
    largest = max(abs(one), abs(other))
    return abs(one - other) / largest if largest else 0.0


def times(fraction: float | None, length: float | None) -> float | None:
    """A fraction of a length; None if either is None."""
    return None if fraction is None or length is None else fraction * length


def topology_checks(boundary: SurfaceTopology, euler_number: int) -> Iterator[Check]:
    """Whether the boundary is one closed manifold with the Euler number of the surface."""
    wanted = {
        "boundary components": (boundary.components, 1),
        "boundary Euler number": (boundary.euler_number, euler_number),
        "boundary edges in one face only": (boundary.open_edges, 0),
        "boundary edges in more than two faces": (boundary.nonmanifold_edges, 0),
        "boundary edges between inconsistently oriented faces": (boundary.misoriented_edges, 0),
        "pinched boundary vertices": (boundary.pinched_vertices, 0),
    }
    for name, (value, limit) in wanted.items():
        yield checked(name, value, "==", limit, remedy=TOPOLOGY_REMEDY)


def region_checks(regions: Sequence[RegionRecord], *, volume: float | None) -> Iterator[Check]:
    """Whether each region has tetrahedra, and how much its volume changed."""
    for one in regions:
        yield checked(f"tetrahedra of region {one.name}", one.tetrahedra, ">=", 1)
        yield checked(
            f"relative change of the volume of region {one.name}",
            abs(one.relative_volume_change),
            "<=",
            volume,
            remedy=LOSS_REMEDY,
        )


def interface_checks(
    interfaces: Sequence[InterfaceRecord],
    *,
    nodes: float | None,
    largest: float | None,
    mean: float | None,
    area: float | None,
) -> Iterator[Check]:
    """The checks of the boundary, applied to each interface; limits of distances in mm."""
    for one in interfaces:
        genus = (2 - one.surface_euler_number) // 2
        problems = one.topology.problems(genus)
        remedy = "; ".join([*problems, "use a smaller cell size, or a larger regions.min_gap"])
        yield checked(f"topology problems of the interface {one.name}", len(problems), "==", 0, remedy=remedy)
        yield checked(
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
            yield checked(what.format(one.name), value, "<=", limit, unit=unit, remedy=LOSS_REMEDY)


def meshing_checks(report: Mapping[str, Any] | None) -> Iterator[Check]:
    """Whether S1 reported a topology problem: a later stage can hide one, but not undo it."""
    if report is not None:
        yield checked("topology problems after S1", int(not report["topology_ok"]), "==", 0, remedy=TOPOLOGY_REMEDY)


def boundary_checks(found: Fidelity, *, nodes: float | None, centres: float | None) -> Iterator[Check]:
    """How far the boundary is from the surface, mm."""
    yield checked(
        "distance of a boundary node to the surface, at most",
        found.nodes_to_surface_mm.max,
        "<=",
        nodes,
        unit="mm",
        remedy="use `boundary: slide` in `clean` and `fixed` in `relocate`, or switch `snap` on",
    )
    yield checked(
        "distance of the centre of a boundary face to the surface, at most",
        found.face_centres_to_surface_mm.max,
        "<=",
        centres,
        unit="mm",
        remedy=LOSS_REMEDY,
    )


def loss_checks(
    found: Fidelity, *, largest: float | None, mean: float | None, area: float | None, volume: float | None
) -> Iterator[Check]:
    """How much of the surface the mesh does not follow: distances in mm, relative changes."""
    distance = found.surface_to_boundary_mm
    for name, value, limit, unit in (
        (SURFACE_DISTANCE, distance.max, largest, "mm"),
        ("distance of the surface to the boundary, on average", distance.mean, mean, "mm"),
        ("relative change of the area", abs(found.relative_area_change), area, ""),
        ("relative change of the volume", abs(found.relative_volume_change), volume, ""),
    ):
        yield checked(name, value, "<=", limit, unit=unit, remedy=LOSS_REMEDY)
