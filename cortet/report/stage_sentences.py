"""What the methods paragraph of a paper says about each stage, from the certificates of its meshes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from cortet.errors import counted
from cortet.measure.verdict import changed_share, share_in_words, surfaces_of
from cortet.meshers import MESHERS
from cortet.report.numbers import Certificate

_BOUNDARY = {
    "fixed": "boundary nodes fixed",
    "free": "boundary nodes free",
    "slide": "boundary nodes sliding on the surface",
}
_SMOOTHED = {
    "taubin": "Surfaces rougher than {max_roughness:g} (mean bi-Laplacian along the normals over the mean edge) were "
    "smoothed by the filter of Taubin",
    "published": "{whose} were smoothed by age, by a surface-preserving Laplacian",
}


def stage_sentences(certificates: Sequence[Certificate]) -> list[str]:
    """A sentence for each stage that did something to these meshes, in the order of the line."""
    told = [_resampled(certificates), _repaired(certificates), _smoothed(certificates), _generated(certificates)]
    for stage, sentence in _OF_PARAMETERS.items():
        told += [sentence(parameters) for parameters in _parameters_of(stage, certificates)[:1]]
    return [sentence for sentence in told if sentence]


def _parameters_of(stage: str, certificates: Sequence[Certificate]) -> list[Mapping[str, Any]]:
    """The parameters of a stage in those certificates whose mesh went through it."""
    return [content["parameters"][stage] for content in certificates if content["parameters"].get(stage)]


def _resampled(certificates: Sequence[Certificate]) -> str:
    reports = {content["case"]: content["reports"].get("resample") for content in certificates}
    resampled = [report for report in reports.values() if report]
    if not resampled:
        return ""
    vertices = " and ".join(f"{count:,}" for count in sorted({report["vertices"] for report in resampled}))
    all_of_them = len(resampled) == len(reports)
    which = "Surfaces were" if all_of_them else f"{counted(len(resampled), 'surface')} with a sphere were"
    means = [report["native_to_resampled_mm"]["mean"] for report in resampled]
    return (
        f"{which} put onto a common mesh of {vertices} vertices through their spheres, by barycentric interpolation as "
        f"in Connectome Workbench (mean distance to the native surface {min(means):.3f} to {max(means):.3f} mm)."
    )


def _repaired(certificates: Sequence[Certificate]) -> str:
    reports = {content["case"]: content["reports"].get("repair", {}) for content in certificates}
    told = []
    for case, report in reports.items():
        for region, one in surfaces_of(report).items():
            steps = [f"{step['count']:,} {step['done']}" for step in one["steps"]]
            changed = f"{share_in_words(changed_share(one))} of its area made or dropped"
            told.append(f"{case}{f' {region}' if region else ''} ({', '.join([*steps, changed])})")
    return f"{counted(len(told), 'surface')} had been repaired: {'; '.join(told)}." if told else ""


def _smoothed(certificates: Sequence[Certificate]) -> str:
    smoothed = _parameters_of("smooth_surface", certificates)
    if not smoothed:
        return ""
    done = smoothed[0]
    whose = "Surfaces" if len(smoothed) == len(certificates) else "Surfaces of known age"
    return (
        f"{_SMOOTHED[done['method']].format(whose=whose, **done)} (PyMeshLab; area change at most "
        f"{100 * done['max_area_change']:g} %, mean displacement at most {done['max_displacement']:g} mm)."
    )


def _generated(certificates: Sequence[Certificate]) -> str:
    every = [content["parameters"]["generate"] for content in certificates]
    sizes = " and ".join(f"{size:g}" for size in sorted({done["cell_size"] for done in every}))
    backends = [content["reports"]["generate"]["backend"] for content in certificates]
    ways = []
    for (name, backend), count in sorted(Counter(zip((d["mesher"] for d in every), backends, strict=True)).items()):
        mesher, meshes = MESHERS[name], counted(count, "mesh", "meshes")
        if mesher.may_change_topology and backend not in ("pygalmesh", "cgal"):
            fallback = every[0]["fallback"]
            ways.append(f"the fallback {fallback}, where CGAL's boundary had another topology ({count})")
        else:
            ways.append(mesher.said(every[0], backend, name, meshes))
    return f"They were filled with tetrahedra of cell size h = {sizes} mm by {' and '.join(ways)}."


def _relocated(done: Mapping[str, Any]) -> str:
    passes = counted(done["passes"], "pass", "passes")
    return f"Nodes were relocated by {passes} of Gmsh's Relocate3D ({_BOUNDARY[done['boundary']]})."


def _cleaned(done: Mapping[str, Any]) -> str:
    thresholds = ", ".join(f"{value:g}" for value in done["thresholds"])
    program = " by meshtool" if done["backend"] == "meshtool" else ""
    mean = ", with sweeps that improve the mean" if done["improve_mean"] else ""
    return (
        f"Vertices around elements with q > {thresholds} were moved{program}, in this order, to lower the worst q "
        f"({_BOUNDARY[done['boundary']]}{mean})."
    )


def _reconnected(done: Mapping[str, Any]) -> str:
    boundary = _BOUNDARY[done["boundary"]]
    return f"Elements with q > {done['threshold']:g} were reconnected by local swaps ({boundary})."


def _boundary_smoothed(done: Mapping[str, Any]) -> str:
    return f"The boundary was smoothed ({counted(done['iterations'], 'iteration')})."


def _snapped(_: Mapping[str, Any]) -> str:
    return "Boundary nodes were put onto the nearest point of the surface."


#: stage -> its sentence from its parameters, which are those of all meshes
_OF_PARAMETERS = {
    "relocate": _relocated,
    "clean": _cleaned,
    "reconnect": _reconnected,
    "smooth_boundary": _boundary_smoothed,
    "snap": _snapped,
}
