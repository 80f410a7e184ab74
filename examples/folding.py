"""A brain that folds, in a minute: coarse cells and a thick cortex, so that they fit."""

import matplotlib.pyplot as plt

import cortet
from cortet.phantoms import phantom

made = cortet.mesh(phantom(22, subdivisions=4), cell_size=2.0, ga=22, hemi="L", progress=False)
folded = cortet.fold(made, end=25, thickness=3.0, progress=False)
columns = ["gestational_age", "volume_mm3", "area_mm2", "gyrification_index", "min_j"]
print(folded.table[columns].iloc[[0, -1]].round(2).to_string(index=False))
plt.imsave("folding.png", folded.plot())

assert folded.verdict["outcome"] == "folded"
assert folded.table["area_mm2"].iloc[-1] > 1.2 * folded.table["area_mm2"].iloc[0]
