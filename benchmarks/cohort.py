"""What does a run of hundreds cost, where do time and memory go, and do its results survive kills and edits?

    python benchmarks/cohort.py [--hemispheres 200 1000 10000] [--cell-size 0.6] [--minutes 60] [--plan-only]
    python benchmarks/cohort.py resources OUTPUT...
    python benchmarks/cohort.py soak [--output FOLDER] [--cases 200] [--kills 10] [--seed 0] [--cores 2]
    python benchmarks/cohort.py provenance [--sequences 200] [--seed 0] [--cores 2] [--output FOLDER]

Without a word nothing is meshed: sheets whose surfaces are links to one phantom are planned by Snakemake: as a whole,
one batch of ten, then with everything done (empty files, `--touch`), and with the surface of one row changed.
Time is that of the CPU; a step that takes more than so many minutes is given up. Then come the files of a hemisphere
and, by the model of `cortet.cohort.resources`, core hours, disk and memory of the cohort.

`resources` compares what jobs took with that model, from the benchmark files of finished runs (OUTPUT is the `output`
of their configuration). `MB` and `s CPU` are the most that was measured, `memory` and `CPU` the measured sums as
fractions of the estimated ones; `asked` is the largest share that a job used of the memory it asks for, and `limit`
that of wall time: above 1 a cluster would have killed it. Snakemake's own memory is left out.

`soak` makes a cohort of small hemispheres, one in five broken at random: its surface, as in `breakages.py`, or the
bytes of its file, as in `fuzz.py`. One run goes to its end; the other is killed with everything it started (SIGKILL),
unlocked and started again, so often, and then left alone. Both must hold the same files with the same bits, apart from
logs, times and Snakemake's notes; each case is certified or has its reason. Exits with 1 if not.

`provenance` edits a cohort of two between runs, one to four times each, as users do (a surface replaced by one with an
older time, two subjects swapped, files and folders renamed and moved, parameters changed, another working folder,
everything touched). Exits with 1 if a certificate, a record or a mesh is of another input or of other parameters.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from _frame import ROOT, command
from breakages import BREAKAGES
from fuzz import damaged

from cortet.cohort.lock import NAME as LOCK
from cortet.cohort.resources import (
    MEMORY_MARGIN,
    Cost,
    cost,
    disk_mb,
    expected_tets,
    memory_to_ask_mb,
    minutes_to_ask,
)
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.config import load
from cortet.errors import InputError
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.hashing import sha256
from cortet.formats.tsv import read_tsv
from cortet.geometry.icosphere import icosphere
from cortet.geometry.topology import enclosed_volume
from cortet.meshes import TriSurface
from cortet.phantoms import phantom
from cortet.stages import STAGES

SNAKEMAKE = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores"]

# --- planning --------------------------------------------------------------------------------------------------------

#: jobs of a mesh by mesher, one of each rule
RULES = (
    *("gate", "smooth_surface", "generate", "transfer", "clean", "reconnect", "solver_ready"),
    *("certify", "export", "case_page"),
)
JOBS = {"cgal": (*RULES, "relocate"), "lattice": RULES}
#: CPU seconds that Snakemake takes in each of the three jobs of SLURM that make a mesh, and in each stage in them
JOB_SECONDS, STAGE_SECONDS = 4.0, 2.0
#: mL of a hemisphere: mean of the fetal and neonatal templates at hand
VOLUME_ML = 60.0


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
            disk, final = (count * disk_mb(tets, keep_intermediates=keep) / 1000 for keep in (True, False))
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

    minutes : of the clock, for a step
    plan_only : leave Snakemake out
    """
    if not plan_only:
        print(f"{'hemispheres':>12}  {'step':<26}{'jobs':>9}{'CPU s':>9}{'MB':>8}")
        for count in hemispheres:
            print_planning(count, cell_size, minutes)
    print_plan(list(hemispheres), cell_size)


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


# --- kills -----------------------------------------------------------------------------------------------------------

#: mm; a hemisphere then has some thousands of tetrahedra
SOAK_CELL_SIZE = 3.0
#: what tells of the jobs, not of the results
_OF_JOBS = ("logs", "benchmarks", LOCK, ".cortet")
#: one case in so many is broken; some breakages need deeper sulci than small surfaces have
_BROKEN = 5
_ON_SMALL = [
    break_ for name, break_ in BREAKAGES.items() if name not in ("bridge between banks", "50 crossing triangles")
]


def make_cohort(folder: Path, cases: int, seed: int) -> Path:
    """Write the surfaces and the sheet; the file name of the sheet."""
    rows, rng = [], random.Random(seed)
    for number in range(cases):
        age = 22 + number % 8
        file = folder / f"surfaces/{number:03d}.surf.gii"
        file.parent.mkdir(parents=True, exist_ok=True)
        surface = phantom(age, subdivisions=4, seed=number)
        how = rng.choice(["surface", "file"]) if number % _BROKEN == 0 else "not at all"
        write_surface(rng.choice(_ON_SMALL)(surface) if how == "surface" else surface, file)
        if how == "file":
            file.write_bytes(damaged(file.read_bytes(), rng))
        rows.append(Case(f"{number:03d}", None, "L", float(age), file))
    write_sheet(rows, folder / "cohort.tsv")
    return folder / "cohort.tsv"


def prepared(folder: Path, sheet: Path, cores: int) -> list[str]:
    """The workflow's command line in a folder; writes its configuration there."""
    folder.mkdir(parents=True, exist_ok=True)
    config = {"cohort": {"sheet": str(sheet)}, "generate": {"cell_size": SOAK_CELL_SIZE}, "fold": {"cases": []}}
    (folder / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    return [*SNAKEMAKE, str(cores), "--keep-going"]


def run(arguments: list[str], folder: Path) -> int:
    """Run to the end; what is said goes to `log`."""
    with (folder / "log").open("a", encoding="utf-8") as log:
        return subprocess.run(arguments, cwd=folder, stdout=log, stderr=log, check=False).returncode


def run_and_kill(arguments: list[str], folder: Path, seconds: float) -> bool:
    """Kill a run and all that it started after so many seconds; False if it ended before."""
    with (folder / "log").open("a", encoding="utf-8") as log:
        process = subprocess.Popen(arguments, cwd=folder, stdout=log, stderr=log, start_new_session=True)
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return True
    return False


def results(folder: Path) -> dict[str, str]:
    """SHA-256 by name of every file that a run left, but those of its jobs."""
    outputs = folder / "derivatives/cortet"
    files = [path for path in outputs.rglob("*") if path.is_file()]
    names = {path.relative_to(outputs): path for path in files}
    return {
        str(name): hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in sorted(names.items())
        if name.parts[0] not in _OF_JOBS
    }


def differences(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """Names of files that only one of two runs has, or that differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def soak(*, output: Path | None = None, cases: int = 200, kills: int = 10, seed: int = 0, cores: int = 2) -> int:
    """Run both and print what became of them."""
    folder = (output or Path(tempfile.mkdtemp())).resolve()
    sheet = make_cohort(folder, cases, seed)
    calm, disturbed = folder / "undisturbed", folder / "killed"

    began = time.monotonic()
    run(prepared(calm, sheet, cores), calm)
    seconds = time.monotonic() - began
    print(f"undisturbed: {seconds:.0f} s", flush=True)

    rng, killed = random.Random(seed), 0
    arguments = prepared(disturbed, sheet, cores)
    for _ in range(kills):
        after = rng.uniform(0, 2 * seconds / kills)
        killed += run_and_kill(arguments, disturbed, after)
        run([*arguments, "--unlock"], disturbed)
    run(arguments, disturbed)
    print(f"killed {killed} times: {time.monotonic() - began - seconds:.0f} s", flush=True)

    status = read_tsv(calm / "derivatives/cortet/cohort/cohort_status.tsv")
    for what, count in sorted(Counter(status["state"]).items()):
        print(f"{count:4d} {what}")
    unexplained = status[(status["state"] != "certified") & (status["reason"].isin(["", "n/a"]))]["case"].tolist()
    other = differences(results(calm), results(disturbed))
    print(f"{len(results(calm))} files, {len(other)} differ; {len(unexplained)} not certified without a reason")
    for name in [*other, *unexplained]:
        print(f"  {name}")
    return 1 if other or unexplained else 0


# --- edits -----------------------------------------------------------------------------------------------------------

#: mm
CELL_SIZE = 4.0
#: the size of no two surfaces is alike, so that a mesh of another one has another volume
_GROWTH = 1.12


@dataclass
class World:
    """What a user has: surfaces, a configuration, working folders and an output folder."""

    folder: Path
    rng: random.Random
    output: str = "derivatives"
    working: str = "here"
    surfaces: dict[str, str] = field(default_factory=lambda: {"a": "surfaces/a.surf.gii", "b": "surfaces/b.surf.gii"})
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    made: int = 0

    def surface(self, case: str) -> Path:
        """File of the surface of a case."""
        return self.folder / self.surfaces[case]

    def config(self) -> dict[str, Any]:
        """The configuration, as the working folder has it."""
        defaults = {"generate": {"cell_size": CELL_SIZE}, "certify": {"max_area_change": 0.3, "max_volume_change": 0.5}}
        chosen = {name: {**defaults.get(name, {}), **self.settings.get(name, {})} for name in defaults | self.settings}
        return {"cohort": {"sheet": "../cohort.tsv"}, "output": f"../{self.output}", **chosen}

    def new_surface(self, path: Path) -> None:
        """Write a surface that no case had before."""
        self.made += 1
        ball = icosphere(3)
        points = ball.points * (12 * _GROWTH ** (self.made % 7)) * [1, 1 + 1e-3 * self.made, 0.9]
        path.parent.mkdir(parents=True, exist_ok=True)
        write_surface(TriSurface(points, ball.faces), path)

    def run(self, cores: int) -> int:
        """Run the workflow in the working folder."""
        rows = [Case(name, None, "L", 24.0, self.surface(name)) for name in self.surfaces]
        write_sheet(rows, self.folder / "cohort.tsv")
        place = self.folder / self.working
        place.mkdir(exist_ok=True)
        (place / "config.yaml").write_text(yaml.safe_dump(self.config()), encoding="utf-8")
        with (self.folder / "log").open("a", encoding="utf-8") as log:
            words = [*SNAKEMAKE, str(cores), "meshes"]
            return subprocess.run(words, cwd=place, stdout=log, stderr=log, check=False).returncode


def replaced_by_an_older_file(world: World) -> None:
    """A new surface under an old name, with a time of 2001."""
    path = world.surface(world.rng.choice("ab"))
    world.new_surface(path)
    os.utime(path, (1e9, 1e9))


def two_subjects_swapped(world: World) -> None:
    """Their files change places and keep their times."""
    first, second = world.surface("a"), world.surface("b")
    aside = first.with_name("aside")
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


def a_surface_renamed(world: World) -> None:
    """The file and its row of the sheet."""
    case = world.rng.choice("ab")
    old = world.surface(case)
    world.made += 1
    world.surfaces[case] = f"surfaces/{case}{world.made}.surf.gii"
    old.rename(world.surface(case))


def output_moved(world: World) -> None:
    """The output folder gets another name."""
    old, world.made = world.folder / world.output, world.made + 1
    world.output = f"derivatives{world.made}"
    old.rename(world.folder / world.output)


def everything_moved(world: World) -> None:
    """The folder of all others gets another name."""
    world.made += 1
    world.folder = world.folder.rename(world.folder.with_name(f"world{world.made}"))


def parameters_changed(world: World) -> None:
    """One key of the configuration."""
    section, key, values = world.rng.choice(
        [
            ("clean", "thresholds", [[0.7, 0.5, 0.3], [0.6, 0.4], [0.5]]),
            ("certify", "q_max", [0.6, 0.55, 0.5]),
            ("smooth_surface", "enabled", [True, False]),
            ("reconnect", "threshold", [0.3, 0.31]),
            ("export", "cortex_depth", [1.5, 2.0]),
        ]
    )
    world.settings.setdefault(section, {})[key] = world.rng.choice(values)


def another_working_folder(world: World) -> None:
    """Where Snakemake is started and keeps its notes."""
    world.working = world.rng.choice(["here", "there", "elsewhere"])


def everything_touched(world: World) -> None:
    """All files get the time of now."""
    for path in world.folder.rglob("*"):
        if path.is_file() and ".snakemake" not in path.parts:
            path.touch()


EDITS: tuple[Callable[[World], None], ...] = (
    replaced_by_an_older_file,
    two_subjects_swapped,
    a_surface_renamed,
    output_moved,
    everything_moved,
    parameters_changed,
    another_working_folder,
    everything_touched,
)


def contradictions(world: World) -> Iterator[str]:
    """What in the output is not of the input and the parameters that there are now."""
    config = load(world.config())
    for case in world.surfaces:
        path, meshes = world.surface(case), world.folder / world.output / f"sub-{case}/mesh"
        wanted, name = sha256(path), f"sub-{case}_hemi-L_res-{round(1000 * CELL_SIZE)}um_desc-latticeSolver"
        certificate = json.loads((meshes / f"{name}_certificate.json").read_text(encoding="utf-8"))
        if not certificate["certified"]:
            yield f"{case}: not certified"
        if certificate["input"]["sha256"] != wanted:
            yield f"{case}: the certificate names another surface"
        facts = {"gestational_age": 24.0, "hemisphere": "L", "cell_size": CELL_SIZE, "mesher": "lattice"}
        for step, recorded in certificate["parameters"].items():
            asked = config.record(step, facts | {"source": recorded.get("source"), "nested": False})
            if json.loads(json.dumps(asked)) != recorded:
                yield f"{case}: {step} ran with other parameters"
        # a stage that the configuration bypasses now may have left its record of another time, which nothing reads
        labels = [STAGES[step].label for step in certificate["parameters"] if step in STAGES]
        records = (world.folder / world.output / f"sub-{case}").rglob("*_white.json")
        for record in (one for one in records if any(f"desc-{label}_" in one.name for label in labels)):
            if json.loads(record.read_text(encoding="utf-8"))["input_sha256"] != {"surface": wanted}:
                yield f"{case}: {record.name} is of another surface"
        solver = meshes / f"{name}_sets.vtu"
        sidecar = json.loads(solver.with_name(solver.name + ".json").read_text(encoding="utf-8"))
        surface = read_surface(path)
        volume = abs(enclosed_volume(surface.points, surface.faces))
        if sidecar["files"] != {solver.name: sha256(solver)}:
            yield f"{case}: the sidecar is of another file"
        if sidecar["made_from"]["given"]["cortex"]["sha256"] != wanted:
            yield f"{case}: the sidecar names another surface"
        if not np.isclose(sidecar["volume_mm3"], volume, rtol=0.12):
            yield f"{case}: the mesh has {sidecar['volume_mm3']:.0f} mm3, its surface {volume:.0f}"


def provenance(*, sequences: int = 200, seed: int = 0, cores: int = 2, output: Path | None = None) -> int:
    """Make the cohort, edit it, and print what came of it."""
    place = (output or Path(tempfile.mkdtemp())).resolve()
    world = World(place / "world", random.Random(seed))
    for case in world.surfaces:
        world.new_surface(world.surface(case))
    edits, found, began = Counter[str](), [], time.time()
    for number in range(sequences + 1):
        chosen = [] if number == 0 else world.rng.choices(EDITS, k=world.rng.randint(1, 4))
        for edit in chosen:
            edit(world)
        names = [edit.__name__ for edit in chosen]
        edits.update(names)
        failed = world.run(cores)
        problems = ["the run failed"] if failed else list(contradictions(world))
        found += [f"{number}: {', '.join(names)}: {problem}" for problem in problems]
        if problems:
            print(found[-len(problems) :], flush=True)
    print(f"{sequences} sequences in {time.time() - began:.0f} s: {len(found)} contradictions")
    for name, count in sorted(edits.items()):
        print(f"{count:6} {name.replace('_', ' ')}")
    return int(bool(found))


main = command(__doc__, scale, resources, soak, provenance)

if __name__ == "__main__":
    main()
