"""Layers and columns of the cortex: the field of an electrode along the columns, from the pial to the white surface."""

import matplotlib.pyplot as plt
import numpy as np

import cortet
from cortet.phantoms import inset, phantom

pial = phantom(25, subdivisions=4)
white = inset(pial, 2.5)
made = cortet.mesh(pial, inner={"white": white}, cell_size=1.0, settings={"export": {"layers": 3}}, progress=False)
for layer in made.certificate.layers:
    print(f"layer {layer.number}: {layer.volume_ml:.2f} mL in {layer.tetrahedra:,} tetrahedra")

# the field of a point source 4 mm above the top, in V/m for 1 mA in a conductor of 0.33 S/m
grid = made.to_pyvista()
top = pial.points[pial.points[:, 2].argmax()]
way = made.points - top - [0, 0, 4]
field = 1e-3 / (4 * np.pi * 0.33) * way / np.linalg.norm(way, axis=1, keepdims=True) ** 3 * 1e6
along = np.einsum("nc,nc->n", field, grid.point_data["column"])
depths = np.linspace(0.05, 0.95, 19)
profiles = made.laminar_profile(along, depths, region="white")

figure, (section, profile) = plt.subplots(1, 2, figsize=(11, 6), width_ratios=(3, 2), layout="constrained")
cut = grid.slice("y", origin=top).triangulate()
x, z, triangles = cut.points[:, 0], cut.points[:, 2], cut.faces.reshape(-1, 4)[:, 1:]
cortex = cut.cell_data["region"] == 1
section.tripcolor(x, z, triangles[~cortex], facecolors=np.zeros((~cortex).sum()), cmap="Greys", vmin=-1, vmax=4)
depth = cut.point_data["depth_equivolumetric"]
section.tricontourf(
    x, z, triangles[cortex], depth, levels=[0, 1 / 3, 2 / 3, 1], colors=["#fde725", "#21918c", "#440154"]
)
paths = np.stack([surface.points for surface in made.laminar_surfaces(np.linspace(0, 1, 21))])
near = np.abs(paths[:, :, 1] - top[1]).max(axis=0) < 0.5  # columns in the plane
section.plot(paths[:, near, 0], paths[:, near, 2], color="white", linewidth=0.8)
section.set(aspect="equal", xlabel="x (mm), lateral on the left", ylabel="z (mm)")
section.set_title("three layers of equal volume, and columns")
distance = np.linalg.norm(white.points - top, axis=1)
for least, most in ((0, 5), (5, 8), (8, 12)):
    mine = profiles[(distance >= least) & (distance < most)]
    profile.plot(np.nanmedian(mine, axis=0), depths, label=f"{least} to {most} mm from the top")
profile.invert_yaxis()
profile.set(xlabel="field along the column (V/m)", ylabel="equivolumetric depth, 0 pial, 1 white")
profile.legend(frameon=False)
figure.savefig("layers.png", dpi=100)

assert made.certified and [layer.number for layer in made.certificate.layers[:3]] == [1, 2, 3]
