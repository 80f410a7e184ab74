"""A tiny study in a folder of its own, on which the tests run the workflow."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from shapes import ball_surface

from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.formats.gifti import read_surface, write_surface
from cortet.geometry.nesting import joined
from cortet.meshes import TriSurface
from cortet.over_all import RUN
from tests.integration import loaded_snakemake

ROOT = Path(__file__).parents[2]

#: a target: the table of states, for which every case is meshed, certified and exported; no pages, figures and records
STATUS = "derivatives/cortet/cohort/cohort_status.tsv"

#: a few hundred tetrahedra, which are coarse against an egg of 24 mm; of CGAL, where it takes part, no slow passes
CONFIG: dict[str, Any] = {
    "cohort": {"sheet": "cohort.tsv"},
    "generate": {"cell_size": [4.0], "backend": "cgal", "odt": False, "lloyd": False, "perturb": False, "exude": False},
    "relocate": {"passes": 1},
    "certify": {"max_area_change": 0.2, "max_volume_change": 0.3, "max_mean_surface_distance": 0.15},
}


@dataclass
class Study:
    """A folder in which the workflow runs."""

    folder: Path
    config: dict[str, Any] = field(default_factory=lambda: {key: dict(value) for key, value in CONFIG.items()})
    #: what Snakemake printed in the last `jobs_of_run`
    said: str = ""

    @property
    def outputs(self) -> Path:
        """Folder of everything that is made."""
        return self.folder / "derivatives/cortet"

    @property
    def logs(self) -> Path:
        """Folder of the logs of all jobs."""
        return self.outputs / "logs"

    def command(self, *arguments: str) -> list[str]:
        """Command line of Snakemake on the project's workflow; writes the configuration."""
        (self.folder / "config.yaml").write_text(yaml.safe_dump(self.config))
        return [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            str(ROOT / "Snakefile"),
            "--cores",
            "2",
            "--verbose",
            *arguments,
        ]

    def run(self, *arguments: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
        """Run Snakemake to its end, in the environment of this process or another."""
        return loaded_snakemake.run(self.command(*arguments)[3:], self.folder, env or dict(os.environ))

    def jobs_of_run(self, *arguments: str, succeeds: bool = True) -> set[tuple[str, str]]:
        """Run Snakemake; (rule, case) of the jobs that it ran, with case `-` for those over all cases."""
        began = time.time()
        result = self.run(*arguments)
        self.said = result.stdout + result.stderr
        assert (result.returncode == 0) is succeeds, self.said
        logs = [path for path in self.logs.rglob("*.log") if path.stat().st_mtime >= began]
        parts = [path.relative_to(self.logs).parts for path in logs]
        return {(part[0].removesuffix(".log"), part[1] if len(part) > 1 else "-") for part in parts}

    def planned_jobs(self, *targets: str, project: Path = ROOT) -> set[tuple[str, str]]:
        """(rule, case) of the jobs that the workflow of a checkout would run, as `jobs_of_run`."""
        result = self.run("--dry-run", "--snakefile", str(project / "Snakefile"), *targets)
        assert result.returncode == 0, result.stdout + result.stderr
        jobs = re.findall(r"^(?:local)?rule (\w+):\n((?: +.*\n)*)", result.stdout, flags=re.MULTILINE)
        folders = [(rule, re.search(r"wildcards: folder=([^,\s]+)", block)) for rule, block in jobs if rule != "all"]
        return {(rule, folder[1] if folder else "-") for rule, folder in folders}

    def add_case(self, case: Case, surface: TriSurface) -> None:
        """Write a surface and add its row to the sheet."""
        write_surface(surface, Path(case.surface))
        self.write_cases([*self.cases(), case])

    def cases(self) -> list[Case]:
        sheet = self.folder / "cohort.tsv"
        return read_sheet(sheet) if sheet.exists() else []

    def write_cases(self, cases: list[Case]) -> None:
        write_sheet(cases, self.folder / "cohort.tsv")

    def case(self, participant: str) -> Case:
        return Case(participant, None, "L", 24.0, self.folder / f"surfaces/{participant}.surf.gii")

    def status(self) -> dict[str, dict[str, str]]:
        """Rows of the status table by case."""
        return self._table("cohort_status", "case")

    def _table(self, name: str, key: str) -> dict[str, dict[str, str]]:
        header, *rows = (self.folder / f"derivatives/cortet/cohort/{name}.tsv").read_text().splitlines()
        records = [dict(zip(header.split("\t"), row.split("\t"), strict=True)) for row in rows]
        return {record[key]: record for record in records}

    def results(self, participant: str) -> set[str]:
        """Ends of the names of the present results of a case: its last mesh, certificate, exports and page."""
        ends = (re.search(r"(?:Solver|Ordered)_(.*)", path.name) for path in self.files(f"sub-{participant}/**/*"))
        return {end[1] for end in ends if end}

    def outdated(self, participant: str) -> Path:
        """The certificate of a case that moved aside."""
        (certificate,) = self.outputs.glob(f"sub-{participant}/outdated/*/*_certificate.json")
        return certificate

    def files(self, pattern: str) -> list[Path]:
        """Results that match a pattern, hidden ones too; no logs and benchmarks."""
        return [path for path in sorted(self.outputs.rglob(pattern)) if is_result(path, self.outputs)]


def is_result(path: Path, outputs: Path) -> bool:
    """Whether an output is a present result: no log, benchmark or record of the run, and not outdated."""
    parts = path.relative_to(outputs).parts
    return parts[0] not in ("logs", "benchmarks", Path(RUN).parts[0]) and "outdated" not in parts


def surface(number: int) -> TriSurface:
    """An egg of about 24 mm, another one for each number."""
    ball = ball_surface(3, radius=12.0)
    return TriSurface(ball.points * [1, 1 + 0.01 * number, 0.9], ball.faces)


def twice(one: TriSurface) -> TriSurface:
    """Two of them side by side, which nothing can make one."""
    aside = TriSurface(one.points + np.array([40.0, 0, 0]), one.faces)
    return joined([one, aside])


def scaled(path: Path, factor: float) -> None:
    """Replace a surface by a larger or smaller one."""
    old = read_surface(path)
    write_surface(TriSurface(factor * old.points, old.faces), path)
