"""Calibration of the growing model: how far a run is from its targets, and how well these determine each parameter.

    python benchmarks/fold_fit.py MESH --ga 22 --hemi L -o DIR [--step 0.15] [--end 36] [--base core_stiffness=0.25 ...]

Folds the mesh with the constants of the model (or those of --base), and once more with each of them larger by a
share. Targets are volume and area of usual hemispheres, from those of the mesh on, the thickness and the width of real
folds, every second week. The first table has what runs miss of them, root mean square, in standard errors and in per
cent. The second has what one standard error of all targets leaves of each parameter (the inverse of the Gauss-Newton
matrix), and which target it follows most. Gyrification index, depth, hull and extents are no targets:
`fold_weeks.py` compares them. A run that is in DIR already is not made again.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pandas as pd

from cortet.formats import vtu
from cortet.formats.tsv import read_tsv
from cortet.meshes import FloatArray, TetMesh
from cortet.simulation.fold import fold
from cortet.simulation.growth import AREA, VOLUME, usual
from cortet.simulation.journal import TABLE, VERDICT
from cortet.simulation.models import CONSTANTS
from cortet.simulation.state import Settings

#: parameters that are calibrated
PARAMETERS = ("growth_rate", "core_stiffness", "thickness", "thickness_rate")
#: weeks that are compared, and from when on there are folds whose width can be
WEEKS, FOLDED = np.arange(24.0, 39.0, 2.0), 28.0


class Target(NamedTuple):
    """What a column of the table of a run should be at each week."""

    column: str
    values: FloatArray
    #: standard error of what real brains say of it, relative
    error: float


def targets(rows: pd.DataFrame, weeks: FloatArray) -> list[Target]:
    """The targets of a run, by its first row."""
    start = rows["gestational_age"].iloc[:1].to_numpy()

    def grown(column: str, law: tuple[float, float, float]) -> FloatArray:
        return float(rows[column].iloc[0]) * usual(law, weeks) / usual(law, start)

    width = np.where(weeks >= FOLDED, 12.0, np.nan)  # all folded brains: Heuer et al. 2019
    return [
        Target("volume_mm3", grown("volume_mm3", VOLUME), 0.07),
        Target("area_mm2", grown("area_mm2", AREA), 0.05),
        Target("cortical_thickness_mm", np.full(len(weeks), 1.1), 0.05),
        Target("fold_spacing_mm", width, 0.08),
    ]


def misses(rows: pd.DataFrame) -> dict[str, FloatArray]:
    """What a run misses of each target at each week that it has reached, in standard errors."""
    ages = rows["gestational_age"].to_numpy()
    weeks = WEEKS[(ages[0] + 1 < WEEKS) & (ages[-1] + 1e-6 >= WEEKS)]
    found = {}
    for target in targets(rows, weeks):
        simulated = np.interp(weeks, ages, rows[target.column].to_numpy())
        missed = (simulated / target.values - 1) / target.error
        found[target.column] = missed[np.isfinite(missed)]
    return found


def determined(base: FloatArray, stepped: FloatArray, step: float) -> FloatArray:
    """Standard error of each of p parameters, relative, if each of n targets is one standard error uncertain.

    Parameters
    ----------
    base, stepped : misses (n,) of the run with the constants, and (p, n) with each parameter larger by a share `step`
    """
    slopes = (stepped - base) / step
    return np.asarray(np.sqrt(np.diag(np.linalg.pinv(slopes @ slopes.T))))


def run(mesh: TetMesh, folder: Path, settings: Settings) -> pd.DataFrame:
    """The table of a run, which is made unless its verdict is there."""
    if not (folder / VERDICT).exists():
        fold(mesh, folder, settings)
    return read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce")


def main() -> None:
    """Make the runs that are missing and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--ga", type=float, required=True, metavar="WEEKS")
    parser.add_argument("--hemi", choices=["L", "R"], required=True)
    parser.add_argument("--end", type=float, default=36.0, metavar="WEEKS")
    parser.add_argument("--step", type=float, default=0.15, help="share by which each parameter is larger")
    parser.add_argument("--base", nargs="*", default=[], metavar="NAME=VALUE", help="instead of the model's constants")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    options = parser.parse_args()
    numba.set_num_threads(1)
    mesh = vtu.read(options.mesh)
    given = {name: float(value) for name, value in (pair.split("=") for pair in options.base)}
    base: dict[str, Any] = {name: getattr(CONSTANTS["growing"], name) for name in PARAMETERS} | given
    common = Settings(options.ga, options.hemi, end=options.end, record_interval=0.25)
    found = {"base": misses(run(mesh, options.output / "base", replace(common, **base)))}
    print("run                       misses in standard errors (and in % of the target):  " + "  ".join(found["base"]))
    for name in ("base", *PARAMETERS):
        changed = {} if name == "base" else {name: base[name] * (1 + options.step)}
        label = name if name == "base" else f"{name}={changed[name]:.4g}"
        rows = run(mesh, options.output / label, replace(common, **(base | changed)))
        found[name] = misses(rows)
        errors = {target.column: target.error for target in targets(rows, WEEKS)}
        rms = {column: float(np.sqrt((missed**2).mean())) for column, missed in found[name].items()}
        print(f"{label:26s}" + "  ".join(f"{rms[c]:5.2f} ({100 * rms[c] * errors[c]:4.1f} %)" for c in rms), flush=True)
    flat = {name: np.concatenate(list(missed.values())) for name, missed in found.items()}
    left = determined(flat["base"], np.array([flat[name] for name in PARAMETERS]), options.step)
    print("\nparameter         value   standard error   moves most, per 10 % of it")
    for name, error in zip(PARAMETERS, left, strict=True):
        moved = {c: float((found[name][c] - found["base"][c]).mean()) * 0.1 / options.step for c in found["base"]}
        column = max(moved, key=lambda c: abs(moved[c]))
        print(f"{name:16s} {base[name]:7.4g} {abs(error * base[name]):10.2g} ({100 * error:4.1f} %)   "
              f"{column} by {moved[column]:+.2f} standard errors")  # fmt: skip


if __name__ == "__main__":
    main()
