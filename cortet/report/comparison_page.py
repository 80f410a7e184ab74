"""The page that shows several meshes of one surface side by side, whatever made them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cortet.formats.tables import Column
from cortet.geometry.topology import boundary_surface
from cortet.measure.lost import distances_to
from cortet.meshes import TetMesh, TriSurface
from cortet.report import pages
from cortet.report.boundary_view import colour_scale
from cortet.report.case_page import ELEMENTS, limit_of, of_check
from cortet.report.figures import mesh_quality_figures, svg
from cortet.report.pages import SIDES, Panel, Part
from cortet.report.pictures import captioned
from cortet.report.render import cut_view, surface_view
from cortet.report.stage_sentences import Certificate

#: numbers that a comparison shows besides the checks
_SHOWN = ("Nodes", "Tetrahedra", "Mean q", "Elements with q > 0.3", "Elements with q > 0.6", "Dihedral angles", "Edges")


def comparison_rows(certificates: Mapping[str, Certificate]) -> list[dict[str, Any]]:
    """Numbers of certificates side by side.

    Parameters
    ----------
    certificates : name of the mesh -> content of its certificate.json; all made with the same limits

    Returns
    -------
    one row per number: `name`, `limit` (empty if there is none), and one `(value, passed)` per mesh in `values`
    """
    by_mesh = [[*_of_elements(c["quality"]), *map(of_check, c["checks"])] for c in certificates.values()]
    return [
        {"name": row[0]["name"], "limit": row[0]["limit"], "values": [(one["value"], one["passed"]) for one in row]}
        for row in zip(*by_mesh, strict=True)
    ]


def _of_elements(quality: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Numbers that have no limit, in the form of `of_check`."""
    shown = {name: text.format_map(quality) for name, text in ELEMENTS.items() if name in _SHOWN}
    return [{"name": name, "limit": "", "value": value, "passed": True} for name, value in shown.items()]


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
    certificates : name -> certificate of each mesh, all with the same limits
    surface : the surface that all meshes should fill
    path : HTML file
    source : name of the surface's file
    """
    distances = {
        name: distances_to(boundary_surface(mesh)[0], surface)[len(surface.points) :] for name, mesh in meshes.items()
    }
    darkest = max(float(far.max()) for far in distances.values())
    counts = {name: np.array(c["quality"]["histogram"]) for name, c in certificates.items()}
    first = next(iter(certificates.values()))
    bulk, tail = mesh_quality_figures(counts, limit=limit_of(first, "worst_q"))
    worst = ", ".join(f"{name} {c['quality']['q']['max']:.3f}" for name, c in certificates.items())
    columns = [Column("name", heading="Number"), Column("limit", heading="Limit")]
    columns += [Column(f"mesh {n}", heading=name, form=".4g") for n, name in enumerate(certificates)]
    verdicts = [("badge", "certified" if c["certified"] else "uncertified") for c in certificates.values()]
    rows = [_row("Verdict", "", verdicts)]
    for row in comparison_rows(certificates):
        checked = [("checked", {"text": value, "passed": passed}) for value, passed in row["values"]]
        rows.append(_row(row["name"], row["limit"], checked))
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
        captioned(surface_view(surface, side=side, values=far, limits=(0.0, darkest)), f"{name}, from the {word}")
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
            Panel("cuts", "Meshes, cut open halfway to the front", [("pictures", cuts), ("scale", colour_scale())]),
            Panel("lost", "What each leaves of the surface", [("paragraph", lost), ("pictures", surfaces)]),
        ],
        top=[("facts", {"texts": {"Surface": source}})] if source else [],
        wide=True,
    )


def _row(name: str, limit: str, cells: Sequence[Part]) -> dict[str, Any]:
    return {"name": name, "limit": limit, **{f"mesh {n}": cell for n, cell in enumerate(cells)}}
