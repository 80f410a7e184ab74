"""The whole line for one surface, in memory: gate, smoothing, S1 to S6, certificate.

The workflow runs the same stage functions with the same parameters in the same order, one file at a time.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cortet.certify import Certificate, certify
from cortet.config import Config
from cortet.mesh import TetMesh, TriSurface
from cortet.stages.clean import clean
from cortet.stages.gate import gate
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect
from cortet.stages.relocate import relocate
from cortet.stages.smooth_boundary import smooth_boundary
from cortet.stages.smooth_surface import smooth_surface
from cortet.stages.snap import snap
from cortet.stages.solver_ready import solver_ready
from cortet.stages.transfer import transfer

logger = logging.getLogger(__name__)

#: stages that make a surface out of a surface, then those that make a mesh out of a mesh and the surface, in the order
#: in which they run; S6 comes before S5, so that the mesh that is certified and exported is the last one
SURFACE_STAGES: dict[str, Callable[..., tuple[TriSurface, Any]]] = {"gate": gate, "smooth_surface": smooth_surface}
MESH_STAGES: dict[str, Callable[..., tuple[TetMesh, Any]]] = {
    "transfer": transfer,
    "relocate": lambda mesh, _, **parameters: relocate(mesh, **parameters),
    "clean": clean,
    "reconnect": reconnect,
    "smooth_boundary": smooth_boundary,
    "snap": snap,
    # fields once more, onto the final positions
    "solver_ready": lambda mesh, surface, **transferred: solver_ready(transfer(mesh, surface, **transferred)[0]),
}


@dataclass(frozen=True)
class Step:
    """One stage that has run."""

    stage: str
    #: what it made: the surface that is meshed, up to smoothing, or the mesh
    result: TriSurface | TetMesh
    #: the surface that is meshed, as far as it is made
    surface: TriSurface
    #: keyword arguments of the stage and its version
    parameters: dict[str, Any]
    #: what the stage reported, plain values
    report: dict[str, Any]
    seconds: float


def stages(config: Config, *, gestational_age: float | None) -> list[str]:
    """Names of the stages that run; without a gestational age (weeks) there is no smoothing."""
    line = [*SURFACE_STAGES, "generate", *MESH_STAGES]
    return [
        stage for stage in line if config.enabled(stage) and (stage != "smooth_surface" or gestational_age is not None)
    ]


def run(
    surface: TriSurface, config: Config, *, gestational_age: float | None = None, source: str | Path | None = None
) -> Iterator[Step]:
    """Run the line and hand out every stage when it is done.

    Parameters
    ----------
    surface : as read
    config : of the line; the first of its cell sizes and meshers counts
    gestational_age : weeks; None leaves out smoothing, whose strength depends on it
    source : file of the surface, named in messages

    Raises
    ------
    InputError
        the gate refuses the surface, or a parameter is out of range
    StageError
        a stage failed
    """
    if config.enabled("smooth_surface") and gestational_age is None:
        logger.warning("no gestational age is given, so the surface is not smoothed")
    chosen: dict[str, dict[str, Any]] = {
        "gate": {"source": str(source) if source is not None else None},
        "smooth_surface": {"gestational_age": gestational_age},
        "generate": {"cell_size": config.generate.cell_size[0], "mesher": config.generate.meshers[0]},
    }
    result: TriSurface | TetMesh = surface
    for stage in stages(config, gestational_age=gestational_age):
        parameters = config.stage(stage, **chosen.get(stage, {}))
        arguments = {key: value for key, value in parameters.items() if key != "version"}
        began = time.perf_counter()
        if stage in SURFACE_STAGES:
            surface, report = SURFACE_STAGES[stage](surface, **arguments)
            result = surface
        elif stage == "generate":
            result, report = generate(surface, **arguments)
        else:
            result, report = MESH_STAGES[stage](result, surface, **arguments)
        seconds = time.perf_counter() - began
        logger.info("%s: %.1f s", stage, seconds)
        yield Step(stage, result, surface, parameters, asdict(report), seconds)


def mesh_surface(
    surface: TriSurface,
    config: Config,
    *,
    gestational_age: float | None = None,
    source: str | Path | None = None,
    case: str = "",
    progress: Callable[[Step], None] = lambda _: None,
) -> tuple[TetMesh, Certificate]:
    """Mesh one surface and judge the mesh.

    Parameters are those of `run`; `source` is identified by its hash in the certificate of `case`, and `progress` is
    called after every stage.
    """
    parameters, reports = {}, {}
    mesh: TriSurface | TetMesh = surface
    for step in run(surface, config, gestational_age=gestational_age, source=source):
        progress(step)
        parameters[step.stage], reports[step.stage] = step.parameters, step.report
        mesh, meshed = step.result, step.surface
    assert isinstance(mesh, TetMesh)  # the line ends with solver_ready
    judged = config.stage("certify")
    certificate = certify(
        mesh,
        meshed,
        **{key: value for key, value in judged.items() if key != "version"},
        case=case,
        source=source,
        parameters={**parameters, "certify": judged},
        reports=reports,
    )
    return mesh, certificate
