"""Whether the regular lattice of a mesh shows in its folds: two runs from one surface compared.

    python benchmarks/fold_imprint.py LATTICE_RUN OTHER_RUN --cell-size 0.8

Both are folders of `cortet fold`, the first of a `lattice` mesh of that cell size, the second of any other mesh. Prints
the gyrification index of both against age, and the correlation of what their curvature has gained, at the same place of
the unfolded surface. Then, how strongly that gain has the period of the lattice over the unfolded surface: its mean
power at the lattice's shortest reciprocal vectors over that at the same vectors turned at random (1 is no imprint), the
share of turned ones with more power, and the share of the gain's variance that waves of these vectors hold. Surface
nodes settle between those of the lattice below, and thus sample any signal with its period; so the same is printed for
the other run's gain, at the places of its own nodes and at those of the lattice's.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cortet.formats import vtu
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.meshers._lattice import CONSTANT
from cortet.meshes import FloatArray, IntArray
from cortet.report.fold_figures import series
from cortet.simulation.journal import SERIES, TABLE

_TURNS = 200
#: shortest reciprocal vectors of a body-centred cubic lattice of constant 1, over 2 pi, one of each opposite pair
_RECIPROCAL = np.array([v for v in product((-1, 0, 1), repeat=3) if np.abs(v).sum() == 2 and v > (0, 0, 0)], float)
#: weeks between the lines of the printed table
_INTERVAL = 2.0


def folded(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Places on the unfolded surface, (s, 3) mm, and the mean curvature gained there, (s,) 1/mm."""
    last = vtu.read(series(folder / SERIES)[-1][0])
    surface, nodes = boundary_surface(last)
    before = surface.points - last.point_data["displacement"][nodes]
    gained = _curvature(surface.points, surface.faces) - _curvature(before, surface.faces)
    return before, np.clip(gained, *np.percentile(gained, [1, 99]))


def _curvature(points: FloatArray, faces: IntArray) -> FloatArray:
    curvature: FloatArray = pyvista.PolyData.from_regular_faces(points, faces).curvature("mean")
    return curvature


def held(places: FloatArray, signal: FloatArray, vectors: FloatArray) -> float:
    """Share of the variance of a signal (s,) that waves of wave vectors (k, 3) hold together."""
    centred = signal - signal.mean()
    waves = np.exp(1j * places @ vectors.T)
    return float(2 * (np.abs(centred @ waves) ** 2).sum() / (len(signal) * (centred**2).sum()))


def imprint(places: FloatArray, signal: FloatArray, constant: float, seed: int = 0) -> str:
    """What the waves of a lattice hold of a signal, against those of the same lattice turned at random."""
    vectors = 2 * np.pi / constant * _RECIPROCAL
    turned = np.array(
        [held(places, signal, turn.apply(vectors)) for turn in Rotation.random(_TURNS, random_state=seed)]
    )
    ours = held(places, signal, vectors)
    return f"{ours / turned.mean():.2f} of turned ones, {(turned > ours).mean():.0%} hold more; {ours:.2%} of variance"


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs=2, type=Path, metavar="RUN")
    parser.add_argument("--cell-size", type=float, required=True, metavar="MM")
    options = parser.parse_args()
    tables = [read_tsv(run / TABLE) for run in options.runs]
    ages, indices = (
        [table[name].to_numpy(float) for table in tables] for name in ("gestational_age", "gyrification_index")
    )
    print("weeks", *options.runs, sep="\t")
    for age in np.arange(ages[0][0], min(ages[0][-1], ages[1][-1]) + 1e-9, _INTERVAL):
        print(f"{age:.1f}", *(f"{np.interp(age, *run):.4f}" for run in zip(ages, indices, strict=True)), sep="\t")
    (places, gained), (other_places, other_gained) = map(folded, options.runs)
    there = other_gained[cKDTree(other_places).query(places)[1]]
    print(f"correlation of gained curvature: {np.corrcoef(gained, there)[0, 1]:.3f}")
    constant = CONSTANT * options.cell_size
    print(f"lattice run: {imprint(places, gained, constant)}")
    print(f"other run: {imprint(other_places, other_gained, constant)}")
    print(f"other run, at the nodes of the lattice run: {imprint(places, there, constant)}")


if __name__ == "__main__":
    main()
