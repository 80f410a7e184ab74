"""The whole line in memory, for one surface and its inner surfaces: from resampling and repair to the certificate.

The workflow runs the same stages with the same arguments in the same order, one file at a time.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cortet.config import Config, load
from cortet.formats.placement import placed
from cortet.geometry.limits import SCAN_AGES, require_within
from cortet.geometry.nesting import nested
from cortet.measure.certify import Certificate, certify
from cortet.meshes import TetMesh, TriSurface
from cortet.phantom import phantom
from cortet.solver_files.volumes import require_in_place
from cortet.stages import STAGES

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Step:
    """A completed stage."""

    stage: str
    #: its result: a surface, up to S1, or a mesh
    result: TriSurface | TetMesh
    #: the surface to be meshed, in its present state
    surface: TriSurface
    #: its arguments and its version
    parameters: dict[str, Any]
    #: the report of the stage, as plain values
    report: dict[str, Any]
    seconds: float


class Meshed(NamedTuple):
    """The result of the line."""

    mesh: TetMesh
    certificate: Certificate
    #: the surface that was meshed: the input, repaired and smoothed
    surface: TriSurface


def stages(
    config: Config, *, gestational_age: float | None, nested: bool = False, registered: bool = False
) -> list[str]:
    """Names of the stages that run; without a gestational age (weeks), the published smoothing does not.

    Parameters
    ----------
    nested : whether there are inner surfaces
    registered : whether there is a sphere
    """
    line = config.line(nested=nested, registered=registered, aged=gestational_age is not None)
    return [stage.name for stage in line]


def run(
    surface: TriSurface,
    config: Config,
    *,
    gestational_age: float | None = None,
    source: str | Path | None = None,
    inner_sources: Mapping[str, str | Path] | None = None,
    sphere: TriSurface | None = None,
    sphere_source: str | Path | None = None,
) -> Iterator[Step]:
    """Run the line and yield every stage when it is complete.

    Parameters
    ----------
    surface : as read, with its inner surfaces by the names of the regions inside them; coordinates may be non-finite
        if the line repairs
    config : of the line; the first of its cell sizes and meshers is used
    gestational_age : weeks; None leaves out the published smoothing, whose strength depends on it
    source : file of the surface, named in messages
    inner_sources : likewise of the inner surfaces, by name
    sphere : of the surface, which is then resampled to the common mesh
    sphere_source : file of the sphere, named in messages

    Raises
    ------
    InputError
        a program that the line calls is not installed, the gate refuses the surface, or a parameter is out of range
    StageError
        a stage failed
    """
    if config.enabled("smooth_surface") and config.smooth_surface.method == "published" and gestational_age is None:
        logger.warning("no gestational age is given, so the surface is not smoothed")
    if gestational_age is not None:
        require_within(gestational_age, SCAN_AGES, "the gestational age in weeks")
    config.require_programs()
    for notice in config.notices():
        logger.warning(notice)
    inner, to_mm = bool(surface.inner), config.placement()
    facts = {
        "source": str(source) if source is not None else None,
        "gestational_age": gestational_age,
        "cell_size": config.generate.cell_size[0],
        "mesher": config.generate.meshers[0],
        "placement": to_mm,
        "nested": inner,
        "sphere_file": str(sphere_source) if sphere_source is not None else None,
        "hemisphere": None,
    }
    surface = placed(surface, to_mm)
    _require_sizes(surface, config)
    latest: dict[str, Any] = {"surface": nested(surface, surface.inner), "sphere": sphere}
    config.require_nesting(inner)
    names = stages(config, gestational_age=gestational_age, nested=inner, registered=sphere is not None)
    for stage in map(STAGES.__getitem__, names):
        taken = [latest[kind] for kind in stage.takes]
        began = time.perf_counter()
        latest[stage.gives], report = stage.function(*taken, **config.arguments(stage.name, facts))
        reported = asdict(report)
        if stage.alone and inner:
            # each inner surface separately
            within, reported["inner"] = {}, {}
            for name, one in latest["surface"].inner.items():
                own = config.arguments(stage.name, {**facts, "source": str((inner_sources or {}).get(name, name))})
                inside = {"inside": True} if stage.told_inside else {}
                within[name], report = stage.function(one, *taken[1:], **own, **inside)
                reported["inner"][name] = asdict(report)
            latest["surface"] = nested(latest["surface"], within)
        seconds = time.perf_counter() - began
        logger.info("%s: %.1f s", stage.name, seconds)
        yield Step(
            stage.name,
            latest[stage.gives],
            latest["surface"],
            config.record(stage.name, facts),
            reported,
            seconds,
        )


def _require_sizes(surface: TriSurface, config: Config) -> None:
    """Raise InputError for smaller cells that cannot be made, before any stage runs."""
    if config.generate.sizes:
        from cortet.meshers._sizes import checked

        _, volumes = checked(config.generate.sizes, surface, config.generate.cell_size[0])
        require_in_place(volumes, surface)


def warm_up() -> None:
    """Compile the kernels of the line if this machine has not done so yet, by meshing a coarse phantom."""
    mesh_surface(phantom(24.0, subdivisions=3), load({"generate": {"cell_size": 4.0}}))


def mesh_surface(
    surface: TriSurface,
    config: Config,
    *,
    gestational_age: float | None = None,
    source: str | Path | None = None,
    inner_sources: Mapping[str, str | Path] | None = None,
    sphere: TriSurface | None = None,
    sphere_source: str | Path | None = None,
    case: str = "",
    progress: Callable[[Step], None] = lambda _: None,
) -> Meshed:
    """Mesh one surface and judge the mesh.

    Parameters are those of `run`. The certificate of `case` identifies `source` by its hash; `progress` is called after
    every stage.
    """
    parameters, reports = {}, {}
    facts = {"cell_size": config.generate.cell_size[0]}
    mesh: TriSurface | TetMesh = surface
    line = run(
        surface,
        config,
        gestational_age=gestational_age,
        source=source,
        inner_sources=inner_sources,
        sphere=sphere,
        sphere_source=sphere_source,
    )
    for step in line:
        progress(step)
        parameters[step.stage], reports[step.stage] = step.parameters, step.report
        mesh, meshed = step.result, step.surface
    assert isinstance(mesh, TetMesh)  # the line ends with solver_ready
    certificate = certify(
        mesh,
        meshed,
        **config.arguments("certify", facts),
        native=placed(surface, config.placement()),
        case=case,
        source=source,
        parameters={**parameters, "certify": config.record("certify", facts)},
        reports=reports,
    )
    return Meshed(mesh, certificate, meshed)
