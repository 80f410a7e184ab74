"""The folding simulation beside the reference implementation, on the mesh that comes with that one.

    python benchmarks/fold_reference.py [../shared/data/tallinen/sphere5.mesh] [--end 0.5] -o DIR

`sphere5.mesh` of BrainGrowth, a whole body, grows from t = 0 with the choices and the time step of the reference
(`fold.reference`). The table holds area, volume and gyrification index of the surface, the first two relative to the
start, and in parentheses how much they differ from the reference's own run. Contact is not the same in both. DIR gets
everything that a run writes, with its pictures.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

from cortet.formats import braingrowth
from cortet.formats.tsv import read_tsv
from cortet.meshes import TetMesh
from cortet.report.fold_figures import draw
from cortet.simulation.fold import fold
from cortet.simulation.growth import age_of
from cortet.simulation.journal import TABLE
from cortet.simulation.state import Settings

#: of the reference: 0.05 sqrt(rho / K) times a mesh spacing of 0.01
TIME_STEP = 0.05 * (0.01 / 5) ** 0.5 * 0.01
#: what the reference's own run of `sphere5.mesh` gave: step, area and volume relative to the start, gyrification index
REFERENCE = np.array(
    [
        (447, 1.0020033, 1.0029693, 0.99997801),
        (2236, 1.0153229, 1.0228103, 0.99996041),
        (4472, 1.032496, 1.0477636, 0.99993898),
        (8944, 1.0700889, 1.1017473, 0.99986506),
        (13416, 1.1112279, 1.1574322, 0.99981367),
        (17889, 1.1576529, 1.2116691, 1.000721),
        (22361, 1.2217931, 1.2624585, 1.0052904),
        (38013, 2.0183526, 1.5151901, 1.2274171),
        (44721, 2.5204031, 1.6679498, 1.3845045),
    ]
)


class Row(NamedTuple):
    """Our run at one moment of the reference's."""

    time: float
    #: area and volume relative to the start, and gyrification index
    values: tuple[float, float, float]
    #: how much they exceed the reference's, relative to those
    errors: tuple[float, float, float]


def comparison(mesh: TetMesh, end: float, folder: Path) -> list[Row]:
    """Run the mesh until t = `end` with the choices of the reference; a row for each of its moments until then."""
    settings = Settings(
        age_of(0.0),
        end=age_of(end),
        time_step=TIME_STEP,
        model="braingrowth",
        reference=True,
        # rows equally far apart in age are not so in time: enough of them to interpolate between
        record_interval=0.05,
    )
    fold(mesh, folder, settings)
    columns = ("time", "area_mm2", "volume_mm3", "gyrification_index")
    times, *found = (read_tsv(folder / TABLE)[name].to_numpy(float) for name in columns)
    found[:2] = [values / values[0] for values in found[:2]]
    rows = []
    for step, *expected in REFERENCE[REFERENCE[:, 0] * TIME_STEP <= end]:
        moment = float(step) * TIME_STEP
        values = [float(np.interp(moment, times, values)) for values in found]
        errors = [value / wanted - 1 for value, wanted in zip(values, expected, strict=True)]
        rows.append(Row(moment, (values[0], values[1], values[2]), (errors[0], errors[1], errors[2])))
    return rows


def main() -> None:
    """Fold the mesh and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, nargs="?", default=Path("../shared/data/tallinen/sphere5.mesh"))
    parser.add_argument("--end", type=float, default=1.0, metavar="T")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    options = parser.parse_args()
    numba.set_num_threads(1)
    began = time.process_time()
    rows = comparison(braingrowth.read(options.mesh), options.end, options.output)
    seconds = time.process_time() - began
    print("   t                 area               volume         gyrification")
    for row in rows:
        cells = (f"{value:.5f} ({error:+.1e})" for value, error in zip(row.values, row.errors, strict=True))
        print(f"{row.time:4.2f}  {'  '.join(cells)}")
    print(f"{seconds:.0f} CPU seconds")
    for path in draw(options.output, None):
        print(f"{path}: drawn")


if __name__ == "__main__":
    main()
