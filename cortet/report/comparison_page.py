"""The page on which several meshes of one surface stand side by side, whatever made them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cortet.formats.tables import Column
from cortet.geometry.topology import boundary_surface
from cortet.measure.lost import distances_to
from cortet.mesh import TetMesh, TriSurface
from cortet.report import pages
from cortet.report.boundary_view import colour_scale
from cortet.report.case_page import ELEMENTS, Certificate, in_words, limit_of
from cortet.report.figures import mesh_quality_figures, svg
from cortet.report.pages import Panel
from cortet.report.pictures import SIDES, captioned
from cortet.report.render import cut_view, surface_view

#: what a comparison says beside the checks
_SHOWN = ("Nodes", "Tetrahedra", "Mean q", "Elements with q > 0.3", "Elements with q > 0.6", "Dihedral angles", "Edges")


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
        {
            "name": name,
            "limit": "",
            "values": [(ELEMENTS[name].format_map(c["quality"]), True) for c in certificates.values()],
        }
        for name in _SHOWN
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
    verdicts = {name: "certified" if c["certified"] else "uncertified" for name, c in certificates.items()}
    rows: list[dict[str, Any]] = [
        {"name": "Verdict", **{name: ("badge", verdict) for name, verdict in verdicts.items()}}
    ]
    for row in comparison_rows(certificates):
        cells = zip(certificates, row.pop("values"), strict=True)
        rows.append({**row, **{name: ("judged", {"text": value, "passed": passed}) for name, (value, passed) in cells}})
    columns = [Column("name", heading="Number"), Column("limit", heading="Limit")]
    columns += [Column(name, heading=name, form=".4g") for name in certificates]
    caption = "Every number beside its limit; q is 0 for a regular tetrahedron and 1 for a flat one"
    lost = (
        "The surface, each face in the colour of its distance to the boundary of the mesh: white at 0, black at "
        f"{darkest:.2g} mm."
    )
    charts = [
        (pages.embedded(svg(bulk), "bulk"), f"Distribution of q over the elements of each mesh. Worst q: {worst}."),
        (pages.embedded(svg(tail), "tail"), f"Elements of each mesh above q, per million. Worst q: {worst}."),
    ]
    cuts = [captioned(cut_view(mesh), name) for name, mesh in meshes.items()]
    surfaces = [
        captioned(surface_view(surface, side=side, distances=far, darkest=darkest), f"{name}, from the {word}")
        for name, far in distances.items()
        for side, word in SIDES.items()
    ]
    pages.write(
        path,
        f"{len(meshes)} meshes of one surface",
        [
            Panel(
                "numbers", "Numbers side by side", [pages.table(caption, columns, rows, name="Numbers side by side")]
            ),
            Panel("quality", "Element quality", [("charts", charts)]),
            Panel("cuts", "Meshes, cut open across the middle", [("pictures", cuts), ("scale", colour_scale())]),
            Panel("lost", "What each leaves of the surface", [("paragraph", lost), ("pictures", surfaces)]),
        ],
        top=[("facts", {"texts": {"Surface": source}})] if source else [],
        wide=True,
    )
