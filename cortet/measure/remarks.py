"""What a user should know of a mesh although every number of it is within its limit: how far surfaces were changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cortet.geometry.limits import CELL_SIZE_MM
from cortet.measure.layers import LayerRecord
from cortet.measure.regions import RegionRecord
from cortet.measure.verdict import changed_share, share_in_words, surfaces_of
from cortet.meshes import OUTERMOST

#: a repair is worth a remark from this change of volume on, and from this share of new triangles in the area; a surface
#: that gave way from this share of the volume between it and the surface around it
_REPAIRED, _NEW, _EXCHANGED = 0.005, 0.01, 0.05
#: the part of the cortex without layers is worth a remark from this share of its volume on
_UNLAYERED = 0.05
#: elements across the cortex below which its bending is too stiff, and how many times the tetrahedra they need: 3.1 to
#: 3.9 in newborns with cells of 1 mm, 7.0 in even cortex of 0.8 h; 8 if every edge is halved
_ACROSS, _COST = 2, "three to eight"


def remarks(
    reports: Mapping[str, Any],
    parameters: Mapping[str, Any],
    regions: Sequence[RegionRecord] = (),
    cell_size: float | None = None,
    layers: Sequence[LayerRecord] | None = None,
) -> tuple[str, ...]:
    """Sentences on an unusual volume, on repairs and inner surfaces that gave way, and on a cortex of few elements.

    Parameters
    ----------
    reports, parameters : of the stages, as a certificate has them
    regions : of the mesh
    cell_size : mm
    layers : of the cortex; empty if the mesh has no cortex around white matter; None: none are asked for
    """
    count = sum(layer.number > 0 for layer in layers or ())
    asked = parameters.get("generate", {}).get("elements_across", _ACROSS)
    few = _coarse(regions, cell_size, count, asked)
    of_layers = [] if layers is None else _layers(layers)
    doubt = (reports.get("gate") or {}).get("doubt")
    return (
        *([doubt] if doubt else []),
        *_repairs(reports.get("repair") or {}),
        *_gaps(reports, parameters),
        *few,
        *of_layers,
    )


def _repairs(report: Mapping[str, Any]) -> Iterator[str]:
    for name, one in surfaces_of(report).items():
        named, change = name or "the surface", one["relative_volume_change"]
        share = changed_share(one)
        if share >= _NEW:
            yield (
                f"repair made or dropped {share_in_words(share)} of {named}; between its caps on holes and flat caps "
                f"are {one['bulge_ml']:.2g} mL"
            )
        if abs(change) >= _REPAIRED:
            yield f"repair changed the volume of {named} by {change:+.1%}"


def _coarse(regions: Sequence[RegionRecord], cell_size: float | None, layers: int, asked: int) -> Iterator[str]:
    for region in regions:
        across = region.edges_across
        if region.name != OUTERMOST or not across:
            continue
        for least, purpose in ((_ACROSS, "mechanics"), (layers, f"{layers} layers")):
            if across.median < least:
                size = cell_size * across.median / least if cell_size else 0.0
                fine = f"; {size:.2g} mm is small enough for {least}" if size >= CELL_SIZE_MM[0] else ""
                if asked < least == _ACROSS:
                    fine += f", and so is regions.elements_across: {least}, for {_COST} times the tetrahedra"
                elements = "element" if across.median == 1 else "elements"
                yield f"the {OUTERMOST} has {across.median:g} {elements} across (median), too few for {purpose}{fine}"


def _layers(layers: Sequence[LayerRecord]) -> Iterator[str]:
    if not layers:
        yield "no layers: there is no inner surface white directly inside the cortex"
        return
    cortex = sum(layer.volume_ml for layer in layers)
    if (none := sum(layer.volume_ml for layer in layers if not layer.number)) > _UNLAYERED * cortex:
        yield f"{none / cortex:.0%} of the cortex has no layer: there the white and the pial surface are too close"
    if empty := [str(layer.number) for layer in layers if not layer.tetrahedra]:
        yield f"layers without tetrahedra: {', '.join(empty)} (remedy: fewer layers, or a smaller cell size)"


def _gaps(reports: Mapping[str, Any], parameters: Mapping[str, Any]) -> Iterator[str]:
    asked = parameters.get("separate", {}).get("min_gap", 0.0) * parameters.get("generate", {}).get("cell_size", 0.0)
    for one in (reports.get("separate") or {}).get("surfaces", ()):
        exchanged = one["around_ml"] - one["around_before_ml"]
        share = exchanged / one["around_ml"]
        if share >= _EXCHANGED:
            yield (
                f"{one['name']} gave way to the surface around it: {exchanged:.2f} mL, {share:.0%} of the tissue "
                f"between the two, was part of {one['name']} (remedy: a smaller cell size or regions.min_gap)"
            )
        if one["min_gap_mm"] < 0.99 * asked:
            yield (
                f"{one['name']} keeps {one['min_gap_mm']:.2g} mm from the surface around it instead of {asked:.2g} mm, "
                "because triangles would intersect at a larger distance"
            )
