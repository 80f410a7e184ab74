"""What a solver sees in a file besides the mesh: format rules, sign of volumes, line numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from cortet.meshes import TetMesh


@dataclass(frozen=True)
class AsRead:
    """A solver file as its solver sees it. Volumes are positive if the file keeps the solver's sign convention."""

    mesh: TetMesh
    #: rules of this format that the file breaks
    problems: list[str] = field(default_factory=list)
    #: sign that volumes must have in the file, for messages
    sign: str = "positive"
    #: whether the format lists boundary faces
    lists_faces: bool = True
    #: whether it lists the nodes of these faces, so that each face has a direction
    directs_faces: bool = True
    #: location of tetrahedron or face i in the file, in words
    cell: Callable[[int], str] = lambda index: f"is number {index + 1}"
    face: Callable[[int], str] = lambda index: f"is number {index + 1}"
