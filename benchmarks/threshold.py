"""What a lower threshold of S4+ costs: worst q, what is left above 0.3, and CPU seconds of the default line.

python benchmarks/threshold.py SURFACE... [--cell-size 0.6] [--thresholds 0.335 0.3 0.28]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from rows import in_own_process, print_row

from cortet.config import load
from cortet.formats.gifti import read_surface
from cortet.pipeline import mesh_surface, warm_up

COLUMNS = ("surface", "cell_size_mm", "threshold", "tets", "q_max", "q_mean", "above_0.3", "certified", "cpu_seconds")


def measure(file: Path, cell_size: float, threshold: float, answer) -> None:  # type: ignore[no-untyped-def]
    """Run the line in this process and send back the row of its mesh."""
    warm_up()
    began = time.process_time()
    config = load({"generate": {"cell_size": cell_size}, "reconnect": {"threshold": threshold}})
    certificate = mesh_surface(read_surface(file), config, source=file).certificate
    found = certificate.quality
    answer.send(
        {
            "surface": file.name.removesuffix(".surf.gii"),
            "cell_size_mm": cell_size,
            "threshold": threshold,
            "tets": found.tets,
            "q_max": round(found.q.max, 4),
            "q_mean": round(found.q.mean, 4),
            "above_0.3": found.count_above["0.3"],
            "certified": certificate.certified,
            "cpu_seconds": round(time.process_time() - began, 1),
        }
    )


def main() -> None:
    """Print a row per surface and threshold."""
    line = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    line.add_argument("surfaces", nargs="+", type=Path, metavar="SURFACE")
    line.add_argument("--cell-size", type=float, default=0.6)
    line.add_argument("--thresholds", type=float, nargs="+", default=[0.335, 0.3, 0.28])
    args = line.parse_args()
    print(*COLUMNS, sep="\t")
    for file in args.surfaces:
        for threshold in args.thresholds:
            print_row(COLUMNS, in_own_process(measure, file, args.cell_size, threshold))


if __name__ == "__main__":
    main()
