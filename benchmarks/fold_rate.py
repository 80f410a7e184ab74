"""Whether growth is slow enough: one fold at the rate of the model, and at slower ones.

    python benchmarks/fold_rate.py MESH --ga 22 --hemi L [--end 34] [--slower 1 2 4]

A brain folds in weeks, and its tissue is at rest at every moment. The body of the simulation has mass and damping, and
grows much faster. Where a slower growth ends with the same brain, mass and damping do not matter. Each run is in a
process of its own and stretches the time of the simulation by a factor; ages stay what they are. Prints for each:
steps, CPU seconds, the largest kinetic over elastic energy, and what the brain is like at the end.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
from rows import in_own_process, print_row

from cortet.formats import vtu
from cortet.formats.tsv import read_tsv
from cortet.simulation import growth
from cortet.simulation.fold import fold
from cortet.simulation.journal import TABLE
from cortet.simulation.state import Settings

#: of the table of a fold, in its units
MEASURED = ("gyrification_index", "area_mm2", "volume_mm3", "fold_spacing_mm", "sulcal_depth_mm", "q_max")
COLUMNS = ("slower", "tets", "steps", "cpu_s", "kinetic_over_elastic", *MEASURED)


def measure(file: Path, slower: float, settings: Settings, answer: Any) -> None:
    """Fold in this process and send back the row."""
    numba.set_num_threads(1)
    growth._TIME = tuple(slower * coefficient for coefficient in growth._TIME)  # type: ignore[assignment]
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        verdict = fold(vtu.read(file), Path(folder), settings, say=lambda _: None)
        cpu = time.process_time() - began
        table = read_tsv(Path(folder) / TABLE).replace("n/a", "nan").astype(float)
    later = table[table["gestational_age"] >= settings.gestational_age + 1]  # the first week begins without energy
    row = {"slower": slower, "tets": verdict.tets, "steps": verdict.steps, "cpu_s": cpu}
    ratio = {"kinetic_over_elastic": (later["kinetic_energy"] / later["elastic_energy"]).max()}
    answer.send(row | ratio | table.iloc[-1][list(MEASURED)].to_dict())


def main() -> None:
    """Fold and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, metavar="MESH")
    parser.add_argument("--ga", type=float, required=True, help="weeks")
    parser.add_argument("--hemi", choices=["L", "R"])
    parser.add_argument("--end", type=float, default=34.0, help="weeks")
    parser.add_argument("--slower", nargs="+", type=float, default=[1.0, 2.0, 4.0])
    args = parser.parse_args()
    settings = Settings(gestational_age=args.ga, hemisphere=args.hemi, end=args.end)
    print(*COLUMNS, sep="\t", flush=True)
    for slower in args.slower:
        print_row(COLUMNS, in_own_process(measure, args.mesh, slower, settings))


if __name__ == "__main__":
    main()
