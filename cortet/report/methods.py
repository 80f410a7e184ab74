"""The methods paragraph of a run, for a paper: parameters, versions, numbers, exclusions and references.

`logs/CITATION.md` cites by keys of `CITATION.bib`: `pandoc --citeproc --bibliography CITATION.bib` resolves them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from cortet.cohort.sheet import Case
from cortet.errors import counted
from cortet.formats.atomic import atomic_path
from cortet.measure.checks import Check
from cortet.report import DATA
from cortet.report.numbers import Certificate, limit_of
from cortet.report.stage_sentences import stage_sentences
from cortet.version import __version__

VERSION: int = 7

#: key -> BibTeX entry, in the order of the list; the key of a program is its name in the versions of a certificate
REFERENCES = {
    found[1]: found[0].replace("VERSION", __version__)
    for found in re.finditer(
        r"@\w+\{(\w+),\n.*?\n\}\n",
        (DATA / "references.bib").read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
}
#: end of the first sentence
_METHOD = "an implementation of CORTET (arXiv:2607.12157)."
#: before the references, at the end of the paragraph
_CLOSING = "The method and the software are described in"
#: name of a mesher in S1 -> key of its program
_MESHERS = {"pygalmesh": "cgal", "lattice": "tetgen"}
#: stage -> the program that does its work
_PROGRAMS = {"relocate": "gmsh", "smooth_surface": "pymeshlab", "resample": "workbench"}
#: libraries that every stage uses
_LIBRARIES = ("numpy", "scipy", "numba")
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


def methods_text(
    certificates: Sequence[Certificate],
    sheet: Iterable[Case],
    failures: Mapping[str, str],
    further: Sequence[str] = (),
) -> str:
    """The paragraph of a cohort, in Markdown.

    Parameters
    ----------
    certificates : contents of the certificates of the line's meshes, at least one. The first gives all parameters and
        versions, except for cell sizes, meshers, and smoothing, which surfaces of unknown age lack
    sheet : all cases, including excluded ones
    failures : case -> why it has no certificate
    further : sentences on what was done with the meshes, such as their folds
    """
    cases = {case.name: case for case in sheet}
    meshed = [cases[name] for name in dict.fromkeys(content["case"] for content in certificates)]
    told = [*_cohort(meshed), *_exclusions(cases.values(), failures)]
    return " ".join([*told, *_done(certificates), *further, _versions(certificates)]) + "\n"


def methods_of_mesh(certificate: Certificate, age: float | None, hemi: str | None, further: Sequence[str] = ()) -> str:
    """The paragraph of a single mesh, in Markdown.

    Parameters
    ----------
    certificate : content of its certificate
    age : gestational age, weeks, if it is known
    hemi : L or R; None: a whole brain, or not known
    further : as in `methods_text`
    """
    of = {"L": "the left hemisphere of a brain", "R": "the right hemisphere of a brain"}.get(hemi or "", "a brain")
    aged = f" ({_ages([age], 1)})" if age is not None else ""
    first = f"A tetrahedral mesh was made of a closed cortical surface of {of}{aged} with cortet, {_METHOD}"
    return " ".join([first, *_done([certificate]), *further, _versions([certificate])]) + "\n"


def with_citations(paragraph: str, certificates: Sequence[Certificate]) -> str:
    """The paragraph with the keys of its references; parameters as of `write_citation`."""
    in_text = "; ".join(f"@{key}" for key in cited(certificates))
    return f"{paragraph.strip()} {_CLOSING} [{in_text}].\n"


def _done(certificates: Sequence[Certificate]) -> list[str]:
    """What the stages did, and what came out."""
    made = [content for content in certificates if "generate" in content["reports"]]
    return [*(stage_sentences(made) if made else []), *_outcome(certificates)]


def write_citation(paragraph: str, certificates: Sequence[Certificate], markdown: str, bibtex: str) -> None:
    """Write the paragraph with the keys of its references, and the references.

    Parameters
    ----------
    paragraph : from `methods_text`
    certificates : contents of the certificates that the paragraph is about
    """
    text = f"{with_citations(paragraph, certificates)}\n### References\n"
    for path, content in ((markdown, text), (bibtex, bibliography(certificates))):
        with atomic_path(path) as temporary:
            temporary.write_text(content, encoding="utf-8")


def bibliography(certificates: Sequence[Certificate]) -> str:
    """BibTeX of what a run used; parameter as of `cited`."""
    return "\n".join(REFERENCES[key] for key in cited(certificates))


def cited(certificates: Sequence[Certificate]) -> list[str]:
    """Keys of the programs that a run used, from the reports of its stages: not every installed program was used."""
    reports = [content["reports"] for content in certificates]
    backends = {report["generate"].get("backend", "") for report in reports if "generate" in report}
    used = {"cortet", "cortetsoftware", *_LIBRARIES, *(_MESHERS.get(name, name) for name in backends)}
    worked = [{name: one for name, one in stages.items() if one.get("chosen_iterations", True)} for stages in reports]
    used |= {program for stage, program in _PROGRAMS.items() if any(stage in stages for stages in worked)}
    if any(stages.get("smooth_surface", {}).get("method") == "taubin" for stages in worked):
        used.add("taubin")
    return [key for key in REFERENCES if key in used]


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
        f"{counted(subjects, 'participant')} ({', '.join(parts)}; {at_scan}) with cortet, {_METHOD}"
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
    limit = limit_of(certificates[0], "worst_q")
    certified = sum(content["certified"] for content in certificates)
    also = "" if any(content.get("relaxed") for content in certificates) else "and the position "
    values = sorted({f"{one:.3f}" for one in worst})
    sentences = [
        "Quality was measured as q = 1 - √2 · 6V / l³ (V volume, l root mean square edge length; 0 for a regular "
        f"tetrahedron, 1 for a flat one). Of {counted(len(certificates), 'mesh', 'meshes')}, {certified} "
        "had a worst q below "
        f"{limit:g}, positive volumes and a boundary with the topology {also}of the surface (certified); "
        f"the worst q was {' to '.join([values[0], *values[1:][-1:]])}."
    ]
    if relaxed := sorted({content["relaxed"] for content in certificates if content.get("relaxed")}):
        sentences.append(f"Limits were weaker than the defaults of cortet ({'; or '.join(relaxed)}).")
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
