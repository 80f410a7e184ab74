"""Growth rate and stiffness of the core that fit real brains best, on the ages up to 34 weeks.

    python benchmarks/fold_fit.py MESH --ga 22 --hemi L [--rates 1.4 1.829 2.3] [--stiffness 0.7 1.167 2] -o DIR

Folds the mesh with each pair of `fold.growth_rate` and `fold.core_stiffness` and compares its gyrification index and
its area over volume^(2/3), at their ages, with those of healthy fetal brains (`cortet/report/data/real_brains.tsv`).
The misfit is the root mean square of the relative differences. Newborns' brains of the same ages take no part in the
choice: the table shows how far from them each pair is, as a test. A run that is in DIR already is not made again.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path

import numba
import numpy as np
import pandas as pd

from cortet.formats import vtu
from cortet.formats.tsv import read_tsv
from cortet.mesh import TetMesh
from cortet.report import published
from cortet.simulation.fold import fold
from cortet.simulation.journal import TABLE, VERDICT
from cortet.simulation.state import Settings

#: ages that judge the fit end here, weeks
LAST = 34.0


def curves(table: Path) -> pd.DataFrame:
    """Gestational age, gyrification index and area over volume^(2/3) of a run."""
    rows = read_tsv(table).apply(pd.to_numeric, errors="coerce")
    rows["relative_area"] = rows["area_mm2"] / rows["volume_mm3"] ** (2 / 3)
    return rows[["gestational_age", "gyrification_index", "relative_area"]]


def real(born: bool) -> pd.DataFrame:
    """The same of real hemispheres until the last age, fetal ones or newborns'."""
    brains = published.healthy_hemispheres().rename(columns={"gestational_age_weeks": "gestational_age"})
    brains = brains.assign(relative_area=brains["area_cm2"] / brains["volume_ml"] ** (2 / 3))
    return brains[(brains["gestational_age"] <= LAST) & (brains["source"].str.startswith("dHCP") == born)]


def misfits(run: pd.DataFrame, brains: pd.DataFrame) -> tuple[float, float]:
    """Root mean square relative difference of the gyrification index, and of area over volume^(2/3)."""
    found = []
    for column in ("gyrification_index", "relative_area"):
        simulated = np.interp(brains["gestational_age"], run["gestational_age"], run[column])
        found.append(float(np.sqrt(((simulated / brains[column] - 1) ** 2).mean())))
    return found[0], found[1]


def folded(mesh: TetMesh, folder: Path, settings: Settings) -> pd.DataFrame:
    """The curves of a run, which is made unless its verdict is there."""
    if not (folder / VERDICT).exists():
        fold(mesh, folder, settings)
    return curves(folder / TABLE)


def main() -> None:
    """Fold with each pair and print the table, the best pair last."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--ga", type=float, required=True, metavar="WEEKS")
    parser.add_argument("--hemi", choices=["L", "R"], required=True)
    parser.add_argument("--rates", nargs="+", type=float, default=[1.4, 1.829, 2.3])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[0.7, 1.167, 2.0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    options = parser.parse_args()
    numba.set_num_threads(1)
    mesh, fetal, newborn = vtu.read(options.mesh), real(born=False), real(born=True)
    print(f"{len(fetal)} fetal and {len(newborn)} newborn hemispheres; misfits of index and of area/volume^(2/3)")
    print(" rate  core   fetal: index   area    both   newborn: index   area  spacing")
    best = (np.inf, 0.0, 0.0)
    for rate, stiffness in product(options.rates, options.stiffness):
        folder = options.output / f"rate{rate:g}_core{stiffness:g}"
        settings = Settings(
            options.ga, options.hemi, end=LAST, model="braingrowth", growth_rate=rate, core_stiffness=stiffness
        )
        run = folded(mesh, folder, settings)
        ours, theirs = misfits(run, fetal), misfits(run, newborn)
        both = float(np.hypot(*ours) / np.sqrt(2))
        best = min(best, (both, rate, stiffness))
        spacing = float(read_tsv(folder / TABLE)["fold_spacing_mm"].iloc[-1])
        print(
            f"{rate:5.3f} {stiffness:5.3f} {ours[0]:14.4f} {ours[1]:6.4f} {both:7.4f}"
            f" {theirs[0]:16.4f} {theirs[1]:6.4f} {spacing:8.1f}",
            flush=True,
        )
    print(f"best: growth_rate {best[1]:g}, core_stiffness {best[2]:g}, misfit {best[0]:.4f}")


if __name__ == "__main__":
    main()
