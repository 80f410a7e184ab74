"""The checks of a certificate: each number with its limit."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

from cortet.geometry.flaws import WORDS

if TYPE_CHECKING:  # what measures loads compiled kernels, and pages need the words of this module alone
    from cortet.config.sections import Certify
    from cortet.geometry.topology import SurfaceTopology
    from cortet.measure.fidelity import Fidelity, Native
    from cortet.measure.regions import InterfaceRecord

Comparison = Literal["<", "<=", "==", ">="]
_COMPARE: dict[Comparison, tuple[Callable[[float, float], bool], str]] = {
    "<": (operator.lt, "must be below"),
    "<=": (operator.le, "must not exceed"),
    "==": (operator.eq, "must be"),
    ">=": (operator.ge, "must be at least"),
}


class Kind(NamedTuple):
    """What a check measures, and how the number compares with its limit."""

    #: in words; {about} is the name of a region
    name: str
    comparison: Comparison = "=="
    #: empty for counts and ratios
    unit: str = ""


#: identifier -> the check
KINDS = {
    **{flaw: Kind(words) for flaw, words in WORDS.items()},
    "worst_q": Kind("worst q", "<"),
    "flat_or_inverted_tetrahedra": Kind("tetrahedra without positive volume"),
    "volume_balance": Kind("relative difference between the sum of volumes and the enclosed volume", "<="),
    "unused_nodes": Kind("unused nodes"),
    "boundary_components": Kind("boundary components"),
    "boundary_euler_number": Kind("boundary Euler number"),
    "open_edges": Kind("boundary edges in one face only"),
    "misoriented_edges": Kind("boundary edges between inconsistently oriented faces"),
    "meshing_topology": Kind("topology problems after S1"),
    "crossing_faces": Kind("intersecting boundary faces"),
    "bank_gap": Kind("smallest gap between banks, relative to the gap of the surface", ">="),
    "node_distance": Kind("largest distance from a boundary node to the surface", "<=", "mm"),
    "face_centre_distance": Kind("largest distance from the centre of a boundary face to the surface", "<=", "mm"),
    "surface_distance": Kind("largest distance from the surface to the boundary", "<=", "mm"),
    "mean_surface_distance": Kind("mean distance from the surface to the boundary", "<=", "mm"),
    "area_change": Kind("relative change of the area", "<="),
    "volume_change": Kind("relative change of the volume", "<="),
    "native_distance": Kind("largest distance between the boundary and the native surface", "<=", "mm"),
    "mean_native_distance": Kind("mean distance between the boundary and the native surface", "<=", "mm"),
    "native_area_change": Kind("relative change of the area from the native surface", "<="),
    "repaired_area": Kind("fraction of the area of the surface that repair made or dropped", "<="),
    "repaired_volume": Kind("volume between caps on holes and flat caps, relative to the volume in the surface", "<="),
    "region_tetrahedra": Kind("tetrahedra of region {about}", ">="),
    "region_volume_change": Kind("relative change of the volume of region {about}", "<="),
    "interface_topology": Kind("topology problems of the interface {about}"),
    "interface_misplaced_faces": Kind("faces of the interface {about} that are not between {about} and {around}"),
    "interface_node_distance": Kind("largest distance from a node of the interface {about} to its surface", "<=", "mm"),
    "interface_surface_distance": Kind("largest distance from the surface {about} to the interface", "<=", "mm"),
    "interface_mean_surface_distance": Kind("mean distance from the surface {about} to the interface", "<=", "mm"),
    "interface_area_change": Kind("relative change of the area of the interface {about}", "<="),
}

#: in a remedy stands for the advice to use a smaller cell size, and the factor by which it is smaller
SMALLER, _FINER = "{smaller}", 0.75


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


def smaller_cells(cell_size: float | None) -> str:
    """The advice to use smaller cells than those of a size, mm, if that is known."""
    return "use a smaller cell size" + ("" if cell_size is None else f" ({_FINER * cell_size:.2g} mm)")


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

    #: identifier, a key of `KINDS`; with a colon and the name of the region where the check is about one
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
            return f"{self.name}: {in_words(self.value)}{unit} (no limit)"
        value, limit = beside_limit(self.value, self.limit)
        return f"{self.name}: {value}{unit} ({_COMPARE[self.comparison][1]} {limit}{unit})"


class Number(NamedTuple):
    """A number to check."""

    #: a key of `KINDS`
    id: str
    value: float
    limit: float | None = 0
    #: `SMALLER` in it becomes the advice to use smaller cells
    remedy: str = ""
    #: the region that it is about, and the one around that
    about: str = ""
    around: str = ""


def checked(number: Number, cell_size: float | None = None) -> Check:
    """The check of a number; without a limit it passes and states no comparison.

    Parameters
    ----------
    cell_size : mm; if the check failed, the remedy names the size to try next
    """
    kind, limit = KINDS[number.id], number.limit
    passed = limit is None or _COMPARE[kind.comparison][0](number.value, limit)
    return Check(
        id=f"{number.id}:{number.about}" if number.about else number.id,
        name=kind.name.format(about=number.about, around=number.around),
        value=number.value,
        unit=kind.unit,
        comparison=None if limit is None else kind.comparison,
        limit=limit,
        passed=passed,
        remedy=number.remedy.replace(SMALLER, smaller_cells(None if passed else cell_size)),
    )


def limits_in_mm(limits: Certify, cell_size: float | None) -> Certify:
    """The limits with fractions of the cell size in mm; None where the size is not known."""

    def scaled(fraction: float | None) -> float | None:
        return None if fraction is None or cell_size is None else fraction * cell_size

    native = ("max_native_distance", "max_mean_native_distance")
    fractions = ("max_face_distance", "max_surface_distance", "max_mean_surface_distance", *native)
    return limits.model_copy(update={name: scaled(getattr(limits, name)) for name in fractions})


def topology_numbers(boundary: SurfaceTopology, euler_number: int, remedy: str) -> Iterator[Number]:
    """Whether the boundary is one closed manifold with the Euler number of the surface."""
    yield Number("boundary_components", boundary.components, 1, remedy)
    yield Number("boundary_euler_number", boundary.euler_number, euler_number, remedy)
    for kind in ("open_edges", "nonmanifold_edges", "misoriented_edges", "pinched_vertices"):
        yield Number(kind, getattr(boundary, kind), 0, remedy)


def fidelity_numbers(found: Fidelity, limits: Certify, remedy: str) -> Iterator[Number]:
    """How far the boundary is from the surface, and how much of the surface the mesh does not follow."""
    hold = "use `boundary: slide` in `clean` and `fixed` in `relocate`, or enable `snap`"
    off, lost = found.face_centres_to_surface_mm.max, found.surface_to_boundary_mm
    yield Number("node_distance", found.nodes_to_surface_mm.max, limits.max_boundary_distance, hold)
    yield Number("face_centre_distance", off, limits.max_face_distance, remedy)
    yield Number("surface_distance", lost.max, limits.max_surface_distance, remedy)
    yield Number("mean_surface_distance", lost.mean, limits.max_mean_surface_distance, remedy)
    yield Number("area_change", abs(found.relative_area_change), limits.max_area_change, remedy)
    yield Number("volume_change", abs(found.relative_volume_change), limits.max_volume_change, remedy)


def native_numbers(found: Native, limits: Certify) -> Iterator[Number]:
    """How far the boundary is from the native surface; smoothing contributes most."""
    remedy = f"smooth the surface less (`smooth_surface`), or {SMALLER}"
    there, back = found.boundary_to_native_mm, found.native_to_boundary_mm
    yield Number("native_distance", max(there.max, back.max), limits.max_native_distance, remedy)
    yield Number("mean_native_distance", max(there.mean, back.mean), limits.max_mean_native_distance, remedy)
    yield Number("native_area_change", abs(found.relative_area_change), limits.max_native_area_change, remedy)


def interface_numbers(one: InterfaceRecord, limits: Certify, remedy: str) -> Iterator[Number]:
    """What is checked of the boundary, of an interface."""
    problems = one.topology.problems((2 - one.surface_euler_number) // 2)
    mend = "; ".join([*problems, f"{SMALLER}, or a larger regions.min_gap"])
    off, lost, area = one.nodes_to_surface_mm.max, one.surface_to_interface_mm, abs(one.relative_area_change)
    yield Number("interface_topology", len(problems), 0, mend, one.name)
    yield Number("interface_misplaced_faces", one.misplaced_faces, 0, "", one.name, one.around)
    yield Number("interface_node_distance", off, limits.max_boundary_distance, remedy, one.name)
    yield Number("interface_surface_distance", lost.max, limits.max_surface_distance, remedy, one.name)
    yield Number("interface_mean_surface_distance", lost.mean, limits.max_mean_surface_distance, remedy, one.name)
    yield Number("interface_area_change", area, limits.max_area_change, remedy, one.name)
