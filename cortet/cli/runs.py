"""Cohorts: `cohort scan`, `cohort report`, `run`; and `config`, `doctor`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cli.given import settings_of
from cortet.cli.shared import common
from cortet.cli.values import CheckedOutput, Number
from cortet.errors import InputError
from cortet.geometry.limits import CELL_SIZE_MM


def add_commands(commands: Commands) -> None:
    """Add the commands on cohorts, and those that are used before them."""
    cohort = commands.add_parser("cohort", help="work on cohort sheets").add_subparsers(
        required=True, metavar="COMMAND"
    )
    scan = cohort.add_parser("scan", parents=[common()], help="make a cohort sheet of a data release")
    scan.add_argument("folder", type=Path, metavar="DIR")
    scan.add_argument("-o", "--output", type=CheckedOutput, required=True, metavar="TSV")
    scan.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose cohort.scan says where surfaces are")
    scan.add_argument("--pial", action="store_true", help="two regions: the pial surface, and the white one inside")
    existing = scan.add_mutually_exclusive_group()
    existing.add_argument("--update", action="store_true", help="add new cases to an existing sheet, keep its rows")
    existing.add_argument("--force", action="store_true", help="replace an existing sheet")
    scan.set_defaults(run=scan_command)

    report = cohort.add_parser(
        "report", parents=[common()], help="make the tables, figures and pages over all cases of what is there"
    )
    report.add_argument("folder", type=CheckedOutput, metavar="OUTPUT_DIR", help="output folder of a run")
    report.add_argument(
        "--after", choices=["success", "failure"], help="how a run ended: makes only what it leaves to be made"
    )
    report.set_defaults(run=report_command)

    run = commands.add_parser("run", parents=[common()], help="mesh the surfaces of a BIDS dataset (a BIDS App)")
    run.add_argument("bids_dir", type=Path, metavar="BIDS_DIR", help="dataset, or derivatives of one, with surfaces")
    run.add_argument("output_dir", type=CheckedOutput, metavar="OUTPUT_DIR", help="where the derivatives go")
    run.add_argument(
        "level",
        choices=["participant", "group"],
        metavar="{participant,group}",
        help="single cases, or tables and figures over all",
    )
    for words, name, of in (
        (("--participant-label", "--participant_label"), "participants", "participants"),
        (("--session-label", "--session_label"), "sessions", "sessions"),
    ):
        run.add_argument(*words, dest=name, nargs="+", default=[], metavar="LABEL", help=f"only these {of}")
    run.add_argument("--hemi", choices=["L", "R"], help="only this hemisphere")
    run.add_argument(
        "--cell-size",
        type=Number(*CELL_SIZE_MM),
        metavar="MM",
        help="cell size h (default: 0.6, or what --config says)",
    )
    run.add_argument("--setting", choices=["default", "cgal", "published"], help="as of `cortet mesh`")
    run.add_argument("--config", type=Path, metavar="FILE", help="YAML file of parameters; see `cortet config`")
    run.add_argument("--pial", action="store_true", help="two regions: the pial surface, and the white one inside")
    run.add_argument("--cores", type=Number(1, 10_000, whole=True), metavar="N", help="default: all")
    run.add_argument("--profile", metavar="NAME", help="profile of Snakemake: slurm, or a folder")
    run.add_argument("-n", "--dry-run", action="store_true", help="say what would be done")
    run.add_argument(
        "-w",
        "--work-dir",
        type=CheckedOutput,
        metavar="DIR",
        help="cohort sheet, configuration and what Snakemake remembers",
    )
    run.set_defaults(run=run_command)

    settings = commands.add_parser(
        "config", parents=[common()], help="print every parameter, with its unit and meaning"
    )
    settings.add_argument("--setting", choices=["default", "cgal", "published"], default="default", help="as of `run`")
    settings.set_defaults(run=config_command)

    doctor = commands.add_parser(
        "doctor", parents=[common()], help="prove that everything needed is installed and works"
    )
    doctor.set_defaults(run=doctor_command)


if TYPE_CHECKING:
    from cortet.cli.shared import Commands


def scan_command(args: argparse.Namespace) -> int:
    """Write the cohort sheet of a data release."""
    from cortet.cohort.scan import scan
    from cortet.cohort.selection import ageless_notice
    from cortet.cohort.sheet import add_to_sheet, read_header, write_sheet
    from cortet.config import Scan, load

    if not args.folder.is_dir():
        raise InputError("no such folder", file=args.folder, remedy="name the root of the data release")
    exists = args.output.exists()
    if exists and not (args.update or args.force):
        raise InputError(
            "exists already, and may have been edited",
            file=args.output,
            remedy="add --update to append new cases to it, --force to replace it, or give another name",
        )
    if exists:
        read_header(args.output)  # another table is never replaced, even with --force
    patterns = load(args.config).cohort.scan if args.config else Scan()
    cases = scan(args.folder, patterns.model_copy(update={"pial": True}) if args.pial else patterns, print)
    if exists and args.update:
        found, cases = len(cases), add_to_sheet(cases, args.output)
        print(f"{args.output}: {found} surfaces, {len(cases)} of them new and added")
    else:
        write_sheet(cases, args.output)
        print(f"{args.output}: {len(cases)} surfaces")
    for notice in ageless_notice(cases):
        print(f"  {notice}")
    return 0


def report_command(args: argparse.Namespace) -> int:
    """Make tables, figures and pages over all cases."""
    from cortet.cohort.lock import hold, is_held_by_parent
    from cortet.report.over_all import report

    folder = args.folder.absolute()
    if not folder.is_dir():
        raise InputError("no such folder", file=args.folder, remedy="name the output folder of a run")
    held = None if is_held_by_parent() else hold(folder)
    try:
        for path in report(folder, after=args.after):
            print(path)
    finally:
        if held:
            held.close()
    return 0


def run_command(args: argparse.Namespace) -> int:
    """Run the workflow over a data release."""
    from cortet.cohort import app
    from cortet.cohort.selection import ageless_notice

    settings, selection = settings_of(args), app.Selection(args.participants, args.sessions, args.hemi)
    if args.pial:
        cohort = settings.get("cohort") or {}
        settings = {**settings, "cohort": {**cohort, "scan": {**(cohort.get("scan") or {}), "pial": True}}}
    cases = app.find(args.bids_dir, selection, settings, print)
    print(f"{len(cases)} surfaces of {args.bids_dir}", flush=True)
    for notice in [*ageless_notice(cases), *app.source_notice(args.output_dir, args.bids_dir)]:
        print(f"  {notice}", flush=True)
    with app.lock(args.bids_dir, args.output_dir):
        work = args.work_dir or app.work_folder(args.output_dir)
        app.prepare(cases, args.bids_dir, args.output_dir, work, settings)
        code = app.snakemake(
            work,
            args.level,
            cores=args.cores or os.cpu_count() or 1,
            profile=args.profile,
            dry_run=args.dry_run,
            verbose=args.verbose,
        )
    if not args.dry_run:
        print(app.outcome(args.output_dir, cases, args.level))
    return int(code != 0)


def config_command(args: argparse.Namespace) -> int:
    """Print the documented configuration."""
    from cortet.config import render

    print(render({"setting": args.setting}), end="")
    return 0


def doctor_command(_: argparse.Namespace) -> int:
    """Check the installation."""
    from cortet import doctor

    return doctor.run()
