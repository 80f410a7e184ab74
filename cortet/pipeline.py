"""The whole line for one surface and its inner surfaces: from resampling and repair to the certificate and the files.

The workflow runs the same stages with the same arguments in the same order, one file at a time.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

from cortet.config import Config, load
from cortet.geometry.nesting import nested
from cortet.measure.certify import Certificate, certify
from cortet.meshes import TetMesh, TriSurface
from cortet.stages import (
    MESH_STAGES,
    certify_record,
    notices,
    require_nesting,
    require_programs,
    settled,
    stages_of,
)
from cortet.stages.stage import UNKNOWN, About, Stage, State, Values

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Step:
    """A completed stage."""

    stage: str
    #: its result: a surface, up to S1, or a mesh
    result: TriSurface | TetMesh
    #: the surface to be meshed, in its present state
    surface: TriSurface
    #: what it depends on, with its version
    parameters: Values
    #: what it did, as plain values
    report: Values
    seconds: float


class Meshed(NamedTuple):
    """The result of the line."""

    mesh: TetMesh
    certificate: Certificate
    #: the surface that was meshed: the input, repaired and smoothed
    surface: TriSurface


def run(state: State, config: Config, about: About) -> Iterator[Step]:
    """Run the line and yield every stage when it is complete.

    Parameters
    ----------
    state : the surface, mm, with its inner surfaces by the names of the regions inside them, and its sphere if it has
        one; coordinates may be non-finite if the line repairs
    config : of the line
    about : what else is known; without a cell size or a mesher, the first of `config`

    Raises
    ------
    InputError : a program that the line calls is not installed, or the gate refuses the surface
    StageError : a stage failed
    """
    config, about, inner = settled(config), _completed(about, config, state.surface), state.surface.inner
    age = about.gestational_age
    if config.smooth_surface.enabled and config.smooth_surface.method == "published" and age is None:
        logger.warning("no gestational age is given, so the surface is not smoothed")
    require_programs(config)
    for notice in notices(config):
        logger.warning(notice)
    if inner:
        require_nesting(config)
    state = replace(state, surface=nested(state.surface, inner))
    line = stages_of(config, nested=bool(inner), registered=state.sphere is not None, aged=age is not None)
    yield from _through(line, state, config, about)


def _completed(about: About, config: Config, surface: TriSurface) -> About:
    """What is known, with the first cell size and mesher of the configuration, and the names of inner surfaces."""
    known = {
        "cell_size": about.cell_size or config.generate.cell_size[0],
        "mesher": about.mesher or config.generate.meshers[0],
        "inner": {name: about.inner.get(name, name) for name in surface.inner},
    }
    return about.model_copy(update=known)


def _through(line: Iterable[Stage], state: State, config: Config, about: About) -> Iterator[Step]:
    """Take a state through some stages."""
    for stage in line:
        began = time.perf_counter()
        state, report = stage.run(state, config, about)
        seconds = time.perf_counter() - began
        logger.info("%s: %.1f s", stage.name, seconds)
        made = state.mesh if stage.gives == "mesh" else state.surface
        yield Step(stage.name, made, state.surface, stage.record(config, about), report, seconds)


def warm_up() -> None:
    """Compile the kernels of the line if this machine has not done so yet, by meshing a coarse phantom."""
    from cortet.phantoms import phantom

    mesh_surface(State(phantom(24.0, subdivisions=3)), load({"generate": {"cell_size": 4.0}}))


def mesh_surface(
    state: State,
    config: Config,
    about: About = UNKNOWN,
    *,
    case: str = "",
    progress: Callable[[Step], None] = lambda _: None,
) -> Meshed:
    """Mesh one surface and check the mesh.

    Parameters are those of `run`. `case` is named in the certificate; `progress` is called after every stage.
    """
    line, about = run(state, config, about), _completed(about, config, state.surface)
    return _certified(line, config, about, progress, case=case, native=state.surface)


def _certified(
    line: Iterable[Step],
    config: Config,
    about: About,
    progress: Callable[[Step], None],
    *,
    case: str,
    native: TriSurface | None = None,
    before: Mapping[str, Values] = MappingProxyType({}),
) -> Meshed:
    """The mesh at the end of a line with its certificate, which records each stage.

    Parameters
    ----------
    before : reports of stages that ran before the line
    """
    parameters: dict[str, Values] = {}
    reports = dict(before)
    for step in line:
        progress(step)
        parameters[step.stage], reports[step.stage] = step.parameters, step.report
        mesh, surface = step.result, step.surface
        if step.stage == "gate" and reports.get("repair", {}).get("repaired"):
            native = step.surface  # the file lacks what repair made
    assert isinstance(mesh, TetMesh)  # the line ends with solver_ready
    parameters["certify"] = certify_record(config, about.cell_size)
    certificate = certify(
        mesh,
        surface,
        config.certify,
        cell_size=about.cell_size,
        native=native,
        case=case,
        source=about.source,
        parameters=parameters,
        reports=reports,
        layers=config.export.layers,
    )
    return Meshed(mesh, certificate, surface)


def improve(
    state: State,
    config: Config,
    about: About,
    *,
    case: str = "",
    repaired: Mapping[str, Values] = MappingProxyType({}),
    progress: Callable[[Step], None] = lambda _: None,
) -> Meshed:
    """Run the stages that follow the mesher on a mesh of any program, and check the result.

    Parameters
    ----------
    state : a mesh of positive volumes, and the surface that it fills, mm, with its inner surfaces; `region` of its
        cell data numbers the regions, where there are inner surfaces
    config : of the line
    about : what else is known, with the cell size of the mesh
    case : name in the certificate
    repaired : the report of `repair` on the surface, by stage, if there is one
    progress : called after every stage
    """
    require_programs(config)
    about = _completed(about, config, state.surface)
    after_transfer = [*MESH_STAGES.values()][2:]
    line = [stage for stage in stages_of(config, nested=bool(about.inner)) if stage in after_transfer]
    steps = _through(line, state, config, about)
    return _certified(steps, config, about, progress, case=case, before=repaired)
