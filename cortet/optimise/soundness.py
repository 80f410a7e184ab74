"""Requirements on a mesh before any optimisation."""

from __future__ import annotations

import numpy as np

from cortet.errors import StageError, counted
from cortet.geometry.filling import folded_faces
from cortet.meshes import FloatArray, TetMesh


def require_sound(mesh: TetMesh, q: FloatArray) -> None:
    """Refuse a mesh with flat or inverted tetrahedra, or one that overlaps itself.

    No move improves a flat tetrahedron. Swaps never end around a face with both its tetrahedra on one side.
    """
    if not q.max() < 1:
        raise StageError(
            f"{counted(np.count_nonzero(~(q < 1)), 'tetrahedron is', 'tetrahedra are')} flat or inverted "
            "before optimisation",
            remedy="see the report of the previous stage",
        )
    if folded := folded_faces(mesh):
        raise StageError(
            f"tetrahedra overlap before optimisation: {counted(folded, 'face has', 'faces have')} both "
            "tetrahedra on the same side",
            remedy="see the report of the previous stage, or check the program that made the mesh",
        )
