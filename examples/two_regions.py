"""Cortex and white matter: one mesh that conforms to the pial and to the white surface."""

import numpy as np

import cortet
from cortet.phantoms import inset, phantom

pial = phantom(26)
white = inset(pial, 1.5)
made = cortet.mesh(pial, cell_size=2.5, ga=26, inner={"white": white}, progress=False)
print(made)
corners = made.points[made.cells]
volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
for number, name in enumerate(("cortex", "white matter"), start=1):
    print(f"{name}: {volumes[made.mesh.cell_data['region'] == number].sum() / 1000:.1f} mL")
made.picture("two_regions.png", size=(800, 600))

assert made.certified
