"""A cohort with broken surfaces, killed at random moments and started again, beside one that nothing disturbed.

    python benchmarks/soak.py -o FOLDER [--cases 200] [--kills 10] [--seed 0] [--cores 2]

The cases are small synthetic hemispheres. One in five is broken at random: its surface, as in `breakages.py`, or the
bytes of its file, as in `fuzz.py`. One run goes to its end. The other, in a folder of its own, is killed with
everything it started (SIGKILL), unlocked and started again as often as `--kills` says, and then left alone. At the end
both must hold the same files with the same bits, apart from logs, times and Snakemake's own notes; each case is either
certified or has its reason. Exits with 1 if not.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import yaml
from breakages import BREAKAGES
from fuzz import damaged

from cortet.cohort.lock import NAME as LOCK
from cortet.cohort.receipts import FOLDER as RECEIPTS
from cortet.cohort.sheet import Case, write_sheet
from cortet.formats.gifti import write_surface
from cortet.formats.tsv import read_tsv
from cortet.phantom import phantom

ROOT = Path(__file__).parents[1]
#: mm; a hemisphere then has some thousands of tetrahedra
CELL_SIZE = 3.0
#: what tells of the jobs, not of the results
_OF_JOBS = ("logs", "benchmarks", LOCK, RECEIPTS)
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


def command(folder: Path, sheet: Path, cores: int) -> list[str]:
    """The workflow's command line in a folder; writes its configuration there."""
    folder.mkdir(parents=True, exist_ok=True)
    config = {"cohort": {"sheet": str(sheet)}, "generate": {"cell_size": CELL_SIZE}, "fold": {"cases": []}}
    (folder / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    snakemake = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--keep-going"]
    return [*snakemake, "--cores", str(cores)]


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


def main() -> int:
    """Run both and print what became of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="default: a temporary one")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cores", type=int, default=2)
    options = parser.parse_args()
    folder = (options.output or Path(tempfile.mkdtemp())).resolve()
    sheet = make_cohort(folder, options.cases, options.seed)
    calm, disturbed = folder / "undisturbed", folder / "killed"

    began = time.monotonic()
    run(command(calm, sheet, options.cores), calm)
    seconds = time.monotonic() - began
    print(f"undisturbed: {seconds:.0f} s", flush=True)

    rng, killed = random.Random(options.seed), 0
    arguments = command(disturbed, sheet, options.cores)
    for _ in range(options.kills):
        after = rng.uniform(0, 2 * seconds / options.kills)
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


if __name__ == "__main__":
    sys.exit(main())
