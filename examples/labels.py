"""A parcellation: each parcel is a named set of nodes and of tetrahedra, so a solver can give it its own material."""

import matplotlib.pyplot as plt
import numpy as np

import cortet
from cortet.phantoms import phantom

surface = phantom(26, subdivisions=4)
front_to_back = np.digitize(surface.points[:, 1], np.quantile(surface.points[:, 1], [0.25, 0.5, 0.75]))
made = cortet.mesh(surface, cell_size=2.5, ga=26, fields={"lobe": front_to_back.astype("int32")}, progress=False)
made.save("labels.inp", force=True)
print(*(line.strip() for line in open("labels.inp") if line.startswith(("*NSET", "*ELSET"))), sep="\n")
grid = made.to_pyvista().extract_surface(algorithm="dataset_surface").point_data_to_cell_data(categorical=True)
picture = grid.plot(
    scalars="lobe",
    cmap=["#0072B2", "#E69F00", "#009E73", "#CC79A7"],  # colour-blind readers tell them apart
    show_scalar_bar=False,
    off_screen=True,
    return_img=True,
    cpos="yz",
    zoom=1.4,
    window_size=(800, 600),
)
plt.imsave("labels.png", picture)

assert set(made.mesh.point_data["lobe"]) == {0, 1, 2, 3}
