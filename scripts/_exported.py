"""What the scripts that write files for solvers share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cortet.errors import StageError
from cortet.formats import gifti, vtu
from cortet.formats.volumes import label_names, volume_file
from cortet.report.records import read_certificate

if TYPE_CHECKING:
    from cortet.meshes import TetMesh, TriSurface


def certificate_as_planned(inputs: Any, params: Any) -> dict[str, Any]:
    """The certificate of a job; StageError if it was made from something else than planned."""
    certificate = read_certificate(inputs.certificate)
    if certificate.get("made_from") != params.certified_from:
        what = "was made from another surface or other settings, or by another version of cortet, than this run"
        remedy = "`cortet cohort report` names the rule from which on to run again, with `snakemake --forcerun`"
        raise StageError(what, file=inputs.certificate, remedy=remedy)
    return certificate


def read_made(inputs: Any, params: Any) -> tuple[TetMesh, TriSurface, dict[str, Any]]:
    """The mesh of a job, the surface that was meshed, and arguments of `solver_files.export.with_sets`."""
    mesh = vtu.read(inputs.mesh)
    labels = {
        name: label_names(volume_file(file))
        for name, file in params.volumes.items()
        if np.issubdtype(mesh.cell_data[name].dtype, np.integer)
    }
    surface = gifti.read_nested(inputs.surface, inputs.inner)
    return mesh, surface, {"sets": params.sets, "labels": labels}
