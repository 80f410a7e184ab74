"""A hemisphere with ventricles and a thalamus of known volumes, and the images of its labels and diffusion tensors."""

from pathlib import Path

import numpy as np
import pandas
import pyvista
from nibabel.affines import apply_affine

import cortet
from cortet.formats.gifti import write_surface
from cortet.formats.volumes import write_volume
from cortet.phantoms import inset

VOXEL = 0.5  # mm
EIGENVALUES = (1.7e-3, 0.4e-3, 0.2e-3)  # of the tensors, mm2/s
# ellipsoids in the white matter of this phantom: centre and scale, mm
BODIES = {
    "ventricle1": ((-10.979, 19.218, 4.149), 6.689),
    "ventricle2": ((-13.175, -18.114, -2.439), 6.417),
    "thalamus": ((-13.175, -2.742, 8.541), 7.106),
}

pial = cortet.phantom(24)
surfaces = {"pial": pial, "white": inset(pial, 1.5)}
for name, (centre, scale) in BODIES.items():
    ball = pyvista.Icosphere(radius=1.0, nsub=4)
    surfaces[name] = cortet.surface((centre + scale * ball.points * [0.7, 0.9, 0.7], ball.regular_faces))

# voxels around the surface; the first axis points to the left, as most scanners write it
low, high = pial.points.min(axis=0) - 2, pial.points.max(axis=0) + 2
shape = np.ceil((high - low) / VOXEL).astype(int)
affine = np.diag([-VOXEL, VOXEL, VOXEL, 1.0])
affine[:3, 3] = low + np.array([(shape[0] - 1) * VOXEL, 0, 0])
centres = apply_affine(affine, np.indices(shape).reshape(3, -1).T)

image = pyvista.ImageData(dimensions=shape, spacing=(VOXEL,) * 3, origin=low)
labels, enclosed = np.zeros(shape, np.int16), []
for number, one in enumerate(surfaces.values(), start=1):
    shell = pyvista.PolyData.from_regular_faces(one.points, one.faces)
    inside = shell.voxelize_binary_mask(reference_volume=image)["mask"] > 0
    labels[inside.reshape(shape, order="F")[::-1]] = number
    enclosed.append(shell.volume / 1000)

# the long axis of the tensors turns from front to back
angle = 0.02 * np.pi * centres[:, 1]
long = np.stack([np.sin(angle) / 2, np.cos(angle), np.full(len(centres), 0.5)], axis=1)
long /= np.linalg.norm(long, axis=1, keepdims=True)
across = np.cross(long, [1.0, 0.0, 0.0])
across /= np.linalg.norm(across, axis=1, keepdims=True)
axes = np.stack([long, across, np.cross(long, across)], axis=2)
axes[:, 0] *= -1  # FSL stores tensors along the axes of the voxels
tensors = np.einsum("nij,j,nkj->nik", axes, EIGENVALUES, axes).reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
tensors[labels.ravel() == 0] = 0

folder = Path("head")
folder.mkdir(exist_ok=True)
for name, one in surfaces.items():
    write_surface(one, folder / f"{name}.surf.gii")
write_volume(labels, affine, folder / "dseg.nii.gz")
write_volume(tensors.reshape(*shape, 6).astype(np.float32), affine, folder / "tensors.nii.gz")
names = ["cortex", *list(surfaces)[1:]]
pandas.DataFrame({"index": range(1, 6), "name": names}).to_csv(folder / "dseg.tsv", sep="\t", index=False)
within = [enclosed[1], sum(enclosed[2:]), 0, 0, 0]  # what the surfaces inside each one enclose
volume = pandas.Series(np.subtract(enclosed, within), index=names, name="volume_ml").round(3)
volume.to_csv(folder / "sizes.tsv", sep="\t", index_label="name")
print(volume.to_string())

counted = np.bincount(labels.ravel())[1:] * VOXEL**3 / 1000
assert np.allclose(counted, volume, rtol=0.01)
