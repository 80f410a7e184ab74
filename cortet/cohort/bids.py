"""What makes the output folder a BIDS derivative (https://bids-specification.readthedocs.io, derivatives)."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from cortet.cohort.lock import NAME as LOCK
from cortet.errors import InputError
from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.ownership import json_of
from cortet.formats.tsv import write_tsv
from cortet.version import __version__

if TYPE_CHECKING:
    from cortet.config import Config

BIDS_VERSION = "1.11.0"
PAPER = "https://doi.org/10.48550/arXiv.2607.12157"
DESCRIPTION = "dataset_description.json"
#: files for which the specification has no names: tetrahedral meshes and their records, tables over all cases
IGNORED = (
    "*_tetmesh.*",
    "*_quality.json",
    "*_certificate.json",
    "*_report.html",
    "*_thumbnail.webp",
    "*_white.json",
    "*.surf.gii",
    "mesh",
    "outdated",
    "cohort",
    "simulation",
    "logs",
    "benchmarks",
    "work",
)
#: keys of a sidecar besides the report of the stage: origin of the file, what it was made from, and two keys of BIDS
ABOUT = ("origin", "input_sha256", "made_from", "Sources", "SpatialReference")
#: `desc` of surfaces that are not the result of a stage
_SURFACES = {
    "phantom": "Synthetic cortex of the age of the case, or its sphere",
    "fields": "Surface after the gate, with the per-vertex fields of the case",
}

_README = """\
# Meshes by cortet

| | |
|---|---|
| `cohort/index.html` | all cases on one page, failures first; begin here (made by the group level, or by `snakemake`) |
| `cohort/*.tsv` | tables over all cases; the `.json` next to each explains its columns |
| `sub-*/**/mesh/*Solver_sets.vtu` | the mesh of each case, with its regions and named sets, for ParaView and PyVista |
| `sub-*/**/mesh/*Solver_tetmesh.*` | the same mesh for the other solvers that were requested |
| `sub-*/**/mesh/*Solver_certificate.json` | the verdict on each mesh, and every number with its limit |
| `sub-*/**/mesh/*Solver_report.html` | the page of one mesh: pictures, its numbers, the boundary in 3D |
| `sub-*/**/anat/` | surfaces after each stage |
| `sub-*/**/simulation/` | folds, if requested |
| `logs/`, `benchmarks/` | logs of all jobs, and their time and memory |
| `descriptions.tsv` | what each `desc-...` of a file name means |

Lengths are in mm. Other files under `mesh` are intermediate: a later run continues from them.

Which file do I open? The result of a case is its `*Solver_sets.vtu`.
"""


@dataclass(frozen=True)
class Places:
    """Roots of the BIDS URIs of a run."""

    #: folder of everything that is made: `bids::`
    output: Path
    #: the dataset that is meshed, or the folder of the cohort sheet: `bids:raw:`
    raw: Path

    def uri(self, file: str | Path) -> str:
        """BIDS URI of a file."""
        path = _absolute(file)
        name, root = self.dataset(path)
        return f"bids:{name}:{quote(path.relative_to(root).as_posix())}"

    def dataset(self, file: Path) -> tuple[str, Path]:
        """Name and root of the dataset that a file belongs to.

        A file below neither of the two belongs to the nearest folder above it that describes itself as a dataset, else
        to its own folder. The name is that of the folder with a hash of its path, since folders may share a name.
        """
        for name, place in (("", self.output), ("raw", self.raw)):
            if file.is_relative_to(root := _absolute(place)):
                return name, root
        folder = next((folder for folder in file.parents if (folder / DESCRIPTION).is_file()), file.parent)
        word = "".join(filter(str.isalnum, folder.name)) or "source"
        return f"{word}{hashlib.sha256(os.fsencode(folder)).hexdigest()[:4]}", folder

    def links(self, files: Iterable[str | Path]) -> dict[str, str]:
        """Names of the datasets that files come from -> their paths relative to the output folder."""
        roots = dict(sorted(self.dataset(_absolute(file)) for file in files))
        output = _absolute(self.output)
        return {name: Path(os.path.relpath(root, output)).as_posix() for name, root in roots.items() if name}


def provenance(sources: Iterable[str | Path], reference: str | Path | None, places: Places) -> dict[str, object]:
    """`Sources` and `SpatialReference` of a sidecar.

    Parameters
    ----------
    sources : files that the file was made from
    reference : surface in whose space the file is
    """
    uris = dict.fromkeys(map(places.uri, sources))
    return {"Sources": list(uris)} | ({} if reference is None else {"SpatialReference": places.uri(reference)})


def describe(output: Path, links: Mapping[str, str], meanings: Mapping[str, str]) -> None:
    """Write what a folder of derivatives is: its description, what BIDS should ignore, and what its names mean.

    Parameters
    ----------
    links : from `Places.links`, relative to the folder, so that all can be moved together
    meanings : from `descriptions`
    """
    named = {name: quote(place) for name, place in links.items()}
    sources = [{"URL": named[name], **_citable(output / place)} for name, place in links.items()]
    write_json(
        {
            "Name": "cortet: certified tetrahedral meshes of cortical surfaces",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "derivative",
            "GeneratedBy": [{"Name": "cortet", "Version": __version__}],
            **({"SourceDatasets": sources, "DatasetLinks": named} if links else {}),
            "ReferencesAndLinks": [PAPER],
        },
        output / DESCRIPTION,
    )
    with atomic_path(output / ".bidsignore") as temporary:
        temporary.write_text("".join(f"{pattern}\n" for pattern in IGNORED), encoding="utf-8")
    rows = [{"desc_id": f"desc-{label}", "description": text} for label, text in meanings.items()]
    write_tsv(rows, ["desc_id", "description"], output / "descriptions.tsv")
    if not (readme := output / "README.md").exists():  # its owner may have changed it
        with atomic_path(readme) as temporary:
            temporary.write_text(_README, encoding="utf-8")


def require_own_output(output: Path, dataset: Path | None) -> None:
    """Raise InputError if results would be written over files that cortet did not write.

    Parameters
    ----------
    output : folder of everything that is made
    dataset : root of the dataset that is meshed; None if it is not known
    """
    remedy = "name an empty or a new folder, e.g. DATASET/derivatives/cortet"
    if {"{", "}"} & set(str(output.absolute())):
        raise InputError("has braces in its name, which Snakemake reads as wildcards", file=output, remedy=remedy)
    if dataset is not None and dataset.resolve().is_relative_to(output.resolve()):
        what = "is or contains the dataset that cortet reads; cortet never writes there"
        raise InputError(what, file=output, remedy=remedy)
    if not output.is_dir():
        return
    if not os.access(output, os.R_OK | os.W_OK | os.X_OK):
        what = "is not readable and writable: no permission, or a read-only file system"
        raise InputError(what, file=output, remedy="correct its permissions, or name another folder")
    if (output / DESCRIPTION).exists():
        if not is_own_output(output):
            what = "was not written by cortet: the folder is another dataset"
            raise InputError(what, file=output / DESCRIPTION, remedy=remedy)
    elif any(output.iterdir()) and not (output / LOCK).exists():  # a run that was killed has left its lock
        raise InputError("holds files that cortet did not make", file=output, remedy=remedy)


def is_own_output(output: Path) -> bool:
    """Whether a folder has the record of a run, or a description that says that cortet generated it."""
    if (output / ".cortet" / "run.json").is_file():
        return True
    try:
        generated = json_of(output / DESCRIPTION)["GeneratedBy"]
        return any(one["Name"] == "cortet" for one in generated)
    except (LookupError, TypeError):
        return False


def _absolute(file: str | Path) -> Path:
    """The absolute path of a file; links stay, as a dataset may consist of links."""
    return Path(os.path.normpath(Path(file).absolute()))


def _citable(root: Path) -> dict[str, str]:
    """DOI of a dataset, if its description has one."""
    doi = json_of(root / DESCRIPTION).get("DatasetDOI")
    return {"DOI": doi} if isinstance(doi, str) and doi else {}


def descriptions(settings: Mapping[str, Config]) -> dict[str, str]:
    """Meaning of each value of `desc` in file names, for all files that a configuration can make.

    Parameters
    ----------
    settings : configuration of each setting, by its addition to file names; the line's own adds nothing
    """
    from cortet.stages import MESH_STAGES, STAGES  # takes long to load, and most jobs write sidecars only

    found = dict(_SURFACES)
    found |= {stage.label: _sentence(stage.does) for stage in STAGES.values() if stage.gives == "surface"}
    own = settings[""]
    meshers = dict.fromkeys([*own.generate.meshers, *own.experiments.ablation.meshers])
    for (name, setting), mesher, stage in product(settings.items(), meshers, MESH_STAGES.values()):
        apart = "" if stage.shared_by_settings else name
        how = f"mesher {mesher}" + (f", setting {setting.setting}" if apart else "")
        if setting.enabled(stage.name):
            found[f"{mesher}{apart}{stage.label}"] = f"{_sentence(stage.does)} ({how})"
        if stage.name == "solver_ready":
            found[f"{mesher}{apart}Solver"] = f"The certified mesh, with its certificate and its page ({how})"
            if own.export.uncertified:
                found[f"{mesher}{apart}Uncertified"] = f"A mesh that is not certified, for solvers ({how})"
    return found


def _sentence(does: str) -> str:
    return f"Result of the stage that {does}"
