"""Two contacts on the cortex: the current between them, and how much of a dipole along a column they see, by layer.

python electrodes.py [PIAL WHITE]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import skfem
from skfem.helpers import dot, grad

import cortet
from cortet.phantoms import inset, phantom

CONDUCTIVITY = {"cortex": 0.33e-3, "white": 0.14e-3}  # S/mm

if sys.argv[1:]:
    pial, white = (cortet.surface(file) for file in sys.argv[1:])
else:
    pial = phantom(25, subdivisions=4)
    white = inset(pial, 2.5)
top = pial.points[pial.points[:, 2].argmax()]
x, y, z = top.tolist()
contacts = {"A1": (x, y - 4, z, 1.15), "A2": (x, y + 4, z, 1.15)}  # 2.3 mm wide, 8 mm apart
made = cortet.mesh(
    pial,
    inner={"white": white},
    electrodes=contacts,
    cell_size=1.0,
    settings={"export": {"layers": 4}},
    progress=False,
)
print(made.electrodes()[["name", "moved_mm", "area_mm2", "nominal_area_mm2", "faces", "radius_over_edge"]])

grid = made.to_pyvista()
volumes = grid.compute_cell_sizes()["Volume"]
conductivity = np.array([CONDUCTIVITY[name] for name in made.regions])[grid.cell_data["region"] - 1]


@skfem.BilinearForm
def conduction(u, v, w):
    """The current that a potential u drives, against v."""
    return w.conductivity * dot(grad(u), grad(v))


tetrahedra = skfem.MeshTet(np.ascontiguousarray(made.points.T), np.ascontiguousarray(made.cells.T))
basis = skfem.Basis(tetrahedra, skfem.ElementTetP1(), intorder=0)
matrix = conduction.assemble(basis, conductivity=conductivity[:, None])

# the fields of the contacts are the right-hand side: 1 A in through A1, out through A2
current = grid.point_data["electrode_A1"] - grid.point_data["electrode_A2"]
solver = skfem.solver_iter_pcg(rtol=1e-9)
potential = skfem.solve(*skfem.condense(matrix, current, D=np.array([0])), solver=solver)
resistance = current @ potential

# reciprocity: a dipole of 1 nA m along the column shows as this many microvolts between the contacts
field = -basis.interpolate(potential).grad[:, :, 0].T
seen = 1e-9 * 1e3 * 1e6 * np.abs(np.einsum("mc,mc->m", field, grid.cell_data["column"]))
layers = [grid.cell_data["layer"] == number for number in (1, 2, 3, 4)]
means = [np.average(seen[one], weights=volumes[one]) for one in layers]
print(f"{resistance:.0f} ohm;", ", ".join(f"layer {n}: {one:.3f} uV" for n, one in enumerate(means, 1)))

figure, (section, profile) = plt.subplots(1, 2, figsize=(11, 5), width_ratios=(3, 2), layout="constrained")
grid.cell_data["seen"] = seen
cut = grid.slice("x", origin=top).triangulate()
across, height, triangles = cut.points[:, 1], cut.points[:, 2], cut.faces.reshape(-1, 4)[:, 1:]
cortex = cut.cell_data["region"] == 1
section.tripcolor(
    across, height, triangles[~cortex], facecolors=np.zeros((~cortex).sum()), cmap="Greys", vmin=-1, vmax=4
)
levels = np.log10(np.maximum(cut.cell_data["seen"][cortex], 1e-6))
drawn = section.tripcolor(across, height, triangles[cortex], facecolors=levels, cmap="viridis", vmin=-0.5, vmax=2)
for name, (_, at, above, radius) in contacts.items():
    section.plot([at - radius, at + radius], [above + 0.4] * 2, color="#d62728", linewidth=4)
    section.annotate(name, (at, above + 1.2), ha="center")
section.set(aspect="equal", xlim=top[1] + [-14, 14], ylim=top[2] + [-14, 3])
section.set(xlabel="y (mm), anterior on the right", ylabel="z (mm)")
figure.colorbar(drawn, label="log10 of the potential (uV)", shrink=0.8)
away = np.abs(made.points[made.cells].mean(axis=1) - made.certificate.electrodes[0].location_mm)
below = np.linalg.norm(away, axis=1)
for most in (3, 5, 8):
    near = [one & (below < most) for one in layers]
    profile.plot([np.average(seen[one], weights=volumes[one]) for one in near], (1, 2, 3, 4), "o-", label=f"{most} mm")
profile.invert_yaxis()
profile.set(xlabel="mean potential (uV) of 1 nA m along the column", ylabel="layer, 1 pial", yticks=(1, 2, 3, 4))
profile.legend(title="up to, from A1", frameon=False, loc=(0.4, 0.6))
figure.savefig("electrodes.png", dpi=100)

assert made.certified and means[0] > means[3]
