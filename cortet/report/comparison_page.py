"""The page on which several meshes of one surface stand side by side, whatever made them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cortet.geometry.topology import boundary_surface
from cortet.measure.lost import distances_to
from cortet.mesh import TetMesh, TriSurface
from cortet.report import pages
from cortet.report.boundary_view import colour_scale
from cortet.report.case_page import SIDES, Certificate, captioned, in_words, limit_of
from cortet.report.figures import mesh_quality_figures, svg
from cortet.report.render import cut_view, surface_view

#: what a comparison says beside the checks: name -> how it is read from the quality of a certificate
_ELEMENTS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "Nodes": lambda q: f"{q['nodes']:,}",
    "Tetrahedra": lambda q: f"{q['tets']:,}",
    "Mean q": lambda q: f"{q['q']['mean']:.4f}",
    "Elements with q > 0.3": lambda q: f"{q['count_above']['0.3']:,}",
    "Elements with q > 0.6": lambda q: f"{q['count_above']['0.6']:,}",
    "Dihedral angles": lambda q: f"{q['dihedral_min_deg']:.1f}° to {q['dihedral_max_deg']:.1f}°",
    "Edges": lambda q: f"{q['shortest_edge_mm']:.3f} to {q['longest_edge_mm']:.3f} mm",
}


def comparison_rows(certificates: Mapping[str, Certificate]) -> list[dict[str, Any]]:
    """Numbers of certificates side by side.

    Parameters
    ----------
    certificates : name of the mesh -> content of its certificate.json; all made with the same limits

    Returns
    -------
    one row per number: `name`, `limit` (empty where there is none), and one `(value, passed)` per mesh in `values`
    """
    of_elements = [
        {"name": name, "limit": "", "values": [(read(c["quality"]), True) for c in certificates.values()]}
        for name, read in _ELEMENTS.items()
    ]
    checks = [[in_words(check) for check in c["checks"]] for c in certificates.values()]
    judged = [
        {"name": row[0]["name"], "limit": row[0]["limit"], "values": [(one["value"], one["passed"]) for one in row]}
        for row in zip(*checks, strict=True)
    ]
    return of_elements + judged


def write_comparison_page(
    meshes: Mapping[str, TetMesh],
    certificates: Mapping[str, Certificate],
    surface: TriSurface,
    path: str | Path,
    *,
    source: str = "",
) -> None:
    """Write the page of several meshes of one surface.

    Parameters
    ----------
    meshes : name -> the mesh, mm
    certificates : of each, by the same names and made with the same limits
    surface : the surface they all should fill
    path : HTML file
    source : name of the surface's file

    Raises
    ------
    StageError : the graphics library cannot draw here
    """
    distances = {
        name: distances_to(boundary_surface(mesh)[0], surface)[len(surface.points) :] for name, mesh in meshes.items()
    }
    darkest = max(float(far.max()) for far in distances.values())
    counts = {name: np.array(c["quality"]["histogram"]) for name, c in certificates.items()}
    first = next(iter(certificates.values()))
    bulk, tail = mesh_quality_figures(counts, limit=limit_of(first, "worst q"))
    worst = ", ".join(f"{name} {c['quality']['q']['max']:.3f}" for name, c in certificates.items())
    pages.write(
        "comparison.html.j2",
        path,
        title=f"{len(meshes)} meshes of one surface",
        source=source,
        columns=[{"name": name, "certified": c["certified"]} for name, c in certificates.items()],
        rows=comparison_rows(certificates),
        cuts=[captioned(cut_view(mesh), name) for name, mesh in meshes.items()],
        surfaces=[
            captioned(surface_view(surface, side=side, distances=far, darkest=darkest), f"{name}, from the {word}")
            for name, far in distances.items()
            for side, word in SIDES.items()
        ],
        darkest=f"{darkest:.2g}",
        charts=[
            {"svg": pages.embedded(svg(figure), key), "alt": f"{what}. Worst q: {worst}."}
            for key, figure, what in (
                ("bulk", bulk, "Distribution of q over the elements of each mesh"),
                ("tail", tail, "Elements of each mesh above q, per million"),
            )
        ],
        scale=colour_scale(),
    )
