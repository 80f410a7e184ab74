"""Write a mesh for a solver: only a certified one, and only when the written file keeps the solver's conventions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cortet import verify
from cortet.errors import StageError
from cortet.formats import FORMATS
from cortet.formats.atomic import atomic_path
from cortet.mesh import TetMesh

VERSION: int = 1


#: format of a solver -> names every convention of the solver that a written file breaks
VERIFIERS: dict[str, Callable[[Path], list[str]]] = {"braingrowth": verify.braingrowth}


def export(
    mesh: TetMesh, path: Path, *, solver: str, certificate: Mapping[str, Any], uncertified: bool = False
) -> None:
    """Write `path`, complete and verified or not at all.

    Parameters
    ----------
    mesh : as `stages.solver_ready` leaves it
    solver : a key of `VERIFIERS`
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
    with atomic_path(path) as temporary:
        FORMATS[solver].write(mesh, temporary)
        if problems := VERIFIERS[solver](temporary):
            raise StageError("the written file is not what the solver reads: " + "; ".join(problems), file=path)
