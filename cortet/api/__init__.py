"""cortet in a few calls, from files or arrays to results.

Surfaces may be files, NiBabel images, meshes of PyVista or trimesh, or pairs of arrays. Nothing is written unless a
result is saved. The command line and the workflow do the same with files.
"""

from cortet.api.checking import certify, repair
from cortet.api.files import convert, improve, read
from cortet.api.given import surface
from cortet.api.meshing import Mesh, mesh

__all__ = ["Mesh", "certify", "convert", "improve", "mesh", "read", "repair", "surface"]
