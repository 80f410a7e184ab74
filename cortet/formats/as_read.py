"""What a solver sees in a file besides the mesh: the rules of its format, its sign of volumes, its line numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from cortet.mesh import TetMesh


@dataclass(frozen=True)
class AsRead:
    """A solver file as its solver sees it: with positive volumes where it keeps the solver's convention of sign."""

    mesh: TetMesh
    #: rules of this format alone that it breaks
    problems: list[str] = field(default_factory=list)
    #: sign of volumes that the file must have, for the message
    sign: str = "positive"
    #: whether the format lists boundary faces
    lists_faces: bool = True
    #: whether it lists their nodes, so that a face has a direction of its own
    directs_faces: bool = True
    #: in words, where tetrahedron or face i stands in the file
    cell: Callable[[int], str] = lambda index: f"is number {index + 1}"
    face: Callable[[int], str] = lambda index: f"is number {index + 1}"
