"""What whole folds cost, and whether they end with the same bits on any number of threads.

    python benchmarks/fold_runs.py MESH --ga 22 --hemi L [--end 30] [--models growing braingrowth] [--threads 1 2]

Folds the mesh with each model and number of threads, each in a process of its own, kernels compiled before. Prints for
each: steps, element-steps per CPU second of the steps, CPU seconds of all, what share of these is not steps (checks at
the start, rows of the table, frames), and a hash of where every node ends. Exits with 1 if hashes of one model differ.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
from rows import in_own_process, print_row

from cortet.formats import vtu
from cortet.simulation import fold as folding
from cortet.simulation.state import Settings

COLUMNS = ("model", "threads", "tets", "steps", "element_steps_per_cpu_s", "cpu_s", "share_of_rows", "sha256")
#: weeks of the run that compiles the kernels
_SHORT = 0.02


def measure(file: Path, settings: Settings, threads: int, answer: Any) -> None:
    """Fold in this process and send back the row."""
    numba.set_num_threads(threads)
    mesh, seconds, step = vtu.read(file), 0.0, folding.advance_to

    def timed(*arguments: Any) -> bool:
        nonlocal seconds
        began = time.process_time()
        inverted = step(*arguments)
        seconds += time.process_time() - began
        return inverted

    with tempfile.TemporaryDirectory() as folder:
        short = Settings(**{**vars(settings), "end": settings.gestational_age + _SHORT})
        folding.fold(mesh, Path(folder) / "short", short, say=lambda _: None)
        folding.advance_to = timed
        began = time.process_time()
        verdict = folding.fold(mesh, Path(folder) / "run", settings, say=lambda _: None)
        cpu = time.process_time() - began
        last = vtu.read(max(Path(folder).glob("run/frames/frame_*.vtu")))
    answer.send(
        {
            "model": settings.model,
            "threads": threads,
            "tets": verdict.tets,
            "steps": verdict.steps,
            "element_steps_per_cpu_s": verdict.tets * verdict.steps / seconds,
            "cpu_s": cpu,
            "share_of_rows": 1 - seconds / cpu,
            "sha256": hashlib.sha256(last.points.tobytes()).hexdigest()[:16],
        }
    )


def main() -> None:
    """Fold and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, metavar="MESH")
    parser.add_argument("--ga", type=float, required=True, help="weeks")
    parser.add_argument("--hemi", choices=["L", "R"])
    parser.add_argument("--end", type=float, default=30.0, help="weeks")
    parser.add_argument("--models", nargs="+", default=["growing", "braingrowth"])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    args = parser.parse_args()
    print(*COLUMNS, sep="\t", flush=True)
    differ = False
    for model in args.models:
        settings = Settings(gestational_age=args.ga, hemisphere=args.hemi, end=args.end, model=model)
        rows = [in_own_process(measure, args.mesh, settings, threads) for threads in args.threads]
        for row in rows:
            print_row(COLUMNS, row)
        differ |= len({row["sha256"] for row in rows}) > 1
    sys.exit("the threads change the result" if differ else 0)


if __name__ == "__main__":
    main()
