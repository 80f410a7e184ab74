"""A methods section for a paper about a run: parameters, versions, numbers, exclusions, references."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from cortet.cohort.sheet import Case
from cortet.formats.atomic import atomic_path
from cortet.measure.checks import Check
from cortet.report.citation import CLOSING, REFERENCES, cited, reference
from cortet.report.records import read_certificate
from cortet.report.stage_sentences import Certificate, counted, stage_sentences

VERSION: int = 6

#: programs that check every surface
_ALWAYS = ("pymeshlab",)
#: distribution -> its name in a paper
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
    certificates : contents of the certificates of the line's meshes, at least one. The first gives all parameters and
        versions, except for cell sizes, meshers, and smoothing, which surfaces of unknown age lack
    sheet : all cases, including excluded ones
    failures : case -> why it has no certificate
    """
    cases = {case.name: case for case in sheet}
    meshed = [cases[name] for name in dict.fromkeys(content["case"] for content in certificates)]
    sentences = [
        *_cohort(meshed),
        *_exclusions(cases.values(), failures),
        *stage_sentences(certificates),
        *_outcome(certificates),
        _versions(certificates),
    ]
    return " ".join(sentences) + "\n"


def write_methods(
    certificates: Iterable[str],
    sheet: Iterable[Case],
    failures: Mapping[str, str],
    markdown: str | Path,
) -> None:
    """Write the paragraph with its references, from the files of certificates."""
    contents = [read_certificate(name) for name in certificates]
    closed = f"{methods_text(contents, sheet, failures).strip()} {CLOSING}"
    references = [reference(REFERENCES[key]) for key in cited(contents)]
    listed = "\n".join(f"{number}. {words}" for number, words in enumerate(references, start=1))
    with atomic_path(markdown) as temporary:
        temporary.write_text(f"{closed} [1-{len(references)}].\n\n## References\n\n{listed}\n", encoding="utf-8")


def _cohort(cases: Sequence[Case]) -> list[str]:
    ages = [case.scan_age for case in cases if case.scan_age is not None]
    sides = Counter({"L": "left", "R": "right"}.get(case.hemi or "", "whole") for case in cases)
    kinds = {"left": "left hemisphere", "right": "right hemisphere", "whole": "whole brain"}
    parts = [counted(sides[side], kind) for side, kind in kinds.items() if sides[side]]
    subjects = len({case.participant for case in cases})
    at_scan = _ages(ages, len(cases))
    phantoms = sum(case.is_phantom for case in cases)
    made = f" ({'all' if phantoms == len(cases) else phantoms} of them synthetic)" if phantoms else ""
    return [
        f"Tetrahedral meshes were made of {counted(len(cases), 'closed cortical surface')}{made} of "
        f"{counted(subjects, 'participant')} ({', '.join(parts)}; {at_scan}) with cortet, "
        "an implementation of CORTET (arXiv:2607.12157)."
    ]


def _ages(ages: Sequence[float], of: int) -> str:
    """The range of known ages, weeks, of `of` surfaces."""
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
        sentences.append(f"{counted(len(excluded), 'surface')} had been excluded: {'; '.join(excluded)}.")
    if failed:
        sentences.append(f"{counted(len(failed), 'surface')} could not be meshed: {'; '.join(failed)}.")
    return sentences or ["No surface was excluded."]


def _for_readers(reason: str) -> str:
    """A reason without folders of this machine and without the text of an unexpected exception."""
    if re.match(r"[A-Za-z_.]*(Error|Exception|Exit)\b", reason):
        return "an unexpected error"
    return re.sub(r"[^\s:;,()]*/([^\s/:;,()]+)", r"\1", reason)


def _outcome(certificates: Sequence[Certificate]) -> list[str]:
    worst = [content["quality"]["q"]["max"] for content in certificates]
    limit = next(check["limit"] for check in certificates[0]["checks"] if check["id"] == "worst_q")
    certified = sum(content["certified"] for content in certificates)
    sentences = [
        "Quality was measured as q = 1 - √2 · 6V / l³ (V volume, l root mean square edge length; 0 for a regular "
        f"tetrahedron, 1 for a flat one). Of {counted(len(certificates), 'mesh')}, {certified} had a worst q below "
        f"{limit:g}, positive volumes and a boundary with the topology and the place of the surface (certified); the "
        f"worst q was {min(worst):.3f} to {max(worst):.3f}."
    ]
    if refused := [content for content in certificates if not content["certified"]]:
        reasons = "; ".join(f"{content['case']} ({findings(content)})" for content in refused)
        sentences.append(f"Not certified: {reasons}.")
    return sentences


def findings(certificate: Certificate) -> str:
    """What failed, with its value and limit."""
    return "; ".join(Check(**check).finding for check in certificate["checks"] if not check["passed"])


def _versions(certificates: Sequence[Certificate]) -> str:
    """Versions of the programs that were used: a certificate has those of all that are installed."""
    compiled = any(content["reports"].get("generate", {}).get("backend") == "pygalmesh" for content in certificates)
    used = {"pygalmesh" if key == "cgal" and compiled else key for key in cited(certificates)}
    unused = {"pygalmesh", *REFERENCES} - {*used, *_ALWAYS}
    versions = {name: number for name, number in certificates[0]["versions"].items() if name not in unused}
    named = [f"{_NAMES.get(name, name)} {number}" for name, number in versions.items()]
    return f"Software: {', '.join(named)}."
