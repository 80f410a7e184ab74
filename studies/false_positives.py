"""Two groups of phantoms whose growth differs in one parcel: where the map finds them, and its false positives.

    python studies/false_positives.py [--subjects 10] [--permuted 200] [--end 29]

Prints for each measure the vertices with a corrected p below 0.05 within the parcel, at its rim (twice the cell size)
and elsewhere; the same of the means over parcels; and, of brains that all grow alike, in how many of the permuted
groups any vertex is below 0.05, which should be 5 %.
"""

from __future__ import annotations

import argparse
import tempfile

import numpy as np
from common_sphere import Parcels
from numpy.typing import NDArray
from population import design_of, effects
from scipy.spatial import cKDTree

import cortet
from cortet.folding.folded_surface import maps_of
from cortet.geometry.spheres import vertex_areas
from cortet.meshes import TriSurface
from cortet.phantoms import phantom_with_sphere

MEASURES = ("depth", "area_growth", "cortex_pressure", "cortex_stretch")
#: weeks at the start, cell size in mm, growth of the second group in the parcel, p
START, CELLS, REDUCED, ALPHA = 28.0, 2.5, 0.0, 0.05


def parcels(sphere: TriSurface) -> NDArray[np.int32]:
    """Four quarters of a sphere, 1 to 4."""
    return (1 + (sphere.points[:, 1] > 0) + 2 * (sphere.points[:, 2] > 0)).astype(np.int32)


def folded(seed: int, end: float, *, reduced: bool) -> dict[str, NDArray[np.float64]]:
    """Maps of a folded phantom, at the vertices that all phantoms share."""
    surface, sphere = phantom_with_sphere(START, hemisphere="L", subdivisions=4, seed=seed)
    growth = np.where(reduced & (parcels(sphere) == 4), REDUCED, 1.0)
    made = cortet.mesh(surface, cell_size=CELLS, ga=START, hemi="L", fields={"growth": growth}, progress=False)
    with tempfile.TemporaryDirectory() as folder:
        fold = cortet.fold(made, end=end, surfaces=[end], folder=folder, force=True, progress=False)
        return maps_of(fold.at(end), fold.at(START), made.surface_map())[1]


def main() -> None:
    """Fold both groups, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subjects", type=int, default=10)
    parser.add_argument("--permuted", type=int, default=200)
    parser.add_argument("--permutations", type=int, default=500)
    parser.add_argument("--end", type=float, default=29.0)
    options = parser.parse_args()
    seeds = range(options.subjects)
    alike = [folded(seed, options.end, reduced=False) for seed in seeds]
    second = [folded(seed, options.end, reduced=True) if seed % 2 else alike[seed] for seed in seeds]
    surface, sphere = phantom_with_sphere(START, hemisphere="L", subdivisions=4)
    label = parcels(sphere)
    inside = label == 4
    rim = cKDTree(surface.points[inside]).query(surface.points)[0]
    rim = np.maximum(rim, cKDTree(surface.points[~inside]).query(surface.points)[0]) < 2 * CELLS
    rows = [{"case": str(seed), "variant": "usual", "group": "ab"[seed % 2]} for seed in seeds]
    design = design_of(rows, ["group"])
    quarters = Parcels(label, {}, vertex_areas(surface))
    print(f"{options.subjects} phantoms, {START:g} to {options.end:g} weeks, {CELLS:g} mm, {len(label)} vertices")
    print(f"{'measure':<18}{'parcel':>12}{'rim':>12}{'elsewhere':>12}  parcels found  false in {options.permuted}")
    random = np.random.default_rng(0)
    groups = [random.permutation([row["group"] for row in rows]) for _ in range(options.permuted)]
    for name in MEASURES:
        values = np.stack([one[name] for one in second])
        p = effects(values, design, permutations=options.permutations, seed=0)["group[b]"][1]
        found = [
            f"{int((p[where] < ALPHA).sum())}/{int(where.sum())}" for where in (inside & ~rim, rim, ~inside & ~rim)
        ]
        means = np.array([list(quarters.means(row).values()) for row in values])
        of_means = effects(means, design, permutations=options.permutations, seed=0)["group[b]"][1]
        same, false = np.stack([one[name] for one in alike]), 0
        for names in groups:
            other = design_of([{**row, "group": one} for row, one in zip(rows, names, strict=True)], ["group"])
            false += bool((effects(same, other, permutations=100, seed=0)["group[b]"][1] < ALPHA).any())
        listed = ", ".join(str(1 + place) for place in np.flatnonzero(of_means < ALPHA)) or "none"
        print(f"{name:<18}{found[0]:>12}{found[1]:>12}{found[2]:>12}  {listed:<13}  {false}", flush=True)


if __name__ == "__main__":
    main()
