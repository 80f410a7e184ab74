"""The certificate judges any mesh: here one of Delaunay tetrahedra, and ours, of the same ball."""

import numpy as np
import pyvista
from scipy.spatial import Delaunay

import cortet
from cortet.meshes import TetMesh
from cortet.report.render import picture

ball = pyvista.Icosphere(radius=20, nsub=3)
inside = np.random.default_rng(1).uniform(-13, 13, (1500, 3))
points = np.concatenate([ball.points, inside[np.linalg.norm(inside, axis=1) < 18]])
cells = Delaunay(points).simplices
volumes = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]])
other = TetMesh(points, np.where(volumes[:, None] > 0, cells, cells[:, [0, 2, 1, 3]]))
ours = cortet.mesh(ball, cell_size=3.0, progress=False)

print(cortet.certify(other, ball, cell_size=3.0).reasons[0])
for name, made in {"delaunay": other, "cortet": ours}.items():
    found = cortet.certify(made, ball, cell_size=3.0).quality
    print(f"{name}: {found.tets} tetrahedra, worst q {found.q.max:.3f}, mean q {found.q.mean:.3f}")
picture(other, "other_mesher.png", size=(800, 600))

assert ours.certified and not cortet.certify(other, ball, cell_size=3.0).certified
