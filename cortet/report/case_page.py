"""The page of one case: its mesh and certificate, or what failed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from cortet.errors import StageError
from cortet.geometry.mending import measurable
from cortet.geometry.nesting import region_names
from cortet.geometry.topology import boundary_surface, sheet, surface_topology
from cortet.measure.lost import distances_to
from cortet.mesh import REGION, TetMesh, TriSurface
from cortet.report import pages, published
from cortet.report.boundary_view import boundary_view, three_js
from cortet.report.distances import distances_of, repairs_of, resamplings_of
from cortet.report.figures import mesh_quality_figures, svg
from cortet.report.render import COLOUR_NAMES, cut_view, reddest, surface_view, webp
from cortet.stages import STAGES

Certificate = Mapping[str, Any]
Facts = list[tuple[str, str]]

#: job of the workflow -> what it does, in words
DOES = {
    "phantom": "makes a synthetic surface",
    "fields": "reads the fields of the surface",
    **{stage.name: f"{stage.does} ({stage.number})" if stage.number else stage.does for stage in STAGES.values()},
    "quality": "measures the elements",
    "certify": "judges the mesh",
}

_COMPARED = {"<": "below", "<=": "at most", "==": "exactly", ">=": "at least"}
_LOST = {"filled": "a sulcus that the mesh fills", "cut off": "a blade or tip that the mesh cuts off"}
#: sides of the head that a surface is drawn from
SIDES: dict[Literal["L", "R"], str] = {"L": "left", "R": "right"}
#: remedy of a job that left no message
_KILLED = "give the job more memory or time, and run again"
_READ_LOG = "read the log; it holds every line the job printed"


def write_case_page(
    mesh: TetMesh,
    surface: TriSurface,
    certificate: Certificate,
    path: str | Path,
    *,
    meshed: TriSurface,
    facts: Facts | None = None,
    cohort: str = "",
    files: Sequence[tuple[str, str]] = (),
) -> None:
    """Write the page of a mesh, certified or not.

    Parameters
    ----------
    mesh : the mesh that was judged
    surface : the input surface in mm, drawn beside it; its coordinates need not be finite
    certificate : content of its certificate.json
    meshed : the surface that was meshed, which is drawn in the colour of its distance to the boundary
    facts : what else is known of the case, name and value
    cohort : address of the cohort page, as seen from this one
    files : name and title of files beside the page
    """
    pictures, trouble = _pictures(surface, mesh, meshed)
    repairs = repairs_of(certificate)
    if repairs and not trouble:
        repairs[0]["pictures"] = _repair_pictures(surface, meshed)
    q = certificate["quality"]
    bulk, tail = mesh_quality_figures({"this mesh": np.array(q["histogram"])}, limit=limit_of(certificate, "worst q"))
    pages.write(
        "case.html.j2",
        path,
        scripts=(three_js(), pages.source("view.js")),
        title=f"{certificate['case']}: {'certified' if certificate['certified'] else 'not certified'}",
        name=certificate["case"],
        certificate=certificate,
        facts=[*(facts or []), ("Nodes", f"{q['nodes']:,}"), ("Tetrahedra", f"{q['tets']:,}")],
        pictures=pictures,
        trouble=trouble,
        repairs=repairs,
        resamplings=resamplings_of(certificate),
        checks=[in_words(check) for check in certificate["checks"]],
        failed=sum(not check["passed"] for check in certificate["checks"]),
        charts={
            "bulk": {"svg": pages.embedded(svg(bulk), "bulk"), "alt": _bulk_in_words(certificate)},
            "tail": {"svg": pages.embedded(svg(tail), "tail"), "alt": _tail_in_words(certificate)},
        },
        published={"cell_size": f"{published.CELL_SIZE:g}"},
        quality=_quality(q),
        bound=_bound(certificate["valence_bound"]),
        view=boundary_view(mesh, certificate["worst_elements"]),
        distances=distances_of(certificate),
        shape=_shape(certificate),
        origin=[
            *((name, certificate["input"][key]) for key, name in _INPUT.items() if key in certificate["input"]),
            *certificate["versions"].items(),
        ],
        lost=[
            {"kind": _LOST[place["kind"]], **{key: place[key] for key in ("place_mm", "distance_mm", "vertices")}}
            for place in certificate["lost_places"]
        ],
        records=[
            (title, json.dumps(certificate[key], indent=2))
            for key, title in (("parameters", "Parameters of every stage"), ("reports", "What every stage reported"))
            if certificate[key]
        ],
        links={"cohort": cohort, "files": files},
    )


def write_failure_page(
    name: str,
    failure: Mapping[str, str],
    path: str | Path,
    *,
    surface: TriSurface | None,
    trouble: str = "",
    facts: Facts | None = None,
    cohort: str = "",
) -> None:
    """Write the page of a case that has no mesh.

    Parameters
    ----------
    name : of the case
    failure : `stage` that failed, `state`, `reason`, and `log` if there is one
    surface : the input surface; None where it cannot be read, and `trouble` says why
    facts, cohort : as of `write_case_page`
    """
    pictures: list[dict[str, Any]] = []
    if surface is not None:
        pictures, trouble = _pictures(surface)
    reason, remedy = split_remedy(failure["reason"])
    pages.write(
        "failure.html.j2",
        path,
        title=f"{name}: {failure['state']}",
        name=name,
        failure={"log": "", **failure},
        stage_does=DOES.get(failure["stage"], ""),
        reason=reason,
        remedy=remedy or (_KILLED if "killed" in reason else _READ_LOG),
        facts=facts or [],
        surface_facts=[] if surface is None else _surface_facts(surface),
        pictures=pictures,
        trouble=trouble,
        links={"cohort": cohort},
    )


def split_remedy(reason: str) -> tuple[str, str]:
    """What happened and what to do about it, which `cortet.errors` puts in brackets at the end of a message."""
    text, depth = reason.rstrip(), 0
    for place in range(len(text) - 1, -1, -1) if text.endswith(")") else ():
        depth += (text[place] == ")") - (text[place] == "(")
        if depth == 0:
            return text[:place].rstrip(), text[place + 1 : -1]
    return text, ""


def about(case: Mapping[str, Any]) -> Facts:
    """Facts of a case for its page; what is not known is left out.

    Parameters
    ----------
    case : `scan_age` weeks, `hemi`, `cell_size` mm, `mesher`
    """
    hemispheres = {"L": "left hemisphere", "R": "right hemisphere", None: "whole brain"}
    shown = {
        "Age at scan": case.get("scan_age") and f"{case['scan_age']:g} weeks",
        "Shape": "hemi" in case and hemispheres[case["hemi"]],
        "Cell size": case.get("cell_size") and f"{case['cell_size']:g} mm",
        "Mesher": case.get("mesher"),
    }
    return [(name, value) for name, value in shown.items() if value]


_INPUT = {"file": "Input surface", "sha256": "Its SHA-256"}


def _pictures(
    surface: TriSurface, mesh: TetMesh | None = None, meshed: TriSurface | None = None
) -> tuple[list[dict[str, Any]], str]:
    """Pictures of the surface from both sides, of the cut mesh and of what it leaves behind, or why there are none."""
    surface = measurable(surface)
    if not len(surface.faces):
        return [], "The coordinates of the surface are not finite, so it cannot be drawn."
    topology = surface_topology(surface.faces)
    wrong = "open or branching edges in orange" if topology.open_edges + topology.nonmanifold_edges else ""
    try:
        shown = [
            captioned(surface_view(surface, side=side), f"Input surface from the {SIDES[side]}", wrong)
            for side in SIDES
        ]
        if mesh is not None:
            caption = "Mesh, cut open across the middle"
            shown.append(captioned(cut_view(mesh), caption, "each tetrahedron in the colour of its q"))
            shown += _region_pictures(mesh, meshed)
        if mesh is not None and meshed is not None:
            boundary, _ = boundary_surface(mesh)
            distances = distances_to(boundary, meshed)[len(meshed.points) :]
            scale = f"by its distance to the mesh, white at 0, black at {distances.max():.2g} mm"
            shown += [
                captioned(surface_view(meshed, side=side, distances=distances), f"Meshed surface, {SIDES[side]}", scale)
                for side in SIDES
            ]
    except StageError as error:
        return [], f"Without pictures: {error}"
    return shown, ""


def _repair_pictures(surface: TriSurface, meshed: TriSurface) -> list[dict[str, Any]]:
    """The surface that was meshed by its distance to the file, from both sides."""
    distances = distances_to(measurable(surface), meshed)[len(meshed.points) :]
    darkest = reddest(distances)
    scale = f"by its distance to the file, white at 0, red at {darkest:.2g} mm"
    return [
        captioned(
            surface_view(meshed, side=side, distances=distances, darkest=darkest, colours="Reds"),
            f"Meshed surface, {SIDES[side]}",
            scale,
        )
        for side in SIDES
    ]


def _region_pictures(mesh: TetMesh, meshed: TriSurface | None) -> list[dict[str, Any]]:
    """The cut in the colours of the regions, and each inner surface by its distance to its interface."""
    if meshed is None or not meshed.inner or REGION not in mesh.cell_data:
        return []
    names = region_names(meshed)
    colours = ", ".join(f"{name} {COLOUR_NAMES[i % len(COLOUR_NAMES)]}" for i, name in enumerate(names))
    shown = [captioned(cut_view(mesh, regions=True), "Regions", colours)]
    for number, (name, one) in enumerate(meshed.inner.items(), start=1):
        distances = distances_to(sheet(mesh, number)[0], one)[len(one.points) :]
        scale = f"by its distance to the interface, white at 0, black at {distances.max():.2g} mm"
        shown += [
            captioned(surface_view(one, side=side, distances=distances), f"Inner surface {name}, {side}", scale)
            for side in SIDES
        ]
    return shown


def captioned(image: Any, caption: str, more: str = "") -> dict[str, Any]:
    """A picture (rows, columns, 3) for a page, its caption also what a reader without pictures is told."""
    height, width, _ = image.shape
    text = f"{caption}, {more}" if more else caption
    uri = pages.data_uri(webp(image), "image/webp")
    return {"uri": uri, "width": width, "height": height, "caption": text, "alt": text}


def _surface_facts(surface: TriSurface) -> Facts:
    topology = surface_topology(surface.faces)
    counted = {
        "Vertices": len(surface.points),
        "Faces": len(surface.faces),
        "Components": topology.components,
        "Euler number": topology.euler_number,
        "Edges in one face only": topology.open_edges,
        "Edges in more than two faces": topology.nonmanifold_edges,
    }
    return [(name, f"{count:,}") for name, count in counted.items()]


def in_words(check: Mapping[str, Any]) -> dict[str, Any]:
    """One check of a certificate, its `name`, `value` and `limit` as text with units."""
    unit = f" {check['unit']}" if check["unit"] else ""
    limit = f"{_COMPARED[check['comparison']]} {check['limit']:g}{unit}" if check["comparison"] else "no limit"
    return {**check, "name": _capital(check["name"]), "value": f"{check['value']:.4g}{unit}", "limit": limit}


def _capital(name: str) -> str:
    """The name with a capital letter, unless it begins with a symbol."""
    return re.sub(r"^[a-z](?=[a-z])", lambda letter: letter[0].upper(), name)


def limit_of(certificate: Certificate, name: str) -> float:
    """Limit of a check, by its name."""
    return float(next(check["limit"] for check in certificate["checks"] if check["name"] == name))


def _quality(q: Mapping[str, Any]) -> list[dict[str, str]]:
    """Rows of element quality beside what the paper gives."""
    cohort, measures = published.cohort(), published.measures()
    of_all = f"median [range] of {len(cohort)} meshes"
    final = published.ablation().set_index(["mesher", "stages"]).loc[("cgal", "S1-S4")]
    above = f"{final['q_above_0.6_median']:g} [{final['q_above_0.6_min']:g} to {final['q_above_0.6_max']:g}]"
    spread = {key: _spread(cohort[key]) for key in ("q_mean", "q_max")}
    rows = [
        ("Mean q", f"{q['q']['mean']:.4f}", spread["q_mean"], of_all),
        ("Worst q", f"{q['q']['max']:.4f}", spread["q_max"], of_all),
        *(
            (f"Elements with q > {limit}", f"{count:,}", "", "")
            for limit, count in q["count_above"].items()
            if limit != "0.6"
        ),
        ("Elements with q > 0.6", f"{q['count_above']['0.6']:,}", above, of_all),
    ]
    names = {
        "one_minus_mean_ratio": "Worst 1 - mean ratio",
        "one_minus_radius_ratio": "Worst 1 - radius ratio",
        "one_minus_radius_edge": "Worst 1 - radius-edge ratio",
    }
    for key, name in names.items():
        low, high = measures.loc[key, ["min", "max"]]
        rows.append((name, f"{q[key]['max']:.3f}", f"{low:.3f} to {high:.3f}", "range of 3 meshes"))
    rows += [
        ("Dihedral angles", f"{q['dihedral_min_deg']:.1f}° to {q['dihedral_max_deg']:.1f}°", "", ""),
        ("Edges", f"{q['shortest_edge_mm']:.3f} to {q['longest_edge_mm']:.3f} mm", "", ""),
    ]
    return [dict(zip(("name", "ours", "theirs", "kind"), row, strict=True)) for row in rows]


def _spread(values: pd.Series[float]) -> str:
    return f"{values.median():.3f} [{values.min():.3f} to {values.max():.3f}]"


def _bound(bound: Mapping[str, Any]) -> str:
    return (
        f"No position of the vertices brings the worst q below {bound['q']:.3f}, as the elements are connected: "
        f"{bound['interior_edges_of_valence_3']} interior edges are in three tetrahedra, "
        f"{bound['boundary_edges_of_valence_1']} boundary edges in one."
    )


def _bulk_in_words(certificate: Certificate) -> str:
    q = certificate["quality"]["q"]
    return (
        f"Distribution of q over the elements, beside the published one. This mesh: mean {q['mean']:.3f}, standard "
        f"deviation {q['sd']:.3f}, from {q['min']:.3f} to {q['max']:.3f}."
    )


def _tail_in_words(certificate: Certificate) -> str:
    counts = ", ".join(f"{count} above {limit}" for limit, count in certificate["quality"]["count_above"].items())
    limit = limit_of(certificate, "worst q")
    return f"Elements above q, per million, beside the published meshes; the limit is {limit:g}. This mesh: {counts}."


def _shape(certificate: Certificate) -> Facts:
    fidelity, topology = certificate["fidelity"], certificate["topology"]
    return [
        ("Volume", f"{fidelity['volume_ml']:.2f} mL ({100 * fidelity['relative_volume_change']:+.2f} %)"),
        ("Area", f"{fidelity['area_mm2']:.0f} mm² ({100 * fidelity['relative_area_change']:+.2f} %)"),
        ("Roughness", f"{fidelity['roughness']:.3f} (surface {fidelity['surface_roughness']:.3f})"),
        ("Components of the boundary", str(topology["components"])),
        ("Euler number", str(topology["euler_number"])),
        *_native(certificate),
        *_listed("Where it is open, pinched or fused", certificate["defects_mm"]),
        *_listed("Where faces cross", certificate["crossings_mm"]),
        *_regions(certificate),
    ]


def _native(certificate: Certificate) -> Facts:
    """The area against that of the surface as it was read, where that is known."""
    native = certificate["native"]
    if native is None:
        return []
    change = 100 * native["relative_area_change"]
    return [("Area of the native surface", f"{native['native_area_mm2']:.0f} mm² (the boundary {change:+.2f} %)")]


def _regions(certificate: Certificate) -> Facts:
    """What there is to say of regions and interfaces; nothing for a mesh of one region."""
    facts = []
    for region in certificate["regions"]:
        across = region["edges_across"]
        layers = ""
        if across:
            layers = f", edges across it: {across['least']} at least, {across['median']:g} in the middle"
        volume = f"{region['volume_ml']:.2f} mL ({100 * region['relative_volume_change']:+.2f} %)"
        facts.append((f"Region {region['name']}", f"{volume}, worst q {region['q_max']:.3f}{layers}"))
    for one in certificate["interfaces"]:
        nodes, lost = (one[key]["max"] for key in ("nodes_to_surface_mm", "surface_to_interface_mm"))
        text = f"nodes up to {nodes:.2g} mm off the surface, the surface up to {lost:.2g} mm from it"
        facts.append((f"Interface {one['name']}", f"{text}, Euler number {one['topology']['euler_number']}"))
        thin = [
            f"{p['thickness_mm']:.2f} mm at ({', '.join(f'{x:.1f}' for x in p['place_mm'])})" for p in one["thinnest"]
        ]
        facts.append((f"Thinnest places of {one['around']} around {one['name']}", "; ".join(thin)))
    return facts


def _listed(name: str, places: Iterable[Sequence[float]]) -> Facts:
    text = ", ".join("({:.2f}, {:.2f}, {:.2f})".format(*place) for place in places)
    return [(name, f"{text} mm")] if text else []
