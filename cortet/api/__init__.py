"""cortet in a few calls, `mesh`, `certify`, `repair`, `compare`, from files or arrays to results.

Surfaces may be files, NiBabel images, meshes of PyVista or trimesh, or pairs of arrays. Nothing is written unless a
result is saved. The command line and the workflow do the same with files.
"""

from cortet.api.checking import certify, compare, repair
from cortet.api.given import surface
from cortet.api.meshing import Mesh, mesh

__all__ = ["Mesh", "certify", "compare", "mesh", "repair", "surface"]
