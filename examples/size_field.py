"""Small cells where they matter: a size in mm at each vertex of the surface."""

import numpy as np
import pyvista

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
picture = pyvista.Plotter(off_screen=True, window_size=(800, 600))
legend = {"title": "cell size (mm)", "n_labels": 2, "fmt": "%.1f"}
picture.add_mesh(skin, scalars="size", show_edges=True, scalar_bar_args=legend)
picture.add_text("lateral side, anterior on the left", font_size=9)
picture.show_bounds(xtitle="", ytitle="y (mm)", ztitle="z (mm)", show_xaxis=False, show_xlabels=False, font_size=9)
picture.view_vector((-1, 0, 0), viewup=(0, 0, 1))
picture.screenshot("size_field.png")

assert made.certified and (centres > limit).mean() > 0.5
