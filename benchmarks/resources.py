"""What jobs took beside what `cortet.cohort.resources` expects: a table from the benchmark files of finished runs.

    python benchmarks/resources.py OUTPUT...

Each OUTPUT is the folder that a run wrote to (`output` of its configuration); each of its benchmark files counts whose
mesh is known from the report of S1. `MB` and `s CPU` are the most that was measured, `memory` and `CPU` the measured
sums as fractions of the estimated ones. `asked` is the largest share that a job used of the memory it asks for, and
`limit` that of wall time: above 1 a cluster would have killed it. Snakemake's own memory, which benchmark files do not
hold, is left out. The last line is what whole meshes took, without tables over all of them.
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

#: benchmark files, which Snakemake writes, are named as the files they are about
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
        match = NAME.match(path.name)
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
    parser.add_argument("folders", nargs="+", type=Path, help="folders that runs wrote to")
    options = parser.parse_args()
    tets: dict[tuple[str, ...], int] = {}
    for folder in options.folders:
        tets |= meshes(folder)
    measured = defaultdict(list)
    for folder in options.folders:
        for rule, found in jobs(folder, tets).items():
            measured[rule] += found
    print(f"{'rule':<18}" + "".join(f"{column:>8}" for column in COLUMNS))
    for rule in sorted(measured):
        count, megabytes, seconds, *shares = line(measured[rule])
        print(f"{rule:<18}{count:8.0f}{megabytes:8.0f}{seconds:8.0f}" + "".join(f"{share:8.2f}" for share in shares))
    seconds, millions = sum(job.cpu_seconds for found in measured.values() for job in found), sum(tets.values()) / 1e6
    print(
        f"{len(tets)} meshes of {millions:.2f} million tetrahedra: {seconds:.0f} s of CPU in jobs, "
        f"{seconds / len(tets):.1f} per mesh, {seconds / millions:.1f} per million"
    )


if __name__ == "__main__":
    main()
