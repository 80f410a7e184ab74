"""What jobs took beside what `cortet.cohort.resources` expects: a table from the benchmark files of finished runs.

    python benchmarks/resources.py FOLDER... [--derivatives FOLDER...]

A folder is one in which Snakemake ran; each of its benchmark files counts whose mesh is known from the report of S1.
`MB` and `s CPU` are the most that was measured, `memory` and `CPU` the measured sums as fractions of the estimated
ones. `asked` is the largest share that a job used of the memory it asks for, and `limit` that of wall time: above 1 a
cluster would have killed it. Snakemake's own memory, which benchmark files do not hold, is left out.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from cortet.cohort.resources import MEMORY_MARGIN, Cost, cost, minutes_to_ask
from cortet.errors import InputError

#: logs and benchmarks are named as the files they are about
NAME = re.compile(r"(?P<case>.+)_res-(?P<res>\d+)um_desc-(?P<mesher>[a-z0-9]+)")
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
    found = {}
    for path in folder.rglob("*Generated_tetmesh.json"):
        report = json.loads(path.read_text(encoding="utf-8"))
        if (match := NAME.match(path.name)) and "tetrahedra" in report:
            found[match.groups()] = report["tetrahedra"]
    return found


def jobs(folder: Path, tets: dict[tuple[str, ...], int]) -> dict[str, list[Job]]:
    """Measured jobs of a run by rule, S1 by mesher, too."""
    found = defaultdict(list)
    for path in sorted((folder / "benchmarks").glob("*/**/*.tsv")):
        rule = path.relative_to(folder / "benchmarks").parts[0]
        match = NAME.match(path.name)
        mesh = match.groups() if match else ()
        try:
            estimate = cost(rule, mesh[2] if mesh else "")
        except InputError:  # over all cases, or by a mesher of others
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


def line(measured: list[Job]) -> list[float]:
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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, help="where Snakemake ran")
    parser.add_argument("--derivatives", nargs="*", type=Path, default=[], help="outputs that lie elsewhere")
    options = parser.parse_args()
    tets: dict[tuple[str, ...], int] = {}
    for folder in (*options.folders, *options.derivatives):
        tets |= meshes(folder)
    measured = defaultdict(list)
    for folder in options.folders:
        for rule, found in jobs(folder, tets).items():
            measured[rule] += found
    print(f"{'rule':<18}" + "".join(f"{column:>8}" for column in COLUMNS))
    for rule in sorted(measured):
        count, megabytes, seconds, *shares = line(measured[rule])
        print(f"{rule:<18}{count:8.0f}{megabytes:8.0f}{seconds:8.0f}" + "".join(f"{share:8.2f}" for share in shares))


if __name__ == "__main__":
    main()
