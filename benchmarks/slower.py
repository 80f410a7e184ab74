"""What became slower since another commit?

    python benchmarks/slower.py [COMMIT] [--runs 3] [--cell-size 1.2] [--limit 1.2]

Measures this checkout and a copy of COMMIT (the last one, if none is given) by turns, in CPU seconds: every stage of
the line on a phantom, a week of folding on its mesh, writing and reading it in each format, and a case of the workflow
from the sheet to its page. The least of all runs counts, since other work on the machine only adds. Kernels are
compiled before. Prints a row for each, and at the end what takes more than `--limit` times as long as before; then it
exits with 1.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from rows import print_row

HERE = Path(__file__).parents[1]
COLUMNS = ("what", "before_cpu_s", "now_cpu_s", "ratio")
#: shorter times than this are mostly chance, s
_LEAST = 0.05

#: what each checkout runs in a folder of its own; it uses only what both of them have
MEASURE = """
import json, resource, subprocess, sys, time
from pathlib import Path
from cortet.cohort.sheet import Case, write_sheet
from cortet.config import load
from cortet.formats import FORMATS
from cortet.formats.gifti import write_surface
from cortet.phantom import phantom
from cortet.pipeline import run
from cortet.solver_files.export import write
from cortet.solver_files.sets import named_sets

cell_size, folder = float(sys.argv[1]), Path(sys.argv[2])
surface = phantom(30.0, subdivisions=5)
for size in (4.0, cell_size):  # the first compiles
    config, seconds, last = load({"generate": {"cell_size": size}}), {}, time.process_time()
    for step in run(surface, config):
        now = time.process_time()
        seconds["stage " + step.stage], last, mesh = now - last, now, step.result
mesh = named_sets(mesh)
for name, form in FORMATS.items():
    if not form.is_surface:
        last = time.process_time()
        write(mesh, folder / f"m{form.suffix}", solver=name)
        form.read(folder / f"m{form.suffix}")
        seconds["format " + name] = time.process_time() - last

def of_children(command, **more):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

cortet = [sys.executable, "-m", "cortet.cli"]
fold = [*cortet, "fold", str(folder / "m.vtu"), "--ga", "30", "-o", str(folder / "folded"), "--end"]
of_children([*fold, "30.05"])  # compiles
seconds["fold a week"] = of_children([*fold, "31", "--force"])
write_sheet([Case("phantom", None, "L", 30.0, "phantom")], folder / "cohort.tsv")
(folder / "config.yaml").write_text(json.dumps({"cohort": {"sheet": "cohort.tsv"}, "generate": {"cell_size": [4.0]}}))
snakemake = [sys.executable, "-m", "snakemake", "--snakefile", sys.argv[3] + "/Snakefile", "--cores", "1"]
seconds["workflow, a case"] = of_children(snakemake, cwd=folder)
print(json.dumps(seconds))
"""


def measured(checkout: Path, cell_size: float) -> dict[str, float]:
    """CPU seconds of all that a checkout does, by name."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", MEASURE, str(cell_size), folder, str(checkout)],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr.strip()[-2000:]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def least(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """The smaller of two times of everything."""
    return {name: min(seconds, second.get(name, seconds)) for name, seconds in {**second, **first}.items()}


def slower(before: Mapping[str, float], now: Mapping[str, float], limit: float) -> list[str]:
    """What takes more than `limit` times as long as before, the worst first."""
    ratios = {name: now[name] / before[name] for name in before if name in now and before[name] >= _LEAST}
    return sorted((name for name, ratio in ratios.items() if ratio > limit), key=lambda name: -ratios[name])


def main() -> None:
    """Measure both and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", nargs="?", default="HEAD")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--cell-size", type=float, default=1.2, help="mm")
    parser.add_argument("--limit", type=float, default=1.2)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "before"
        subprocess.run(["git", "-C", HERE, "worktree", "add", "--quiet", "--detach", other, args.commit], check=True)
        try:
            before, now = measured(other, args.cell_size), measured(HERE, args.cell_size)
            for _ in range(args.runs - 1):
                before = least(before, measured(other, args.cell_size))
                now = least(now, measured(HERE, args.cell_size))
        finally:
            subprocess.run(["git", "-C", HERE, "worktree", "remove", "--force", other], check=True)
    print(*COLUMNS, sep="\t")
    for name, seconds in now.items():
        ratio = seconds / before[name] if before.get(name) else ""
        print_row(COLUMNS, dict(zip(COLUMNS, (name, before.get(name, ""), seconds, ratio), strict=True)))
    if found := slower(before, now, args.limit):
        sys.exit(f"more than {args.limit:g} times as slow as {args.commit}: {', '.join(found)}")


if __name__ == "__main__":
    main()
