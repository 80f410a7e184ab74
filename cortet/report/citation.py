"""`logs/CITATION.{md,bib,tex,html}`: the methods paragraph with references, for a paper, as fMRIPrep leaves it.

The Markdown cites by keys of the BibTeX file, as Pandoc reads it: `pandoc --citeproc --bibliography CITATION.bib`.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cortet
from cortet.formats.atomic import atomic_path

VERSION: int = 2

#: key -> type and fields of the BibTeX entry; of programs by the names that certificates give their versions
REFERENCES: dict[str, tuple[str, dict[str, str]]] = {
    "cortet": (
        "misc",
        {"author": "{The authors of CORTET}", "title": "CORTET", "eprint": "2607.12157", "archiveprefix": "arXiv"},
    ),
    "cortetsoftware": (
        "misc",
        {
            "author": "{The cortet authors}",
            "title": "cortet: from cortical surfaces to certified tetrahedral simulation meshes",
            "note": f"version {cortet.__version__}",
        },
    ),
    "workbench": (
        "article",
        {
            "author": "Glasser, M. F. and Sotiropoulos, S. N. and Wilson, J. A. and others",
            "title": "The minimal preprocessing pipelines for the {Human Connectome Project}",
            "journal": "NeuroImage",
            "volume": "80",
            "year": "2013",
        },
    ),
    "taubin": (
        "inproceedings",
        {
            "author": "Taubin, G.",
            "title": "A signal processing approach to fair surface design",
            "booktitle": "Proceedings of SIGGRAPH",
            "year": "1995",
        },
    ),
    "tetgen": (
        "article",
        {
            "author": "Si, H.",
            "title": "{TetGen}, a {Delaunay}-based quality tetrahedral mesh generator",
            "journal": "ACM Transactions on Mathematical Software",
            "volume": "41",
            "number": "2",
            "year": "2015",
        },
    ),
    "cgal": (
        "manual",
        {"author": "{The CGAL Project}", "title": "{CGAL} User and Reference Manual", "url": "https://doc.cgal.org"},
    ),
    "gmsh": (
        "article",
        {
            "author": "Geuzaine, C. and Remacle, J.-F.",
            "title": "{Gmsh}: A 3-D finite element mesh generator with built-in pre- and post-processing facilities",
            "journal": "International Journal for Numerical Methods in Engineering",
            "volume": "79",
            "number": "11",
            "year": "2009",
        },
    ),
    "pymeshlab": (
        "inproceedings",
        {
            "author": "Cignoni, P. and Callieri, M. and Corsini, M. and others",
            "title": "{MeshLab}: an open-source mesh processing tool",
            "booktitle": "Eurographics Italian Chapter Conference",
            "year": "2008",
        },
    ),
    "numpy": (
        "article",
        {
            "author": "Harris, C. R. and Millman, K. J. and van der Walt, S. J. and others",
            "title": "Array programming with {NumPy}",
            "journal": "Nature",
            "volume": "585",
            "year": "2020",
        },
    ),
    "scipy": (
        "article",
        {
            "author": "Virtanen, P. and Gommers, R. and Oliphant, T. E. and others",
            "title": "{SciPy} 1.0: fundamental algorithms for scientific computing in {Python}",
            "journal": "Nature Methods",
            "volume": "17",
            "year": "2020",
        },
    ),
    "numba": (
        "inproceedings",
        {
            "author": "Lam, S. K. and Pitrou, A. and Seibert, S.",
            "title": "{Numba}: a {LLVM}-based {Python} {JIT} compiler",
            "booktitle": "Second Workshop on the LLVM Compiler Infrastructure in HPC",
            "year": "2015",
        },
    ),
}
#: programs by what S1 calls them
_MESHERS = {"pygalmesh": "cgal", "lattice": "tetgen"}
#: stage -> the program that does its work
_PROGRAMS = {"relocate": "gmsh", "smooth_surface": "pymeshlab", "resample": "workbench"}
#: libraries of every stage
_LIBRARIES = ("numpy", "scipy", "numba")
#: what LaTeX does not print as it stands
_LATEX = {
    "\\": r"\textbackslash{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "√": r"$\surd$",
    "·": r"$\cdot$",
    "³": r"\textsuperscript{3}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def cited(certificates: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys of what a run used, by the reports of its stages: an installed program is not a program that was used."""
    reports = [content["reports"] for content in certificates]
    backends = {report["generate"].get("backend", "") for report in reports if "generate" in report}
    used = {"cortet", "cortetsoftware", *_LIBRARIES, *(_MESHERS.get(name, name) for name in backends)}
    worked = [{name: one for name, one in stages.items() if one.get("chosen_iterations", True)} for stages in reports]
    used |= {program for stage, program in _PROGRAMS.items() if any(stage in stages for stages in worked)}
    if any(stages.get("smooth_surface", {}).get("method") == "taubin" for stages in worked):
        used.add("taubin")
    return [key for key in REFERENCES if key in used]


def write_citation(
    methods: str, certificates: Sequence[Mapping[str, Any]], markdown: str, bibtex: str, latex: str, page: str
) -> None:
    """Write the four files.

    Parameters
    ----------
    methods : the paragraph
    certificates : contents of the certificates that it is about
    """
    keys, paragraph = cited(certificates), methods.strip()
    closing = "The method and the software are described in"
    links = ", ".join(f'<a href="#{key}">{number}</a>' for number, key in enumerate(keys, start=1))
    texts = {
        markdown: f"{paragraph} {closing} [{'; '.join(f'@{key}' for key in keys)}].\n\n### References\n",
        bibtex: "\n".join(_entry(key) for key in keys),
        latex: "\n".join(
            [
                r"\documentclass{article}",
                r"\begin{document}",
                f"{_escaped(paragraph)} {closing} \\cite{{{','.join(keys)}}}.",
                r"\bibliographystyle{unsrt}",
                r"\bibliography{CITATION}",
                r"\end{document}",
                "",
            ]
        ),
        page: "\n".join(
            [
                "<!doctype html><html lang=en><meta charset=utf-8><title>Citation</title>",
                f"<p>{html.escape(paragraph)} {closing} [{links}].</p>",
                "<ol>",
                *(f'<li id="{key}">{html.escape(_in_words(key))}</li>' for key in keys),
                "</ol></html>",
                "",
            ]
        ),
    }
    for path, text in texts.items():
        with atomic_path(path) as temporary:
            Path(temporary).write_text(text, encoding="utf-8")


def _entry(key: str) -> str:
    kind, fields = REFERENCES[key]
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@{kind}{{{key},", *lines, "}", ""])


def _in_words(key: str) -> str:
    """A reference as a reader sees it."""
    fields = {name: value.replace("{", "").replace("}", "") for name, value in REFERENCES[key][1].items()}
    where = [fields[name] for name in ("journal", "booktitle", "volume", "year", "note", "url") if name in fields]
    where += [f"arXiv:{fields['eprint']}"] if "eprint" in fields else []
    return f"{fields['author'].replace(' and ', '; ')}: {fields['title']}. {', '.join(where)}."


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in text)
