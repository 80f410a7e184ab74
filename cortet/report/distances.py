"""What a page says of distances: of the mesh to its surfaces, and of what was done to the surface before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Certificate = Mapping[str, Any]

_DISTANCES = {
    "nodes_to_surface_mm": "Boundary nodes to the surface",
    "face_centres_to_surface_mm": "Centres of boundary faces to the surface",
    "surface_to_boundary_mm": "Vertices and face centres of the surface to the boundary",
    "nodes_to_nearest_vertex_mm": "Boundary nodes to the nearest vertex of the surface, as published",
}
_REPAIR_DISTANCES = {
    "file_to_surface_mm": "Vertices and face centres of the file to the repaired surface",
    "surface_to_file_mm": "Vertices and face centres of the repaired surface to the file",
}
_RESAMPLING_DISTANCES = {
    "native_to_resampled_mm": "Vertices and face centres of the native surface to the resampled one",
    "resampled_to_native_mm": "Vertices and face centres of the resampled surface to the native one",
}
_NATIVE_DISTANCES = {
    "boundary_to_native_mm": "Boundary nodes and face centres to the native surface, as it was read",
    "native_to_boundary_mm": "Vertices and face centres of the native surface to the boundary",
}


def distances_of(certificate: Certificate) -> list[dict[str, Any]]:
    """Rows of the distances of a mesh to the surface that was meshed, and to the native one where it is known."""
    native = certificate["native"]
    rows = [] if native is None else _distance_rows(native, _NATIVE_DISTANCES)
    return [*_distance_rows(certificate["fidelity"], _DISTANCES), *rows]


def repairs_of(certificate: Certificate) -> list[dict[str, Any]]:
    """What was repaired, of the outer surface first, then of inner ones; nothing for a surface without a flaw."""
    report = certificate["reports"].get("repair", {})
    every = {"": report, **report.get("inner", {})}
    return [
        {
            "name": name,
            "steps": [
                {**step, "places": ", ".join("({:.1f}, {:.1f}, {:.1f})".format(*place) for place in step["places_mm"])}
                for step in one["steps"]
            ],
            "distances": _distance_rows(one, _REPAIR_DISTANCES),
            "facts": [
                ("Volume", f"{one['volume_ml']:.2f} mL ({100 * one['relative_volume_change']:+.3f} %)"),
                ("Area", f"{one['area_mm2']:.0f} mm² ({100 * one['relative_area_change']:+.3f} %)"),
                ("Area of the caps on holes", f"{one['filled_area_mm2']:.0f} mm²"),
                ("Farthest that crossing triangles moved", f"{one['displacement_max_mm']:.3f} mm"),
            ],
            "pictures": [],
        }
        for name, one in every.items()
        if one.get("repaired")
    ]


def resamplings_of(certificate: Certificate) -> list[dict[str, Any]]:
    """How far the common mesh is from the native surface, of the outer one first; nothing for one without a sphere."""
    report = certificate["reports"].get("resample", {})
    every = {"": report, **report.get("inner", {})}
    return [
        {
            "name": name,
            "distances": _distance_rows(one, _RESAMPLING_DISTANCES),
            "facts": [
                ("Vertices", f"{one['vertices']:,} instead of {one['vertices_before']:,}"),
                ("Volume", f"{one['volume_ml']:.2f} mL ({100 * one['relative_volume_change']:+.3f} %)"),
                ("Area", f"{one['area_mm2']:.0f} mm² ({100 * one['relative_area_change']:+.3f} %)"),
                ("Triangles that cross others", f"{one['crossing_faces']:,}, before {one['crossing_faces_before']:,}"),
            ],
        }
        for name, one in every.items()
        if one.get("resampled")
    ]


def _distance_rows(report: Mapping[str, Any], names: Mapping[str, str]) -> list[dict[str, Any]]:
    """Rows of a table of distances: mean, 95th percentile, largest."""
    return [
        {"name": words, "numbers": [f"{report[key][statistic]:.4g}" for statistic in ("mean", "p95", "max")]}
        for key, words in names.items()
    ]
