"""A parcellation: each parcel is a named set of nodes and of tetrahedra, so a solver can give it its own material."""

import numpy as np
import pyvista

import cortet
from cortet.phantoms import phantom

surface = phantom(26, subdivisions=4)  # of an atlas: fields={"aparc": "lh.aparc.annot"}
front_to_back = np.digitize(surface.points[:, 1], np.quantile(surface.points[:, 1], [0.25, 0.5, 0.75]))
made = cortet.mesh(surface, cell_size=2.5, ga=26, fields={"lobe": front_to_back.astype("int32")}, progress=False)
made.save("labels.inp", force=True)
print(*(line.strip() for line in open("labels.inp") if line.startswith(("*NSET", "*ELSET"))), sep="\n")
grid = made.to_pyvista().extract_surface(algorithm="dataset_surface").point_data_to_cell_data(categorical=True)
picture = pyvista.Plotter(off_screen=True, window_size=(800, 600))
for number, colour in enumerate(("#0072B2", "#E69F00", "#009E73", "#CC79A7")):  # colour-blind readers tell them apart
    parcel = grid.extract_cells(grid.cell_data["lobe"] == number)
    picture.add_mesh(parcel, color=colour, label=f"parcel {number}")
picture.add_legend(bcolor=None, face="rectangle", loc="lower left", size=(0.13, 0.12))
picture.add_text("lateral side, anterior on the left", font_size=9)
picture.show_bounds(xtitle="", ytitle="y (mm)", ztitle="z (mm)", show_xaxis=False, show_xlabels=False, font_size=9)
picture.view_vector((-1, 0, 0), viewup=(0, 0, 1))
picture.screenshot("labels.png")

assert set(made.mesh.point_data["lobe"]) == {0, 1, 2, 3}
