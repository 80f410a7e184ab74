"""Cohorts: `cohort scan`, `cohort report`, `run`, `workflow`; and `config`, `doctor`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import chdir, nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Group, Parameter
from cyclopts.validators import mutually_exclusive

from cortet.cli.shared import COHORTS, OTHERS, Common, Configured, add, with_keys
from cortet.cli.values import CheckedOutput, Formats, Hemisphere, InputFile, O, Setting, number
from cortet.errors import InputError, counted

#: what becomes of a sheet that is there
_EXISTING = Group("Existing sheet", validator=mutually_exclusive)
Labels = Annotated[Sequence[str], Parameter(consume_multiple=(1, None), metavar="LABEL")]


def add_commands(app: App) -> None:
    """Add the commands on cohorts, and those that are used before them."""
    cohort = App(name="cohort", help="Work on cohort sheets.", group=COHORTS)
    add(cohort, COHORTS, scan, report)
    app.command(cohort)
    add(app, COHORTS, run, workflow)
    add(app, OTHERS, config, doctor)


def scan(
    folder: Annotated[Path, Parameter(name="DIR")],
    /,
    *,
    output: Annotated[CheckedOutput, O, Parameter(metavar="TSV")],
    config: InputFile | None = None,
    pial: bool = False,
    update: Annotated[bool, Parameter(group=_EXISTING)] = False,
    force: Annotated[bool, Parameter(group=_EXISTING)] = False,
    _: Common = Common(),
) -> int:
    """Make a cohort sheet of a data release.

    Parameters
    ----------
    config
        YAML file whose section cohort.scan has the patterns of the surfaces.
    pial
        Mesh two regions: the pial surface with the white surface inside.
    update
        Add new cases to an existing sheet and keep its rows.
    force
        Replace an existing sheet.

    Examples
    --------
    cortet cohort scan release -o cohort.tsv
    """
    from cortet.cohort.scan import scan
    from cortet.cohort.selection import ageless_notice
    from cortet.cohort.sheet import add_to_sheet, read_header, write_sheet
    from cortet.config import Scan, load

    if not folder.is_dir():
        raise InputError("no such folder", file=folder, remedy="name the root of the data release")
    exists = output.exists()
    if exists and not (update or force):
        raise InputError(
            "already exists, and you may have edited it",
            file=output,
            remedy="add --update to append new cases to it, --force to replace it, or give another name",
        )
    if exists:
        read_header(output)  # another table is never replaced, even with --force
    patterns = load(config).cohort.scan if config else Scan()
    cases = scan(folder, patterns.model_copy(update={"pial": True}) if pial else patterns, print)
    if exists and update:
        found, cases = len(cases), add_to_sheet(cases, output)
        print(f"{output}: {counted(found, 'surface')}, {len(cases)} new and added")
    else:
        write_sheet(cases, output)
        print(f"{output}: {counted(len(cases), 'surface')}")
    for notice in ageless_notice(cases, smoothed=False, folded=True):
        print(f"  {notice}")
    return 0


def report(
    output_dir: CheckedOutput, /, *, after: Literal["success", "failure"] | None = None, _: Common = Common()
) -> int:
    """Make tables, figures and pages from the results in an output folder.

    Parameters
    ----------
    output_dir
        Output folder of a run.
    after
        How the run ended that calls this command; makes only what the run leaves to make.

    Examples
    --------
    cortet cohort report derivatives/cortet
    """
    from cortet.cohort.lock import hold
    from cortet.over_all import report

    folder = output_dir.absolute()
    if not folder.is_dir():
        raise InputError("no such folder", file=output_dir, remedy="name the output folder of a run")
    with nullcontext() if after else hold(folder):  # a run that ends has the lock
        for path in report(folder, after=after):
            print(os.path.relpath(path))
    return 0


def run(
    bids_dir: Path,
    output_dir: CheckedOutput,
    levels: Annotated[Sequence[Literal["participant", "group"]], Parameter(name="LEVEL")] = (),
    /,
    *,
    participant_label: Annotated[Labels, Parameter(alias="--participant_label")] = (),
    session_label: Annotated[Labels, Parameter(alias="--session_label")] = (),
    hemi: Hemisphere | None = None,
    configured: Configured = Configured(),
    pial: bool = False,
    formats: Formats = (),
    fold: bool = False,
    cores: Annotated[int | None, number(1, 10_000, "N", whole=True)] = None,
    profile: Annotated[str | None, Parameter(metavar="NAME")] = None,
    dry_run: Annotated[bool, Parameter(alias="-n")] = False,
    work_dir: Annotated[CheckedOutput | None, Parameter(alias="-w", metavar="DIR")] = None,
    common: Common = Common(),
) -> int:
    """Mesh the surfaces of a BIDS dataset (a BIDS App).

    Parameters
    ----------
    bids_dir
        BIDS dataset, or its derivatives, with surfaces.
    output_dir
        Output folder of the derivatives.
    levels
        participant: single cases; group: tables and figures over all cases (default: both).
    participant_label
        Only these participants.
    session_label
        Only these sessions.
    hemi
        Only this hemisphere.
    pial
        Mesh two regions: the pial surface with the white surface inside.
    fold
        Also fold every case of known age; takes hours per case if cells are small.
    cores
        Number of cores (default: all).
    profile
        Snakemake profile: slurm, or a folder.
    dry_run
        List the cases and the jobs of each, and exit.
    work_dir
        Folder for cohort sheet, configuration and Snakemake's records.

    Examples
    --------
    cortet run bids derivatives/cortet --participant-label 01 02 --formats vtu,inp
    """
    from cortet.cohort import app
    from cortet.cohort.bids import require_own_output
    from cortet.cohort.lock import hold
    from cortet.cohort.states import read_states
    from cortet.config import read
    from cortet.over_all import OF_COHORT, plan_of, remember_run, report, run_record

    asked: Sequence[str] = levels or list(app.LEVELS)
    settings, alone = configured.settings(), set(asked) == {"group"}
    if configured.cell_size:
        settings = with_keys(settings, "generate", cell_size=configured.cell_size)
    if alone:  # meshes are of the sizes, and so on, that the participants were run with
        settings = run_record(output_dir).get("config", {}) | settings
    selection = app.Selection(participant_label, session_label, hemi)
    if pial:
        settings = with_keys(settings, "cohort", **with_keys(settings.get("cohort") or {}, "scan", pial=True))
    if formats:
        settings = with_keys(settings, "export", formats=formats)
    if fold:
        settings = with_keys(settings, "fold", cases="all")
    cases = app.find(bids_dir, selection, settings, print)
    print(f"{counted(len(cases), 'surface')} of {bids_dir}", flush=True)
    for case in cases if dry_run else ():
        age = "age unknown" if case.scan_age is None else f"{case.scan_age:g} weeks"
        print(f"  {case.name}  {age}  {case.surface}", flush=True)
    work, output = (work_dir or app.work_folder(output_dir)).absolute(), output_dir.absolute()
    if profile == "slurm" and find_spec("snakemake_executor_plugin_slurm") is None:
        raise InputError("--profile slurm needs Snakemake's plugin", remedy="run pip install 'cortet[slurm]'")
    if profile and Path(profile).is_dir():
        profile = str(Path(profile).absolute())
    require_own_output(output_dir, bids_dir)
    with hold(output_dir), app.unchanged(work, dry_run=dry_run):
        app.prepare(cases, bids_dir, output_dir, work, settings, selected=not selection.is_all)
        with chdir(work):  # names of files in its configuration are relative to it
            code, most, names = 0, cores or os.cpu_count() or 1, frozenset(case.name for case in cases)
            written = read(Path("config.yaml"))
            plan = plan_of(written)
            if not alone:
                targets, chosen = [app.LEVELS[level] for level in asked], None
                if not selection.is_all:
                    targets, chosen = [app.LEVELS["participant"]], sorted(names)
                verbose = common.verbose
                code = app.snakemake(
                    work, targets, cases=chosen, cores=most, profile=profile, dry_run=dry_run, verbose=verbose
                )
            if "group" in asked and (alone or not (selection.is_all or dry_run)):
                if not read_states(plan).measured():
                    what, remedy = "has no mesh of these cases yet", "run the participant level first"
                    raise InputError(what, file=output, remedy=remedy)
                if not dry_run:
                    remember_run(plan, written, {*run_record(output).get("asked", []), *OF_COHORT})
                    report(output)
            states = read_states(plan)
            found = states.worst(names)
            unfinished = [name for name, state in found.items() if state == "unfinished"]
            if alone and unfinished:
                print(f"no mesh yet: {', '.join(unfinished)} (run the participant level to make them)")
            if not dry_run:
                print(app.outcome(states, output_dir, page="group" in asked, names=names))
    return int(code != 0)


def workflow(folder: Annotated[CheckedOutput | None, Parameter(name="DIR")] = None, /, *, _: Common = Common()) -> int:
    """Print the path of the Snakefile, or prepare a folder for `snakemake`.

    Parameters
    ----------
    folder
        New or empty folder for a Snakefile, a short config.yaml and profiles.

    Examples
    --------
    cortet workflow study
    """
    from cortet.cohort import app

    if folder is None:
        print(app.workflow() / "Snakefile")
        return 0
    for file in app.write_workflow(folder):
        print(f"{file}: written")
    return 0


def config(*, setting: Setting = "default", _: Common = Common()) -> int:
    """Print every parameter with its unit and meaning.

    Parameters
    ----------
    setting
        Preset, as in `cortet run`.

    Examples
    --------
    cortet config --setting published
    """
    from cortet.config import render

    print(render({"setting": setting}), end="")
    return 0


def doctor(*, _: Common = Common()) -> int:
    """Check that all dependencies are installed and work.

    Examples
    --------
    cortet doctor
    """
    from cortet import doctor

    return doctor.run()
