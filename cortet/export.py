"""Write a mesh for a solver: only a certified one, and only when the written file keeps the solver's conventions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cortet.errors import StageError
from cortet.formats import FORMATS
from cortet.formats.atomic import atomic_folder
from cortet.mesh import TetMesh
from cortet.verify import verify

VERSION: int = 1


def export(
    mesh: TetMesh, path: Path, *, solver: str, certificate: Mapping[str, Any], uncertified: bool = False
) -> None:
    """Write `path`, complete and verified or not at all.

    Parameters
    ----------
    mesh : as `stages.solver_ready` leaves it
    solver : a key of `verify.SOLVERS`
    certificate : content of the mesh's certificate.json
    uncertified : write it even when the certificate says no

    Raises
    ------
    StageError
        the mesh is not certified, or the written file breaks a convention of the solver
    """
    if not certificate["certified"] and not uncertified:
        raise StageError(
            "not certified, so not exported: " + "; ".join(certificate["reasons"]),
            file=path,
            remedy="export.uncertified: true writes it all the same",
        )
    with atomic_folder(path) as folder:
        FORMATS[solver].write(mesh, folder / path.name)
        if problems := verify(folder / path.name, solver):
            raise StageError("the written file is not what the solver reads: " + "; ".join(problems), file=path)
