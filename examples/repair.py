"""A surface with a hole is closed, and what was done is said."""

import numpy as np

import cortet
from cortet.meshes import TriSurface
from cortet.phantoms import phantom

whole = phantom(24, subdivisions=4)
near = np.linalg.norm(whole.points - whole.points[0], axis=1) < 4
torn = TriSurface(whole.points, whole.faces[~near[whole.faces].any(axis=1)])
try:
    cortet.mesh(torn, cell_size=3.0, settings={"repair": {"enabled": False}}, progress=False)
except cortet.CortetError as error:
    print("without repair:", error)
mended, report = cortet.repair(torn)
print({key: value for key, value in report.items() if isinstance(value, int) and value})
made = cortet.mesh(mended, cell_size=3.0, ga=24, progress=False)
print(made)
made.picture("repair.png", size=(800, 600))

assert made.certified
