"""Names of the files of an output folder, BIDS-derivative style.

A pattern is a name with Snakemake's wildcards: `folder` and `case` of the sheet, `res` (cell size in µm), `mesher`,
`setting` (empty for the line's own), `region` (`_inner-NAME` for an inner surface, else empty), `label` (of files for
solvers), `variant` (of a fold), `week` (of a folded cortex), `suffix`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.cohort.sheet import Case
from cortet.formats import FORMATS, Format
from cortet.formats.certificates import OF_SOLVERS, OF_UNCERTIFIED
from cortet.geometry.limits import NAME
from cortet.stages import MESH_STAGES

#: wildcards of a job, by their names
Wildcards = Mapping[str, str]
#: stage -> label of its result in the names of meshes
LABELS = {name: stage.label for name, stage in MESH_STAGES.items()}
#: labels of files for solvers: of a certified mesh, and of one that is not
LABELS_OUT = (OF_SOLVERS, OF_UNCERTIFIED)
#: labels of stages whose mesh is the same in every setting
SHARED = {stage.label for stage in MESH_STAGES.values() if stage.shared_by_settings}


def exported_suffix(form: Format) -> str:
    """End of the name of an exported file; the stages' own files end in tetmesh.vtu."""
    return f"{'boundary' if form.is_surface else 'sets' if form.name == 'vtu' else 'tetmesh'}{form.suffix}"


#: end of the name of an exported file -> its format
EXPORTED = {exported_suffix(form): name for name, form in FORMATS.items()}

#: begin of the wildcard `region` of an inner surface
_INNER = "_inner-"

#: what each wildcard matches, except for wildcards that depend on the configuration
WILDCARDS = {
    "folder": r"sub-[A-Za-z0-9]+(/ses-[A-Za-z0-9]+)?",
    "case": r"sub-[A-Za-z0-9]+(_ses-[A-Za-z0-9]+)?(_hemi-[LR])?",
    "res": r"[1-9][0-9]*",
    "region": f"({_INNER}{NAME})?",
    "mesher": r"[a-z0-9]+",
    "label": "|".join(LABELS_OUT),
}


@dataclass(frozen=True)
class Layout:
    """Patterns of the files below an output folder."""

    output: str

    def bids(self, suffix: str, datatype: str, *, whose: str = "{case}", **entities: str) -> str:
        """Pattern of a file of a case: OUT/{folder}/DATATYPE/WHOSE_KEY-VALUE..._SUFFIX."""
        name = "_".join([whose, *(f"{key}-{value}" for key, value in entities.items()), suffix])
        return f"{self.output}/{{folder}}/{datatype}/{name}"

    def surface(self, desc: str, suffix: str = "white.surf.gii") -> str:
        """Pattern of a file of the surface of a case."""
        return self.bids(suffix, "anat", desc=desc)

    def each_surface(self, desc: str, suffix: str = "white.surf.gii") -> str:
        """Pattern of a file of any surface of a case; that of an inner surface names the region inside it."""
        return self.bids(suffix, "anat", whose="{case}{region}", desc=desc)

    def mesh(self, desc: str, suffix: str = "tetmesh.vtu") -> str:
        """Pattern of a file of a stage's mesh: its name tells mesher, setting where it matters, and stage."""
        setting = "" if desc in SHARED else "{setting}"
        return self.bids(suffix, "mesh", res="{res}um", desc=f"{{mesher}}{setting}{desc}")

    def cohort(self, name: str) -> str:
        """A file over all cases."""
        return f"{self.output}/cohort/{name}"

    @property
    def certificate(self) -> str:
        """Pattern of the certificate of a mesh."""
        return self.mesh("Solver", "certificate.json")

    @property
    def case_page(self) -> str:
        """Pattern of the page of a mesh."""
        return self.mesh("Solver", "report.html")

    @property
    def thumbnail(self) -> str:
        """Pattern of the small picture of a mesh that the page of all cases shows."""
        return self.mesh("Solver", "thumbnail.webp")

    @property
    def cohort_page(self) -> str:
        """The page of all cases."""
        return self.cohort("index.html")

    def separated(self, suffix: str = "white.surf.gii") -> str:
        """Pattern of a file of an inner surface as S1 meshes it: it depends on the cell size."""
        return self.bids(suffix, "anat", whose="{case}_res-{res}um{region}", desc="separated")

    def solver_files(self, formats: Iterable[str], ten_nodes: Iterable[str] = (), label: str = "{label}") -> list[str]:
        """Patterns of the files for solvers, with elements of four nodes and of ten; `label` is one of `LABELS_OUT`."""
        files = [self.mesh(label, suffix) for suffix, name in EXPORTED.items() if name in formats]
        return [*files, *self.ten_node_files(ten_nodes, label)]

    def ten_node_files(self, formats: Iterable[str], label: str = "{label}") -> list[str]:
        """Patterns of the files for solvers with elements of ten nodes, and of the file of their numbers, if any."""
        files = [self.mesh(label, f"tennodes{FORMATS[name].suffix}") for name in formats]
        return [*files, self.mesh(label, "tennodes.quadratic.json")] if files else []

    def log(self, rule: str, wildcards: Iterable[str], *, kind: str = "log") -> str:
        """Pattern of the log of a job, or with kind `tsv` its benchmark (seconds and memory).

        Parameters
        ----------
        rule : name of the rule
        wildcards : wildcards in the names of its outputs
        """
        found = set(wildcards)
        name = "{folder}/{case}" if "case" in found else ""
        name += "{region}" if "region" in found else ""
        known = {
            "res": "res-{res}um",
            "mesher": f"desc-{{mesher}}{''.join(f'{{{key}}}' for key in ('setting', 'variant') if key in found)}",
            **{key: f"{key}-{{{key}}}" for key in ("reference", "week")},
            "label": "{label}",
            "suffix": "{suffix}",
        }
        parts = [name, *(text for key, text in known.items() if key in found)]
        folder = "benchmarks" if kind == "tsv" else "logs"
        tail = "_".join(part for part in parts if part)
        return f"{self.output}/{folder}/{rule}{f'/{tail}' if tail else ''}.{kind}"


def file_of(pattern: str, case: Case, res: int, mesher: str, setting: str = "", variant: str = "") -> str:
    """The file of a pattern for one mesh."""
    names = {"folder": case.folder, "case": case.name, "setting": setting, "variant": variant}
    return pattern.format(res=res, mesher=mesher, **names)


def filled(pattern: str, wildcards: Mapping[str, Any], **more: str) -> str:
    """The file of a pattern for the wildcards of a job."""
    return pattern.format(**{"setting": "", "region": "", **wildcards, **more})


def region_wildcard(inner: str) -> str:
    """The wildcard `region` of a job on an inner surface."""
    return _INNER + inner


def inner_of(wildcards: Mapping[str, Any]) -> str:
    """The inner surface that a job is about, by its region; empty for a job on the surface of the case."""
    return str(wildcards.get("region", "")).removeprefix(_INNER)


def beside(path: str | Path, page: str | Path) -> str:
    """Address of a file as seen from a page."""
    return Path(os.path.relpath(path, Path(page).parent)).as_posix()
