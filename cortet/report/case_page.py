"""The page of one case: its mesh and certificate, or what failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cortet.formats.tables import Column, headed
from cortet.formats.volumes import TISSUE_COLUMNS
from cortet.geometry.mending import measurable
from cortet.geometry.topology import surface_topology
from cortet.meshes import TetMesh, TriSurface, region_names
from cortet.report import pages, pictures
from cortet.report.boundary_view import boundary_view
from cortet.report.figures import mesh_quality_figures, svg
from cortet.report.numbers import ELEMENTS, Certificate, limit_of, of_check
from cortet.report.pages import Panel, Part

#: job of the workflow besides those of stages -> what it does, in words
_DOES = {
    "phantom": "makes a synthetic surface",
    "fields": "reads the fields of the surface",
    "volumes": "reads the volumes around the mesh",
}
#: remedy of a job that left no message
_READ_LOG = "read the log; it holds every line the job printed"
_NOT_FINITE = "cortet cannot draw the surface, because its coordinates are not finite."
NOTHING: Mapping[str, str] = MappingProxyType({})
#: entries of `ELEMENTS` at the top of the page
_SIZE = ("Nodes", "Tetrahedra")


#: columns of the table of layers: the fields of `measure.layers.LayerRecord`
LAYER_COLUMNS = (
    Column("number", "1 is the outermost", heading="layer"),
    Column("depth", "Depths between which it lies, 0 pial and 1 white", heading="equivolumetric depth"),
    Column("tetrahedra", "Number of its tetrahedra", heading="tetrahedra", form=",.0f"),
    Column("volume_ml", "Their volume", units="mL", heading="volume, mL", form=".3f"),
    Column("cut", "Fraction of them that lie partly in another layer", heading="in several layers", form=".1%"),
)

#: columns of the table of contacts: the fields of `measure.electrodes.ElectrodeRecord`
CONTACT_COLUMNS = (
    Column("name", "Contact of an electrode", heading="contact"),
    Column("moved_mm", "Distance from the given coordinates", units="mm", heading="moved, mm", form=".2f"),
    Column("area_mm2", "Area of the disc along the boundary", units="mm2", heading="area, mm²", form=".2f"),
    Column("nominal_area_mm2", "Area of a plane circle", units="mm2", heading="nominal, mm²", form=".2f"),
    Column("radius_over_edge", "Edges that span the radius", heading="edges per radius", form=".1f"),
    Column("depth", "Equivolumetric depth, 0 pial and 1 white", heading="depth", form=".2f"),
    Column("region", "Region below the contact", heading="region"),
    Column("labels", "Label at the contact, by field", heading="labels"),
)


class Checked(NamedTuple):
    """What the page of a mesh, certified or not, shows."""

    mesh: TetMesh
    #: the input surface, mm; its coordinates need not be finite
    surface: TriSurface
    #: the surface that was meshed, drawn in the colour of its distance to the boundary
    meshed: TriSurface
    #: content of the mesh's certificate.json
    certificate: Certificate
    #: name and title of files in the folder of the page
    files: Sequence[tuple[str, str]] = ()
    #: rows of `formats.volumes.TISSUE_COLUMNS`
    tissues: Sequence[Mapping[str, Any]] = ()
    #: PNG file of the volume with the mesh in it
    slices: Path | None = None


def write_case_page(of: Checked, path: str | Path, *, facts: Mapping[str, str] = NOTHING, cohort: str = "") -> None:
    """Write the page of a mesh.

    Parameters
    ----------
    facts : further facts of the case, by their names
    cohort : address of the cohort page, as seen from this page
    """
    name, q = of.certificate["case"], of.certificate["quality"]
    certified = of.certificate["certified"]
    verdict = of.certificate["verdict"] if certified else ""
    pages.write(
        path,
        f"{name}: {verdict or 'not certified'}",
        _panels(of._replace(surface=measurable(of.surface))),
        heading=name,
        state="certified" if certified else "uncertified",
        verdict=verdict,
        top=[("facts", {"texts": {**facts, **{size: ELEMENTS[size].format_map(q) for size in _SIZE}}})],
        cohort=cohort,
        scripts=(pages.source("three.js"), pages.source("view.js")),
    )


def write_failure_page(
    name: str,
    failure: Mapping[str, str],
    path: str | Path,
    *,
    surface: TriSurface | None,
    trouble: str = "",
    facts: Mapping[str, str] = NOTHING,
    cohort: str = "",
) -> None:
    """Write the page of a case that has no mesh.

    Parameters
    ----------
    name : name of the case
    failure : `stage` that failed, `state`, `reason`; `remedy`, `log` and `earlier`, the folder of results that are
        out of date, if there are any
    surface : the input surface; None if it cannot be read, and `trouble` says why
    facts, cohort : as in `write_case_page`
    """
    does = _does(failure["stage"])
    story = {
        "At stage": f"`{failure['stage']}`" + (f": {does}" if does else ""),
        "Reason": failure["reason"],
        "What to do": failure.get("remedy") or _READ_LOG,
        **({"Log of the job, in the output folder": f"`{failure['log']}`"} if failure.get("log") else {}),
        **({"Earlier results, in the output folder": f"`{failure['earlier']}`"} if failure.get("earlier") else {}),
    }
    pages.write(
        path,
        f"{name}: {failure['state']}",
        [
            Panel("what", "What went wrong", [("story", {"texts": story})]),
            Panel("surface", "The input surface", _input_surface(surface) if surface else [("note", trouble)]),
        ],
        heading=name,
        state=failure["state"],
        top=[("facts", {"texts": facts})],
        cohort=cohort,
    )


def _does(job: str) -> str:
    """What a job of the workflow does, in words; empty if nobody has said it."""
    from cortet.stages import STAGES  # loads the configuration, which the page of a mesh does without

    if stage := STAGES.get(job):
        return f"{stage.does} ({stage.number})" if stage.number else stage.does
    return _DOES.get(job, "")


def about(case: Mapping[str, Any]) -> dict[str, str]:
    """Facts of a case for its page, by their names; unknown facts are left out.

    Parameters
    ----------
    case : `surface` white or pial, `scan_age` weeks, `hemi`, `cell_size_mm`, `mesher`
    """
    surfaces = {"white": "white, with the cortex outside it", "pial": "pial, with the cortex inside it"}
    hemispheres = {"L": "left hemisphere", "R": "right hemisphere", None: "whole brain"}
    known = {
        "Age at scan": case.get("scan_age") and f"{case['scan_age']:g} weeks",
        "Surface": surfaces.get(case.get("surface", "")),
        "Shape": "hemi" in case and hemispheres[case["hemi"]],
        "Cell size": case.get("cell_size_mm") and f"{case['cell_size_mm']:g} mm",
        "Mesher": case.get("mesher"),
    }
    return {name: value for name, value in known.items() if value}


def _input_surface(surface: TriSurface) -> list[Part]:
    """Counts and pictures of the surface of a case that failed."""
    topology, finite = surface_topology(surface.faces), measurable(surface)
    counted = {
        "Vertices": len(surface.points),
        "Faces": len(surface.faces),
        "Components": topology.components,
        "Euler number": topology.euler_number,
        "Edges in one face only": topology.open_edges,
        "Edges in more than two faces": topology.nonmanifold_edges,
    }
    drawn = pictures.shown(lambda: pictures.of_input(finite)) if len(finite.faces) else [("note", _NOT_FINITE)]
    return [("facts", {"texts": {name: f"{count:,}" for name, count in counted.items()}}), *drawn]


# --- panels of a mesh ------------------------------------------------------------------------------------------------


def _panels(of: Checked) -> list[Panel]:
    """The panels of the page of a mesh; those without parts are left out."""
    certificate = of.certificate
    reasons, remarks = certificate["reasons"], certificate.get("remarks")
    view = boundary_view(of.mesh, certificate["worst_elements"])
    panels = [
        Panel("reasons", "Why it is not certified", [("points", reasons)] if reasons else []),
        Panel("remarks", "Remarks", [("points", remarks)] if remarks else []),
        Panel("sections", "Sections", _sections(of)),
        Panel("layers", "Layers of the cortex", _layers(of)),
        Panel("contacts", "Contacts of electrodes", _contacts(of)),
        Panel("pictures", "Surface and mesh", _surface_and_mesh(of)),
        Panel("tissues", "In the volume", _tissues(of)),
        Panel("resampled", "On the common mesh", _resampled(of)),
        Panel("repair", "The input was repaired", _repaired(of)),
        Panel("verdict", "Verdict", [("verdict", [of_check(check) for check in certificate["checks"]])]),
        Panel("quality", "Element quality", _quality(of)),
        Panel("worst", "Worst elements", [("worst", {"of": certificate})]),
        Panel("turn", "The boundary in 3D", [("turned", {"view": view})]),
        Panel("fidelity", "Distance to the meshed surface", [("fidelity", {"of": certificate})]),
        Panel("record", "Provenance", [("record", {"of": certificate, "files": of.files})]),
    ]
    return [panel for panel in panels if panel.parts]


def _surface_and_mesh(of: Checked) -> list[Part]:
    if not len(of.surface.faces):
        return [("note", _NOT_FINITE)]
    as_given = np.array_equal(of.surface.points, of.meshed.points)  # then its pictures would be the same twice

    def drawn() -> list[pictures.Picture]:
        return [*([] if as_given else pictures.of_input(of.surface)), *pictures.of_mesh(of.mesh, of.meshed)]

    return pictures.shown(drawn)


def _sections(of: Checked) -> list[Part]:
    """Sections through the tetrahedra, over the image of the case if it has one."""
    if of.slices is not None:
        caption = "Slices of the image through the middle of the mesh, and on them the sections through its tetrahedra"
        return [("maps", [pictures.captioned(pictures.png(of.slices), caption)])]
    return pictures.shown(lambda: pictures.of_sections(of.mesh, region_names(of.meshed.inner)))


def _layers(of: Checked) -> list[Part]:
    """The layers that the certificate has, and a section through them."""
    if not (layers := of.certificate.get("layers")):
        return []
    rows = [
        {
            **layer,
            "number": str(layer["number"] or "none: no column"),
            "depth": "{:.3f} to {:.3f}".format(*layer["depth"]),
        }
        for layer in layers
    ]
    inner, bounds = of.meshed.inner, np.array([0, *(layer["depth"][1] for layer in layers if layer["number"])])
    table = pages.table("Layers from the pial to the white surface", headed(LAYER_COLUMNS), rows)
    return [table, *pictures.shown(lambda: pictures.of_layers(of.mesh, inner, bounds))]


def _contacts(of: Checked) -> list[Part]:
    """The contacts that the certificate has."""
    rows = [
        {**one, "labels": ", ".join(f"{name} {label}" for name, label in one.get("labels", {}).items())}
        for one in of.certificate.get("electrodes", ())
    ]
    return [pages.table("Contacts on the mesh", headed(CONTACT_COLUMNS), rows)] if rows else []


def _tissues(of: Checked) -> list[Part]:
    return [pages.table("Tetrahedra with each label", headed(TISSUE_COLUMNS), of.tissues)] if of.tissues else []


def _resampled(of: Checked) -> list[Part]:
    surfaces = _changed(of.certificate, "resample", "resampled")
    return [("resampled", {"surfaces": surfaces})] if surfaces else []


def _repaired(of: Checked) -> list[Part]:
    parts: list[Part] = []
    for name, one in _changed(of.certificate, "repair", "repaired").items():
        drawn = [] if name else pictures.shown(lambda: pictures.of_repair(of.surface, of.meshed))
        parts += [("repaired", {"name": name, "one": one}), *drawn]
    return parts


def _changed(certificate: Certificate, stage: str, changed: str) -> dict[str, Mapping[str, Any]]:
    """Reports of the surfaces that a stage changed: the outer surface without a name, then inner surfaces."""
    report = certificate["reports"].get(stage, {})
    return {name: one for name, one in {"": report, **report.get("inner", {})}.items() if one.get(changed)}


def _quality(of: Checked) -> list[Part]:
    q, limit = of.certificate["quality"], limit_of(of.certificate, "worst_q")
    bulk, tail = mesh_quality_figures(np.array(q["histogram"]), limit=limit)
    shown = {
        "q": q,
        "limit": limit,
        "bulk": pages.embedded(svg(bulk), "bulk"),
        "tail": pages.embedded(svg(tail), "tail"),
        "elements": {name: text.format_map(q) for name, text in ELEMENTS.items() if name not in _SIZE},
    }
    return [("quality", shown)]
