"""Growth that was measured between two ages, and the brain that follows from it."""

import shutil

import numpy as np

import cortet
from cortet.folding.fold_figures import draw
from cortet.phantoms import phantom

early, later = phantom(26, subdivisions=4), phantom(28, subdivisions=4)  # their vertices correspond
fields, found = cortet.growth(early, later, ages=(26, 28))
print(f"the area grows by {found.area_ratio:.3f}; nine spots in ten by", end=" ")
print(f"{found.percentiles['5']:.2f} to {found.percentiles['95']:.2f}")
made = cortet.mesh(early, cell_size=3.0, ga=26, hemi="L", fields=fields, progress=False)
folded = cortet.fold(made, end=28, force=True, progress=False)  # cells are coarse, to be quick
print(folded.verdict["reason"])
draw(folded.folder, "L")
shutil.copy(folded.folder / "folded.png", "growth_map.png")

assert folded.verdict["outcome"] == "folded" and np.isfinite(folded.table["area_mm2"]).all()
