"""`logs/CITATION.{md,bib}`: the methods paragraph with references, for a paper, like that of fMRIPrep.

The Markdown cites by keys of the BibTeX file, which Pandoc resolves: `pandoc --citeproc --bibliography CITATION.bib`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.formats.atomic import atomic_path
from cortet.report import DATA
from cortet.version import __version__

VERSION: int = 3

#: key -> BibTeX entry, in the order of the list; the key of a program is its name in the versions of a certificate
REFERENCES = {
    found[1]: found[0].replace("VERSION", __version__)
    for found in re.finditer(
        r"@\w+\{(\w+),\n.*?\n\}\n",
        (DATA / "references.bib").read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
}
#: before the references, at the end of the paragraph
CLOSING = "The method and the software are described in"
#: name of a mesher in S1 -> key of its program
_MESHERS = {"pygalmesh": "cgal", "lattice": "tetgen"}
#: stage -> the program that does its work
_PROGRAMS = {"relocate": "gmsh", "smooth_surface": "pymeshlab", "resample": "workbench"}
#: libraries that every stage uses
_LIBRARIES = ("numpy", "scipy", "numba")


def cited(certificates: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys of the programs that a run used, from the reports of its stages: not every installed program was used."""
    reports = [content["reports"] for content in certificates]
    backends = {report["generate"].get("backend", "") for report in reports if "generate" in report}
    used = {"cortet", "cortetsoftware", *_LIBRARIES, *(_MESHERS.get(name, name) for name in backends)}
    worked = [{name: one for name, one in stages.items() if one.get("chosen_iterations", True)} for stages in reports]
    used |= {program for stage, program in _PROGRAMS.items() if any(stage in stages for stages in worked)}
    if any(stages.get("smooth_surface", {}).get("method") == "taubin" for stages in worked):
        used.add("taubin")
    return [key for key in REFERENCES if key in used]


def write_citation(methods: str, certificates: Sequence[Mapping[str, Any]], markdown: str, bibtex: str) -> None:
    """Write both files.

    Parameters
    ----------
    methods : the paragraph
    certificates : contents of the certificates that the paragraph is about
    """
    keys = cited(certificates)
    texts = {
        markdown: f"{methods.strip()} {CLOSING} [{'; '.join(f'@{key}' for key in keys)}].\n\n### References\n",
        bibtex: "\n".join(REFERENCES[key] for key in keys),
    }
    for path, text in texts.items():
        with atomic_path(path) as temporary:
            Path(temporary).write_text(text, encoding="utf-8")


def reference(entry: str) -> str:
    """A reference as a reader sees it."""
    fields = dict(re.findall(r"^  (\w+) = \{(.*)\},$", entry, flags=re.MULTILINE))
    fields = {name: value.replace("{", "").replace("}", "") for name, value in fields.items()}
    where = [fields[name] for name in ("journal", "booktitle", "volume", "year", "note", "url") if name in fields]
    where += [f"arXiv:{fields['eprint']}"] if "eprint" in fields else []
    return f"{fields['author'].replace(' and ', '; ')}: {fields['title']}. {', '.join(where)}."
