"""The workflow as a BIDS App: `cortet run BIDS_DIR OUTPUT_DIR participant group` (https://bids-apps.neuroimaging.io).

It looks for surfaces in a BIDS dataset, writes the cohort sheet and the configuration of the run to a working folder,
and calls Snakemake there.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from cortet.cohort.bids import is_own_output
from cortet.cohort.layout import EXPORTED, LABELS_OUT
from cortet.cohort.scan import scan
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.cohort.states import States
from cortet.config import load, read
from cortet.errors import InputError
from cortet.formats import child
from cortet.formats.atomic import atomic_path
from cortet.formats.ownership import MARKER, mark

#: state of a case -> how a run counts it; the worst last
_IN_WORDS = {"certified": "certified", "uncertified": "not certified", "unfinished": "unfinished", "failed": "failed"}
#: level of analysis in a BIDS App -> target rule
LEVELS = {"participant": "participants", "group": "cohort"}
#: environment variable by which the workflow knows the cases that it is asked for
CHOSEN = "CORTET_CASES"
#: folder of Snakemake's own files, below the output folder
_WORK = "work"
_PACKAGE = Path(__file__).parents[1]

#: what `write_workflow` writes
_SNAKEFILE = '''"""The workflow of cortet. `snakemake --cores 2` makes everything that config.yaml asks for."""

from cortet.cohort.app import workflow as installed


# names of files in config.yaml are relative to this folder, from wherever snakemake is started
workdir: workflow.basedir


include: installed() / "Snakefile"


# an included file has no default target
rule everything:
    default_target: True
    input:
        rules.all.input,
    localrule: True
'''


@dataclass(frozen=True)
class Selection:
    """Which hemispheres of a dataset are meshed; empty: all."""

    #: with or without `sub-`
    participants: Sequence[str] = ()
    #: with or without `ses-`
    sessions: Sequence[str] = ()
    hemi: Literal["L", "R"] | None = None

    @property
    def is_all(self) -> bool:
        """Whether every hemisphere is meshed."""
        return not (self.participants or self.sessions or self.hemi)

    def of(self, cases: Sequence[Case], dataset: Path) -> list[Case]:
        """The cases that are selected."""
        asked: dict[str, set[str]] = {
            "participant": {name.removeprefix("sub-") for name in self.participants},
            "session": {name.removeprefix("ses-") for name in self.sessions},
            "hemi": {self.hemi} if self.hemi else set(),
        }
        for what in ("participant", "session"):
            there = sorted({label for case in cases if (label := getattr(case, what))})
            if unknown := sorted(asked[what] - {*there}):
                raise InputError(
                    f"no surfaces of {what} {', '.join(unknown)}",
                    file=dataset,
                    remedy=f"the dataset has {', '.join(there) or 'none'}",
                )
        found = [case for case in cases if all(not of or getattr(case, what) in of for what, of in asked.items())]
        if not found:
            remedy = "use fewer of --participant-label, --session-label and --hemi"
            raise InputError("no surface matches all the options", file=dataset, remedy=remedy)
        return found


def workflow() -> Path:
    """The folder of the Snakefile: inside the installed package, or the checkout that the package lies in."""
    for folder in (_PACKAGE / "workflow", _PACKAGE.parent):
        if (folder / "Snakefile").is_file():
            return folder
    raise InputError("no Snakefile in the package", file=_PACKAGE, remedy="install cortet from its wheel or a checkout")


def write_workflow(folder: Path) -> list[Path]:
    """Write into a new or empty folder what plain `snakemake` needs there, and return the files."""
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise InputError("is not empty", file=folder, remedy="name an empty or a new folder")
    profiles = (Path("profiles/default/config.yaml"), Path("profiles/slurm/config.yaml"))
    config = (workflow() / "config.yaml").read_text(encoding="utf-8")
    texts = {
        Path("Snakefile"): _SNAKEFILE,
        Path("config.yaml"): config.replace("sheet: demo/cohort.tsv", "sheet: cohort.tsv"),
        **{profile: (workflow() / profile).read_text(encoding="utf-8") for profile in profiles},
    }
    for file, text in texts.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(folder / file) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return [folder / file for file in texts]


def find(
    dataset: Path, selection: Selection, settings: Mapping[str, Any], say: Callable[[str], object] = lambda _: None
) -> list[Case]:
    """The selected cases of a dataset, including those of unknown age.

    Parameters
    ----------
    settings : sections of the configuration, as in its file
    say : called with remarks on where the ages come from
    """
    if not dataset.is_dir():
        raise InputError("no such folder", file=dataset, remedy="name the root of the dataset")
    scanning = load({"cohort": settings.get("cohort") or {}}).cohort.scan
    return selection.of(scan(dataset, scanning, say), dataset)


def prepare(
    cases: Sequence[Case],
    dataset: Path,
    output: Path,
    work: Path,
    settings: Mapping[str, Any],
    *,
    selected: bool = False,
) -> None:
    """Write the cohort sheet and the configuration of a run; the caller holds its lock.

    Parameters
    ----------
    selected : whether these are some of the cases of the dataset; the sheet then keeps the others that it has
    """
    sheet, file = work / "cohort.tsv", work / "config.yaml"
    cohort = dict(settings.get("cohort") or {})
    # relative to the working folder, so that what Snakemake remembers there holds after the output has moved
    data = {
        **settings,
        "cohort": {**cohort, "sheet": sheet.name, "dataset": str(dataset.resolve())},
        "output": os.path.relpath(output.resolve(), work.resolve()),
    }
    load(data)
    _claim(work, output, (sheet, file))
    if selected and sheet.is_file() and file.is_file():
        earlier = read(file).get("cohort", {}).get("dataset")
        known = read_sheet(sheet) if earlier == data["cohort"]["dataset"] else []
        cases = sorted({case.name: case for case in (*known, *cases)}.values(), key=lambda case: case.name)
    with atomic_path(file) as temporary:
        temporary.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    write_sheet(cases, sheet)


@contextmanager
def unchanged(work: Path, *, dry_run: bool) -> Iterator[None]:
    """After a dry run, put the sheet and the configuration of a working folder back as they were."""
    files = [work / "cohort.tsv", work / "config.yaml"]
    before = {file: file.read_bytes() if file.is_file() else None for file in files}
    try:
        yield
    finally:
        for file, content in before.items() if dry_run else ():
            if content is None:
                file.unlink(missing_ok=True)
            else:
                with atomic_path(file) as temporary:
                    temporary.write_bytes(content)


def _claim(work: Path, output: Path, files: Sequence[Path]) -> None:
    """Mark the working folder as cortet's; InputError if it would replace files that cortet did not write."""
    if not (work / MARKER).is_file():
        there = [file for file in files if os.path.lexists(file)]
        if there and not (work == work_folder(output) and is_own_output(output)):
            remedy = "name an empty or a new folder with --work-dir, or move the file"
            what = "would be overwritten, but was not written by `cortet run`"
            raise InputError(what, file=there[0], remedy=remedy)
        work.mkdir(parents=True, exist_ok=True)
        mark(work)


def snakemake(
    work: Path,
    targets: Iterable[str],
    *,
    cases: Iterable[str] | None = None,
    cores: int,
    profile: str | None = None,
    dry_run: bool = False,
    verbose: bool = False,
) -> int:
    """Run the workflow in its working folder and return Snakemake's exit code. This process holds the lock.

    Parameters
    ----------
    targets : rules or files
    cases : names of those that the rule `participants` makes; None: all
    profile : a profile of Snakemake, or the name of one that comes with the workflow, such as `slurm`
    verbose : everything that Snakemake says, instead of a line per case
    """
    from cortet.geometry.kernel_cache import cache_folder  # takes long to load

    folder = workflow()
    cache_folder()  # where there is none, this process says so, and its jobs know the temporary one
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(folder / "Snakefile"), "--cores", str(cores)]
    command += ["--directory", str(work)]
    command += ["--verbose"] if verbose else []
    command += ["--dry-run"] if dry_run else []
    if profile:
        own = folder / "profiles" / profile
        command += ["--profile", str(own if own.is_dir() else profile)]
    # Snakemake looks for its plugins on the path, and ours lies beside the package
    path = os.pathsep.join([str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    with subprocess.Popen(
        [*command, *targets],
        preexec_fn=child.end_with_parent,  # noqa: PLW1509, before any thread
        env=os.environ | {"PYTHONPATH": path} | ({CHOSEN: " ".join(cases)} if cases is not None else {}),
    ) as run:
        try:
            return run.wait()
        except KeyboardInterrupt:  # Snakemake had it, too, and leaves tables and pages of what is there
            run.wait()
            raise


def require_plain_python(python: str = sys.executable) -> None:
    """Raise InputError if Snakemake cannot start jobs by this path of Python, which it gives to a shell unquoted.

    See https://github.com/snakemake/snakemake/issues/2645: no job would run, and none would have a log.
    """
    if odd := re.search(r"[^\w@%+=:,./~-]", python):
        raise InputError(
            f"Snakemake cannot run jobs with a Python whose path has {odd[0]!r}",
            file=python,
            remedy="create the environment in a folder whose path has no blanks, quotes or parentheses",
        )


def outcome(states: States, output: Path, *, page: bool, names: Collection[str] | None = None) -> str:
    """What became of the cases of a run, as the table of states says it, and where to look.

    Parameters
    ----------
    output : its output folder, as the user named it
    page : whether the run made the page of the cohort
    names : of the cases that the run was asked for; None: all
    """
    plan = states.plan
    worst = states.worst(plan.cases if names is None else names)
    if not worst:
        return "the sheet includes no case"
    counts = Counter(worst.values())
    told = [f"{counts[state]} {word}" for state, word in _IN_WORDS.items() if counts[state]]
    verdicts = {mesh: state.verdict.get("verdict", "certified") for mesh, state in states.of.items()}
    said_more = {mesh[0] for mesh, verdict in verdicts.items() if verdict != "certified"}
    if qualified := sum(state == "certified" and name in said_more for name, state in worst.items()):
        told[0] += f" ({qualified} with repaired surfaces or relaxed limits)"
    words = ", ".join(told)
    look = f"open {output}/cohort/index.html; " if page and Path(plan.layout.cohort_page).is_file() else ""
    made = {path.name for mesh in states.measured() for path in plan.exports(mesh) if path.exists()}
    ends = [f"{label}_{end}" for label in LABELS_OUT for end in EXPORTED]
    files = " ".join(f"*{end}" for end in ends if any(name.endswith(end) for name in made))
    meshes = f"meshes: {output}/sub-*/**/mesh/{files}" if files else "no mesh"
    return f"{len(worst)} {'case' if len(worst) == 1 else 'cases'}: {words}; {look}{meshes}"


def work_folder(output: Path) -> Path:
    """The default folder of a run's sheet, its configuration and Snakemake's own files."""
    return output / _WORK
