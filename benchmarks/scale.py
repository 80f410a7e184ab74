"""What a cohort of many hemispheres takes to plan, and what it would take to run; nothing is meshed.

    python benchmarks/scale.py [--hemispheres 200 1000 10000] [--cell-size 0.6] [--minutes 60] [--plan-only]

Writes cohort sheets whose surfaces are links to one phantom and has Snakemake plan them: as a whole, one batch of ten,
then with everything done (empty files, `--touch`, receipts), and with the surface of one row changed. Time is that of
the CPU; a step that takes more than so many minutes is given up. Then come the files of a hemisphere and, by the model
of `cortet.cohort.resources`, core hours, disk and memory of the cohort.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import yaml

from cortet.cohort.resources import cost, disk_mb, expected_tets, memory_to_ask_mb
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.formats.gifti import write_surface
from cortet.phantom import phantom

ROOT = Path(__file__).resolve().parents[1]
#: jobs of a mesh by mesher, one of each rule
RULES = (
    *("repair", "gate", "smooth_surface", "generate", "transfer", "clean", "reconnect", "solver_ready"),
    *("certify", "export", "case_page"),
)
JOBS = {"cgal": (*RULES, "relocate"), "lattice": RULES}
#: CPU seconds that Snakemake takes in each of the three jobs of SLURM that make a mesh, and in each stage in them
JOB_SECONDS, STAGE_SECONDS = 4.0, 2.0
#: mL of a hemisphere: mean of the fetal and neonatal templates at hand
VOLUME_ML = 60.0
#: Snakemake, which leaves a receipt for each job that has none, as the job would when it is done
WITH_RECEIPTS = """
import sys
from cortet.cohort import receipts
receipts.is_current = lambda path, parameters: receipts.write_receipt(path, parameters) or True
from snakemake.cli import main
sys.exit(main(sys.argv[1:]))
"""


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


def snakemake(
    folder: Path, *arguments: str, minutes: float, program: tuple[str, str] = ("-m", "snakemake")
) -> tuple[str, float, float]:
    """Run Snakemake; what it printed, CPU seconds, and most memory resident, MB."""
    command = [sys.executable, *program, "--snakefile", str(ROOT / "Snakefile"), "--cores", "1", *arguments]
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
    snakemake(folder, "--dry-run", minutes=minutes, program=("-c", WITH_RECEIPTS))
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
            disk, final = (count * disk_mb(tets, keep_intermediates=keep) / 1000 for keep in (True, False))
            row = (mesher, count, count * tets / 1e6, hours, disk, final, memory)
            print("".join(f"{value:>18.0f}" if isinstance(value, float) else f"{value:>18}" for value in row))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hemispheres", nargs="+", type=int, default=[200, 1000, 10000])
    parser.add_argument("--cell-size", type=float, default=0.6, help="mm")
    parser.add_argument("--minutes", type=float, default=60, help="of the clock, for a step")
    parser.add_argument("--plan-only", action="store_true", help="leave Snakemake out")
    options = parser.parse_args()
    if not options.plan_only:
        print(f"{'hemispheres':>12}  {'step':<26}{'jobs':>9}{'CPU s':>9}{'MB':>8}")
        for count in options.hemispheres:
            print_planning(count, options.cell_size, options.minutes)
    print_plan(options.hemispheres, options.cell_size)


if __name__ == "__main__":
    main()
