"""Long runs: `fold`, `cohort scan`, `run`; and `doctor`."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any

from cortet.cli.given import read_mesh, settings_of
from cortet.errors import InputError
from cortet.formats.ownership import may_write


def fold_command(args: argparse.Namespace) -> int:
    """Fold a mesh."""
    from numba import get_num_threads, set_num_threads

    from cortet.config import load, read
    from cortet.formats.gifti import hemisphere_of, read_surface
    from cortet.report.fold_figures import FILM, NUMBERS, PICTURE, draw
    from cortet.simulation.fold import fold
    from cortet.simulation.journal import FILES, status
    from cortet.simulation.state import Settings
    from cortet.solver_files.sidecar import read_sidecar

    known = read_sidecar(args.mesh).get("made_from", {}).get("hemisphere")
    if args.hemi and known and args.hemi != known:
        raise InputError(
            f"was made from a surface of hemisphere {known}, as that says, not {args.hemi}",
            file=args.mesh,
            remedy=f"use --hemi {known}",
        )
    for name in (*FILES, NUMBERS, PICTURE, FILM):  # before the work
        may_write(args.output / name)
    if args.threads:
        set_num_threads(min(args.threads, get_num_threads()))
    chosen = {"end": args.end, "time_step": args.time_step, "device": args.device}
    data: dict[str, Any] = {}
    if args.config:
        load(args.config)  # complaints name the file
        data = read(args.config)
    data["fold"] = {**(data.get("fold") or {}), **{key: value for key, value in chosen.items() if value is not None}}
    if args.real:
        data["fold"]["real_surfaces"] = (data["fold"].get("real_surfaces") or {}) | dict(args.real)
    config = load(data)
    values = config.arguments("fold", {"gestational_age": args.ga, "hemisphere": args.hemi})
    real = config.fold.real_surfaces_of(args.hemi)
    for path in real.values():  # before the work
        read_surface(path)
        if args.hemi and (named := hemisphere_of(path)) not in (None, args.hemi):
            raise InputError(
                f"is of hemisphere {named}, as it says, not {args.hemi}",
                file=path,
                remedy="name the surface of the same hemisphere",
            )
    live = sys.stdout.isatty()
    verdict = fold(
        read_mesh(args.mesh, whole=True),
        args.output,
        Settings(**values),
        lambda *progress: print(
            f"\r{status(*progress)}" if live else status(*progress), end="" if live else "\n", flush=True
        ),
        print,
    )
    print(f"\n{verdict.reason}")
    for path in draw(args.output, args.hemi, real):
        print(f"{path}: drawn")
    return 0 if verdict.outcome == "folded" else 1


def scan_command(args: argparse.Namespace) -> int:
    """Write the cohort sheet of a data release."""
    from cortet.cohort.scan import scan
    from cortet.cohort.sheet import add_to_sheet, ageless_notice, read_header, write_sheet
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
        read_header(args.output)  # no other table is replaced, whatever is forced
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


def run_command(args: argparse.Namespace) -> int:
    """Run the workflow over a data release."""
    from cortet.cohort import app
    from cortet.cohort.sheet import ageless_notice

    settings, selection = settings_of(args), app.Selection(args.participants, args.sessions, args.hemi)
    if args.pial:
        cohort = settings.get("cohort") or {}
        settings = {**settings, "cohort": {**cohort, "scan": {**(cohort.get("scan") or {}), "pial": True}}}
    cases = app.find(args.bids_dir, selection, settings, print)
    print(f"{len(cases)} surfaces of {args.bids_dir}", flush=True)
    for notice in ageless_notice(cases):
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
