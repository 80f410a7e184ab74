"""Small cells where they matter: a size in mm at each vertex of the surface."""

import matplotlib.pyplot as plt
import numpy as np

import cortet
from cortet.phantoms import phantom

surface = phantom(24, subdivisions=4)
front = surface.points[:, 1] > np.quantile(surface.points[:, 1], 0.7)
sizes = np.where(front, 1.2, 3.0)
settings = {"generate": {"size_field": "size"}}
made = cortet.mesh(surface, cell_size=3.0, ga=24, fields={"size": sizes}, settings=settings, progress=False)
centres = made.points[made.cells].mean(axis=1)[:, 1]
limit = surface.points[front, 1].min()
print(f"{(centres > limit).sum():,} tetrahedra in front of the limit, {(centres <= limit).sum():,} behind it")
skin = made.to_pyvista().extract_surface(algorithm="dataset_surface")
picture = skin.plot(
    show_edges=True,
    scalar_bar_args={"title": "cell size (mm)", "n_labels": 2, "fmt": "%.1f"},
    off_screen=True,
    return_img=True,
    cpos="yz",
    zoom=1.4,
    window_size=(800, 600),
)
plt.imsave("size_field.png", picture)

assert made.certified and (centres > limit).mean() > 0.5
