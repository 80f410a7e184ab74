"""A paragraph for the methods section of a paper, from what was run: parameters, versions, numbers, exclusions."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.cohort.sheet import Case
from cortet.formats.atomic import atomic_path
from cortet.report.table_files import write_page

VERSION: int = 3

#: content of a certificate.json
Certificate = Mapping[str, Any]

_SMOOTHING = {
    "taubin": "Surfaces rougher than {max_roughness:g} (mean bi-Laplacian along the normals over the mean edge) were "
    "smoothed by the filter of Taubin",
    "published": "{whose} were smoothed by age, by a surface-preserving Laplacian",
}
_BOUNDARY = {
    "fixed": "boundary nodes fixed",
    "free": "boundary nodes free",
    "slide": "boundary nodes sliding on the surface",
}
#: distribution -> how a paper names it
_NAMES = {
    "numpy": "NumPy",
    "scipy": "SciPy",
    "numba": "Numba",
    "nibabel": "NiBabel",
    "pymeshlab": "PyMeshLab",
    "tetgen": "TetGen (Python package)",
    "gmsh": "Gmsh",
    "cgal": "CGAL (Python package cgal)",
    "python": "Python",
}


def methods_text(certificates: Sequence[Certificate], sheet: Iterable[Case], failures: Mapping[str, str]) -> str:
    """The paragraph, in Markdown.

    Parameters
    ----------
    certificates : contents of the certificates of the line's meshes, at least one; their parameters and versions are
        those of the first, save the cell sizes and meshers, and smoothing, which surfaces of unknown age lack
    sheet : all cases, excluded ones too
    failures : case -> why it has no certificate
    """
    cases = {case.name: case for case in sheet}
    meshed = [cases[name] for name in dict.fromkeys(content["case"] for content in certificates)]
    sentences = [
        *_cohort(meshed),
        *_exclusions(cases.values(), failures),
        *_stages(certificates),
        *_outcome(certificates),
        _versions(certificates[0]["versions"]),
    ]
    return " ".join(sentences) + "\n"


def write_methods(
    certificates: Iterable[str],
    sheet: Iterable[Case],
    failures: Mapping[str, str],
    markdown: str | Path,
    view: str | Path,
) -> None:
    """Write the paragraph, and an HTML page of it, from the files of certificates."""
    contents = [json.loads(Path(name).read_text(encoding="utf-8")) for name in certificates]
    text = methods_text(contents, sheet, failures)
    with atomic_path(markdown) as temporary:
        temporary.write_text(text, encoding="utf-8")
    write_page(text, view, title="Methods")


def _cohort(cases: Sequence[Case]) -> list[str]:
    ages = [case.scan_age for case in cases if case.scan_age is not None]
    sides = Counter({"L": "left", "R": "right"}.get(case.hemi or "", "whole") for case in cases)
    kinds = {"left": "left hemisphere", "right": "right hemisphere", "whole": "whole brain"}
    parts = [_counted(sides[side], kind) for side, kind in kinds.items() if sides[side]]
    subjects = len({case.participant for case in cases})
    at_scan = _ages(ages, len(cases))
    phantoms = sum(case.is_phantom for case in cases)
    made = f" ({'all' if phantoms == len(cases) else phantoms} of them synthetic)" if phantoms else ""
    return [
        f"Tetrahedral meshes were made of {_counted(len(cases), 'closed cortical surface')}{made} of "
        f"{_counted(subjects, 'participant')} ({', '.join(parts)}; {at_scan}) with cortet, "
        "an implementation of CORTET (arXiv:2607.12157)."
    ]


def _ages(ages: Sequence[float], of: int) -> str:
    """The range of the ages that are known, weeks, of so many surfaces."""
    if not ages:
        return "age at scan not known"
    weeks = f"{min(ages):g}" if min(ages) == max(ages) else f"{min(ages):g}-{max(ages):g}"
    unknown = f", of {of - len(ages)} of them not known" if len(ages) < of else ""
    return f"gestational age at scan {weeks} weeks{unknown}"


def _exclusions(cases: Iterable[Case], failures: Mapping[str, str]) -> list[str]:
    excluded = [f"{case.name} ({case.exclude_reason})" for case in cases if not case.include]
    failed = [f"{name} ({_for_readers(reason)})" for name, reason in sorted(failures.items())]
    sentences = []
    if excluded:
        sentences.append(f"{_counted(len(excluded), 'surface')} had been excluded: {'; '.join(excluded)}.")
    if failed:
        sentences.append(f"{_counted(len(failed), 'surface')} could not be meshed: {'; '.join(failed)}.")
    return sentences or ["No surface was excluded."]


def _for_readers(reason: str) -> str:
    """A reason without folders of this machine, and without the words of an exception that nobody foresaw."""
    if re.match(r"[A-Za-z_.]*(Error|Exception|Exit)\b", reason):
        return "an unexpected error; see cohort_status.tsv"
    return re.sub(r"(?:~|\.{1,2})?(?:/[^\s/:;,()]+)*/([^\s/:;,()]+)", r"\1", reason)


def _stages(certificates: Sequence[Certificate]) -> list[str]:
    every = [content["parameters"] for content in certificates]
    parameters = every[0]
    sizes = sorted({content["parameters"]["generate"]["cell_size"] for content in certificates})
    backends = Counter(
        (content["parameters"]["generate"]["mesher"], content["reports"]["generate"]["backend"])
        for content in certificates
    )
    sentences = _resampling(certificates)
    smoothed = [one["smooth_surface"] for one in every if one.get("smooth_surface")]
    if smoothed:
        smooth = smoothed[0]
        whose = "Surfaces" if len(smoothed) == len(every) else "Surfaces of known age"
        sentences.append(
            f"{_SMOOTHING[smooth['method']].format(whose=whose, **smooth)} (PyMeshLab; area change at most "
            f"{100 * smooth['max_area_change']:g} %, mean displacement at most {smooth['max_displacement']:g} mm)."
        )
    sentences.append(_generation(parameters["generate"], sizes, backends))
    if relocate := parameters.get("relocate"):
        sentences.append(
            f"Nodes were relocated by {_counted(relocate['passes'], 'pass')} of Gmsh's Relocate3D "
            f"({_BOUNDARY[relocate['boundary']]})."
        )
    if clean := parameters.get("clean"):
        thresholds = ", ".join(f"{value:g}" for value in clean["thresholds"])
        program = " by meshtool" if clean["backend"] == "meshtool" else ""
        sentences.append(
            f"Vertices around elements with q > {thresholds} were moved{program}, in this order, to lower the worst q "
            f"({_BOUNDARY[clean['boundary']]}{', with sweeps that improve the mean' if clean['improve_mean'] else ''})."
        )
    if reconnect := parameters.get("reconnect"):
        sentences.append(
            f"Elements with q > {reconnect['threshold']:g} were reconnected by local swaps "
            f"({_BOUNDARY[reconnect['boundary']]})."
        )
    if "smooth_boundary" in parameters:
        sentences.append(
            f"The boundary was smoothed ({_counted(parameters['smooth_boundary']['iterations'], 'iteration')}, method "
            f"{parameters['smooth_boundary']['method']})."
        )
    if "snap" in parameters:
        sentences.append("Boundary nodes were put onto the nearest point of the surface.")
    return sentences


def _resampling(certificates: Sequence[Certificate]) -> list[str]:
    """How surfaces came onto the common mesh, where some did."""
    reports = {content["case"]: content["reports"].get("resample") for content in certificates}
    resampled = [report for report in reports.values() if report]
    if not resampled:
        return []
    vertices = " and ".join(f"{count:,}" for count in sorted({report["vertices"] for report in resampled}))
    which = (
        "Surfaces were"
        if len(resampled) == len(reports)
        else f"{_counted(len(resampled), 'surface')} with a sphere were"
    )
    means = [report["native_to_resampled_mm"]["mean"] for report in resampled]
    return [
        f"{which} put onto a common mesh of {vertices} vertices through their spheres, by barycentric interpolation as "
        f"in Connectome Workbench (mean distance to the native surface {min(means):.3f} to {max(means):.3f} mm)."
    ]


def _generation(parameters: Mapping[str, Any], sizes: Sequence[float], backends: Counter[tuple[str, str]]) -> str:
    cells = " and ".join(f"{size:g}" for size in sizes)
    ways = []
    for (mesher, backend), count in sorted(backends.items()):
        if mesher != "cgal":
            ways.append(f"the mesher {mesher} ({_counted(count, 'mesh')})")
        elif backend == "tetgen":
            ways.append(f"the fallback {parameters['fallback']}, where CGAL's boundary had another topology ({count})")
        else:
            passes = [name for name in ("odt", "lloyd", "perturb", "exude") if parameters[name]]
            distances = ", ".join(f"{value:g}" for value in parameters["facet_distance"])
            ways.append(
                f"CGAL Mesh_3 through {backend} (facet angle {parameters['facet_angle']:g} degrees, facet distance "
                f"{distances} h, tried in this order until the topology was right, radius-edge ratio "
                f"{parameters['radius_edge_ratio']:g}, optimisation {', '.join(passes) or 'none'}, seed "
                f"{parameters['seed']}; {_counted(count, 'mesh')})"
            )
    return f"They were filled with tetrahedra of cell size h = {cells} mm by {' and '.join(ways)}."


def _outcome(certificates: Sequence[Certificate]) -> list[str]:
    worst = [content["quality"]["q"]["max"] for content in certificates]
    limit = next(check["limit"] for check in certificates[0]["checks"] if check["name"] == "worst q")
    certified = sum(content["certified"] for content in certificates)
    sentences = [
        "Quality was measured as q = 1 - √2 · 6V / l³ (V volume, l root mean square edge length; 0 for a regular "
        f"tetrahedron, 1 for a flat one). Of {_counted(len(certificates), 'mesh')}, {certified} had a worst q below "
        f"{limit:g}, positive volumes and a boundary with the topology and the place of the surface (certified); the "
        f"worst q was {min(worst):.3f} to {max(worst):.3f}."
    ]
    if refused := [content for content in certificates if not content["certified"]]:
        reasons = "; ".join(f"{content['case']} ({'; '.join(content['reasons'])})" for content in refused)
        sentences.append(f"Not certified: {reasons}.")
    return sentences


def _versions(versions: Mapping[str, str]) -> str:
    named = [f"{_NAMES.get(name, name)} {number}" for name, number in versions.items()]
    return f"Software: {', '.join(named)}."


def _counted(count: int, noun: str) -> str:
    plural = f"{noun}es" if noun.endswith(("h", "ss")) else f"{noun}s"
    return f"{count} {noun if count == 1 else plural}"
