"""The folding simulation on the mesh that comes with the reference implementation, with that one's time step.

    python benchmarks/fold_reference.py [../shared/data/tallinen/sphere5.mesh] -o DIR

`sphere5.mesh` of BrainGrowth is a whole body, so there is no medial plane; its unit of length is its own. It grows from
t = 0 to t = 1. The table holds the gyrification index and the area of the surface, relative to the start, against t;
DIR gets everything that a run writes, with its pictures.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numba

from cortet.formats import braingrowth
from cortet.formats.tsv import read_tsv
from cortet.report.fold_figures import draw
from cortet.simulation.body import Material, stable_time_step
from cortet.simulation.fold import TABLE, fold
from cortet.simulation.growth import age_of
from cortet.simulation.run import Settings

#: mesh spacing that the reference's time step is made for, in units of the body's radius
_SPACING = 0.01
#: rows of the printed table
_ROWS = 20


def main() -> None:
    """Fold the mesh and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, nargs="?", default=Path("../shared/data/tallinen/sphere5.mesh"))
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    options = parser.parse_args()
    numba.set_num_threads(1)
    settings = Settings(age_of(0.0), end=age_of(1.0), time_step=stable_time_step(_SPACING, Material()))
    began = time.process_time()
    verdict = fold(braingrowth.read(options.mesh), options.output, settings)
    seconds = time.process_time() - began
    rows = read_tsv(options.output / TABLE).to_dict("records")
    print("    t  weeks  gyrification   area  volume  min J   q_max  inverted  degenerate  contacts")
    for row in [*rows[: -1 : max(len(rows) // _ROWS, 1)], rows[-1]]:
        area, volume = (float(row[name]) / float(rows[0][name]) for name in ("area_mm2", "volume_mm3"))
        print(
            f"{float(row['time']):5.3f}  {float(row['gestational_age']):5.2f}  {float(row['gyrification_index']):12.4f}"
            f"  {area:5.3f}  {volume:6.3f}  {float(row['min_j']):5.3f}  {float(row['q_max']):6.4f}"
            f"  {row['inverted']:>8}  {row['degenerate']:>10}  {row['contacts']:>8}"
        )
    print(f"{verdict.reason}; {verdict.degenerate} entries into the degenerate branch; {seconds:.0f} CPU seconds")
    for path in draw(options.output, None):
        print(f"{path}: drawn")


if __name__ == "__main__":
    main()
