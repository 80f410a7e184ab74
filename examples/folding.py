"""A brain that folds, in a minute: coarse cells and a thick cortex, so that they fit."""

import shutil

import cortet
from cortet.folding.fold_figures import draw
from cortet.phantoms import phantom

made = cortet.mesh(phantom(28), cell_size=1.4, ga=28, hemi="L", progress=False)
folded = cortet.fold(made, end=34, thickness=2.5, progress=False)
columns = ["gestational_age", "volume_mm3", "area_mm2", "gyrification_index", "min_j"]
print(folded.table[columns].iloc[[0, -1]].round(2).to_string(index=False))
draw(folded.folder, "L")  # pictures and a film; one of them is for the gallery
shutil.copy(folded.folder / "folded.png", "folding.png")

assert folded.verdict["outcome"] == "folded"
assert folded.table["area_mm2"].iloc[-1] > 1.2 * folded.table["area_mm2"].iloc[0]
