"""What does a run of hundreds cost, and where do time and memory go?

    python benchmarks/cohort.py [--hemispheres 200 1000 10000] [--cell-size 0.6] [--minutes 60] [--plan-only]
    python benchmarks/cohort.py phantoms [--count 194] [--cores 2]
    python benchmarks/cohort.py resources OUTPUT...

Without a word nothing is meshed: sheets whose surfaces are links to one phantom are planned by Snakemake: as a whole,
one batch of ten, then with everything done (empty files, `--touch`), and with the surface of one row changed.
Time is that of the CPU; a step that takes more than so many minutes is given up. Then come the files of a hemisphere
and, by the model of `cortet.cohort.resources`, core hours, disk and memory of the cohort.

`phantoms` meshes tiny phantoms to their pages, and prints as the run goes on how much CPU time Snakemake's own process
has taken, beside that of its jobs.

`resources` compares what jobs took with that model, from the benchmark files of finished runs (OUTPUT is the `output`
of their configuration). `MB` and `s CPU` are the most that was measured, `memory` and `CPU` the measured sums as
fractions of the estimated ones; `asked` is the largest share that a job used of the memory it asks for, and `limit`
that of wall time: above 1 a cluster would have killed it. Snakemake's own memory is left out.
"""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import yaml
from _frame import ROOT, Table, command

from cortet.cohort.resources import MEMORY_MARGIN, Cost, cost, expected_tets, memory_to_ask_mb, minutes_to_ask
from cortet.cohort.sheet import PHANTOM, Case, read_sheet, write_sheet
from cortet.errors import InputError
from cortet.formats.gifti import write_surface
from cortet.phantoms import phantom

SNAKEMAKE = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores"]

# --- planning --------------------------------------------------------------------------------------------------------

#: jobs of a mesh by mesher, one of each rule
RULES = (*("gate", "smooth_surface", "generate", "clean", "reconnect", "solver_ready", "export", "case_page"),)
JOBS = {"cgal": (*RULES, "relocate"), "lattice": RULES}
#: CPU seconds that Snakemake takes in each of the three jobs of SLURM that make a mesh, and in each stage in them
JOB_SECONDS, STAGE_SECONDS = 4.0, 2.0
#: mL of a hemisphere: mean of the fetal and neonatal templates at hand
VOLUME_ML = 60.0
#: bytes per tetrahedron of the files of one mesh: of the last stage, exported with its sets (BrainGrowth's takes 37),
#: and for the browser; and the meshes that only later stages read
FINAL_BYTES, INTERMEDIATE_BYTES = 9.0 + 10.0 + 1.5, 3 * 9.0


class GivenUpError(Exception):
    """A step took too long."""


def links(folder: Path, count: int) -> None:
    """A sheet of so many hemispheres, whose surfaces are all links to one."""
    (folder / "surfaces").mkdir()
    surface = folder / "surfaces/phantom.surf.gii"
    write_surface(phantom(28.0), surface)
    cases = []
    for number in range(count):
        participant, hemi = f"{number // 2:05}", "LR"[number % 2]
        path = folder / f"surfaces/{participant}{hemi}.surf.gii"
        os.link(surface, path)
        cases.append(Case(participant, "1", hemi, 22.0 + number % 15, path))
    write_sheet(cases, folder / "cohort.tsv")


def snakemake(folder: Path, *arguments: str, minutes: float) -> tuple[str, float, float]:
    """Run Snakemake; what it printed, CPU seconds, and most memory resident, MB."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores", "1", *arguments]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryFile("w+") as file:
        process = subprocess.Popen(
            ["timeout", f"{minutes}m", *command], cwd=folder, env=environment, stdout=file, stderr=file
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        file.seek(0)
        text = file.read()
    if process.returncode == 124:
        raise GivenUpError(f"given up after {minutes:g} minutes of the clock")
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}\n{text[-2000:]}")
    return text, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def jobs_in(text: str) -> int:
    """Number of jobs, from the table that Snakemake prints."""
    total = re.search(r"^total +(\d+)$", text, re.MULTILINE)
    return int(total[1]) if total else 0


def named(text: str, *keys: str) -> list[Path]:
    """Files that a dry run named as `output`, `log` or `benchmark` of its jobs."""
    lines = re.findall(rf"^    (?:{'|'.join(keys)}): (.+)$", text, re.MULTILINE)
    return [Path(name) for line in lines for name in line.split(", ")]


def make_everything(folder: Path, text: str) -> None:
    """Empty files for every output that a dry run named, for Snakemake to touch."""
    for name in named(text, "output"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def inodes(text: str, count: int) -> str:
    """Files and folders of a hemisphere, from the files that a dry run named."""
    outputs, logs = (named(text, *keys) for keys in (["output"], ["log", "benchmark"]))
    folders = [len({parent for path in files for parent in path.parents}) for files in (outputs, logs)]
    return (
        f"inodes per hemisphere: {len(outputs) / count:.1f} outputs in {folders[0] / count:.1f} folders, "
        f"{len(logs) / count:.1f} logs and benchmarks in {folders[1] / count:.1f}, "
        f"{len(outputs) / count:.1f} records of Snakemake, one per output"
    )


def change_a_row(folder: Path) -> None:
    """Give the first row another surface."""
    first, *others = read_sheet(folder / "cohort.tsv")
    path = folder / "surfaces/another.surf.gii"
    write_surface(phantom(30.0), path)
    changed = Case(first.participant, first.session, first.hemi, first.scan_age, path)
    write_sheet([changed, *others], folder / "cohort.tsv")


def plan(folder: Path, count: int, minutes: float) -> Iterator[str]:
    """Lines of the first table for one size of the cohort."""

    def line(step: str, text: str, seconds: float, megabytes: float) -> str:
        return f"{count:>12}  {step:<26}{jobs_in(text):>9}{seconds:>9.0f}{megabytes:>8.0f}"

    everything, *used = snakemake(folder, "--dry-run", minutes=minutes)
    yield line("dry run", everything, *used)
    yield f"{count:>12}  {inodes(everything, count)}"
    batch, *used = snakemake(folder, "--dry-run", "meshes", "--batch", "meshes=1/10", minutes=minutes)
    yield line("dry run, batch 1/10", batch, *used)
    make_everything(folder, everything)
    _, *used = snakemake(folder, "--touch", "--quiet", "all", minutes=minutes)
    yield line("touch", everything, *used)
    yield line("dry run, all done", *snakemake(folder, "--dry-run", minutes=minutes))
    change_a_row(folder)
    yield line("dry run, one row changed", *snakemake(folder, "--dry-run", minutes=minutes))


def print_planning(count: int, cell_size: float, minutes: float) -> None:
    """Lines of the first table for one size of the cohort, each as soon as it is known."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        links(folder, count)
        settings = {"cohort": {"sheet": "cohort.tsv"}, "generate": {"cell_size": [cell_size]}}
        (folder / "config.yaml").write_text(yaml.safe_dump(settings))
        try:
            for line in plan(folder, count, minutes):
                print(line, flush=True)
        except GivenUpError as error:
            print(f"{count:>12}  {error}", flush=True)


def print_plan(counts: list[int], cell_size: float) -> None:
    """The table of what would be needed."""
    print(f"\nOf {VOLUME_ML:.0f} mL each, cell size {cell_size} mm")
    columns = ("mesher", "hemispheres", "million tets", "core hours", "GB", "GB, final only", "MB per job, most")
    print("".join(f"{column:>18}" for column in columns))
    for mesher, jobs in JOBS.items():
        tets = expected_tets(VOLUME_ML, cell_size, mesher)
        costs = [cost(rule, mesher) for rule in jobs]
        seconds = sum(found.cpu_seconds(tets) for found in costs)
        memory = max(memory_to_ask_mb(found.memory_mb(tets)) for found in costs)
        for count in counts:
            hours = count * (seconds + 3 * JOB_SECONDS + len(jobs) * STAGE_SECONDS) / 3600
            disk, final = (count * tets * size / 1e9 for size in (FINAL_BYTES + INTERMEDIATE_BYTES, FINAL_BYTES))
            row = (mesher, count, count * tets / 1e6, hours, disk, final, memory)
            print("".join(f"{value:>18.0f}" if isinstance(value, float) else f"{value:>18}" for value in row))


def scale(
    *,
    hemispheres: Sequence[int] = (200, 1000, 10000),
    cell_size: float = 0.6,
    minutes: float = 60,
    plan_only: bool = False,
) -> None:
    """Plan cohorts of these sizes.

    Parameters
    ----------
    minutes
        Of the clock, for a step.
    plan_only
        Leave Snakemake out.
    """
    if not plan_only:
        print(f"{'hemispheres':>12}  {'step':<26}{'jobs':>9}{'CPU s':>9}{'MB':>8}")
        for count in hemispheres:
            print_planning(count, cell_size, minutes)
    print_plan(list(hemispheres), cell_size)


# --- a run of many cases ---------------------------------------------------------------------------------------------

#: so coarse that a mesh has some hundred tetrahedra, with limits that allow for it
TINY: dict[str, Any] = {
    "cohort": {"sheet": "cohort.tsv"},
    "phantom": {"subdivisions": 3},
    "generate": {"cell_size": [4.0]},
    "certify": dict.fromkeys(("max_area_change", "max_volume_change", "max_mean_surface_distance")),
}
#: seconds between two looks at a run
LOOK = 2.0


def phantoms(*, count: int = 194, cores: int = 2) -> None:
    """Mesh so many tiny phantoms to their pages, and print the CPU seconds of Snakemake's own process and of all."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sheet(
            [Case(f"{one:03}", None, "L", 22.0 + one % 9, PHANTOM) for one in range(count)], folder / "cohort.tsv"
        )
        (folder / "config.yaml").write_text(yaml.safe_dump(TINY))
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores", str(cores)]
        with (folder / "log").open("w") as log:
            run = subprocess.Popen(
                command, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=log, stderr=log
            )
        table = Table("pages", "minutes", "own CPU s", "CPU s", "own share", "threads")
        process, began, quarter = psutil.Process(run.pid), time.monotonic(), -1
        while run.poll() is None:
            used, threads = process.cpu_times(), process.num_threads()
            done = len([*folder.glob("derivatives/cortet/sub-*/mesh/*_report.html")])
            if done and 4 * done // count > quarter:
                quarter = 4 * done // count
                own, jobs = used.user + used.system, used.children_user + used.children_system
                minutes = (time.monotonic() - began) / 60
                table.values(
                    done, f"{minutes:.1f}", f"{own:.1f}", f"{own + jobs:.0f}", f"{own / (own + jobs):.1%}", threads
                )
            time.sleep(LOOK)
        print((folder / "log").read_text().splitlines()[-1])


# --- what jobs took --------------------------------------------------------------------------------------------------

#: benchmark files, which Snakemake writes, are named as the files they are about
FILE_NAME = re.compile(r"(?P<case>.+)_res-(?P<res>\d+)um_desc-(?P<mesher>[a-z0-9]+)")
COLUMNS = ("jobs", "MB", "s CPU", "memory", "CPU", "asked", "limit")


class Job(NamedTuple):
    """One benchmark file: peak resident memory, MB, CPU and wall time, s; the estimate, and tetrahedra of its mesh."""

    megabytes: float
    cpu_seconds: float
    wall_seconds: float
    cost: Cost
    tets: float


def meshes(folder: Path) -> dict[tuple[str, ...], int]:
    """Tetrahedra by (case, cell size in um, mesher), from the reports of S1 below a folder."""
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in folder.rglob("*Generated_tetmesh.json")]
    return {
        (of["case"], f"{round(1000 * of['cell_size_mm'])}", of["mesher"]): report["tetrahedra"]
        for report in reports
        for of in [report["origin"]]
        if "tetrahedra" in report  # a mesher that is only compared with may have failed
    }


def jobs(folder: Path, tets: dict[tuple[str, ...], int]) -> dict[str, list[Job]]:
    """Measured jobs of a run by rule; those of S1 by mesher as well."""
    found = defaultdict(list)
    for path in sorted((folder / "benchmarks").glob("*/**/*.tsv")):
        rule = path.relative_to(folder / "benchmarks").parts[0]
        match = FILE_NAME.match(path.name)
        mesh = match.groups() if match else ()
        try:
            estimate = cost(rule, mesh[2] if mesh else "")
        except InputError:  # a rule over all cases, or a mesher of another project
            continue
        if mesh and mesh not in tets:
            continue
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file, delimiter="\t") if row["max_rss"] not in ("NA", "-", "")]
        name = f"{rule}:{mesh[2]}" if rule == "generate" else rule
        for row in rows:
            values = [float(row[key]) for key in ("max_rss", "cpu_time", "s")]
            found[name].append(Job(*values, estimate, tets.get(mesh, 0)))
    return found


def line_of(measured: list[Job]) -> list[float]:
    """Numbers of a line of the table."""
    return [
        len(measured),
        max(job.megabytes for job in measured),
        max(job.cpu_seconds for job in measured),
        sum(job.megabytes for job in measured) / sum(job.cost.memory_mb(job.tets) for job in measured),
        sum(job.cpu_seconds for job in measured) / sum(job.cost.cpu_seconds(job.tets) for job in measured),
        max(job.megabytes / (MEMORY_MARGIN * job.cost.memory_mb(job.tets)) for job in measured),
        max(job.wall_seconds / 60 / minutes_to_ask(job.cost.cpu_seconds(job.tets)) for job in measured),
    ]


def resources(folders: Sequence[Path]) -> None:
    """Compare the jobs of runs, by the folders that they wrote to, with the model."""
    tets = {key: count for folder in folders for key, count in meshes(folder).items()}
    measured = defaultdict(list)
    for folder in folders:
        for rule, found in jobs(folder, tets).items():
            measured[rule] += found
    print(f"{'rule':<18}" + "".join(f"{column:>8}" for column in COLUMNS))
    for rule in sorted(measured):
        count, megabytes, seconds, *shares = line_of(measured[rule])
        print(f"{rule:<18}{count:8.0f}{megabytes:8.0f}{seconds:8.0f}" + "".join(f"{share:8.2f}" for share in shares))
    seconds, millions = sum(job.cpu_seconds for found in measured.values() for job in found), sum(tets.values()) / 1e6
    print(
        f"{len(tets)} meshes of {millions:.2f} million tetrahedra: {seconds:.0f} s of CPU in jobs, "
        f"{seconds / len(tets):.1f} per mesh, {seconds / millions:.1f} per million"
    )


main = command(__doc__, scale, phantoms, resources)

if __name__ == "__main__":
    main()
