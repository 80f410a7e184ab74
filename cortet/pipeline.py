"""The whole line for one surface and its inner surfaces: from resampling and repair to the certificate and the files.

The workflow runs the same stages with the same arguments in the same order, one file at a time.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypedDict, Unpack

from cortet.config import Config, load
from cortet.errors import InputError
from cortet.formats.placement import placed
from cortet.geometry.limits import SCAN_AGES, require_within
from cortet.geometry.nesting import nested
from cortet.measure.certify import Certificate, certify
from cortet.meshes import TetMesh, TriSurface, region_names
from cortet.solver_files.meshed import certificate_path, meshed_files
from cortet.stages import (
    MESH_STAGES,
    Stage,
    arguments_of,
    certify_record,
    notices,
    record_of,
    require_nesting,
    require_programs,
    stages_of,
)

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


class About(TypedDict, total=False):
    """What may be known of a surface besides its points: keyword arguments of `run` and `mesh_surface`."""

    #: weeks; without it the published smoothing, whose strength depends on it, is left out
    gestational_age: float | None
    #: L or R, which templates of `resample` may name
    hemisphere: str | None
    #: file of the surface, named in messages; the certificate identifies it by its hash
    source: str | Path | None
    #: likewise of the inner surfaces, by name
    inner_sources: Mapping[str, str | Path] | None
    #: of the surface, which is then resampled to the common mesh
    sphere: TriSurface | None
    #: file of the sphere, named in messages
    sphere_source: str | Path | None


def run(surface: TriSurface, config: Config, **about: Unpack[About]) -> Iterator[Step]:
    """Run the line and yield every stage when it is complete.

    Parameters
    ----------
    surface : as read, with its inner surfaces by the names of the regions inside them; coordinates may be non-finite
        if the line repairs
    config : of the line; the first of its cell sizes and meshers is used

    Raises
    ------
    InputError : a program that the line calls is not installed, or the gate refuses the surface
    StageError : a stage failed
    """
    age, sphere, source = about.get("gestational_age"), about.get("sphere"), about.get("source")
    if config.smooth_surface.enabled and config.smooth_surface.method == "published" and age is None:
        logger.warning("no gestational age is given, so the surface is not smoothed")
    if age is not None:
        require_within(age, SCAN_AGES, "the gestational age in weeks")
    require_programs(config)
    for notice in notices(config):
        logger.warning(notice)
    to_mm, sphere_file = config.placement(), about.get("sphere_source")
    surface = placed(surface, to_mm)
    if surface.inner:
        require_nesting(config)
    facts = {
        "source": None if source is None else str(source),
        "gestational_age": age,
        "cell_size": config.generate.cell_size[0],
        "mesher": config.generate.meshers[0],
        "placement": to_mm,
        "nested": bool(surface.inner),
        "sphere_file": None if sphere_file is None else str(sphere_file),
        "hemisphere": about.get("hemisphere"),
        "hemi": about.get("hemisphere"),
    }
    line = stages_of(config, nested=bool(surface.inner), registered=sphere is not None, aged=age is not None)
    given: dict[str, Any] = {"surface": nested(surface, surface.inner), "sphere": sphere}
    yield from _through(line, given, config, facts, about.get("inner_sources") or {})


def _through(
    line: Iterable[Stage],
    latest: dict[str, Any],
    config: Config,
    facts: Mapping[str, Any],
    inner_sources: Mapping[str, str | Path],
) -> Iterator[Step]:
    """Take what `latest` holds (surface, sphere, mesh) through some stages, which replace it."""
    for stage in line:
        began = time.perf_counter()
        taken = [latest[kind] for kind in stage.takes]
        try:
            latest[stage.gives], report = stage.run(*taken, **arguments_of(config, stage.name, facts))
        except InputError as error:
            if not stage.nested or error.file is not None or facts["source"] is None:
                raise
            both = " and ".join(map(str, (facts["source"], *inner_sources.values())))  # it compares them
            raise InputError(error.what, file=both, remedy=error.remedy) from error
        reported = asdict(report)
        if stage.alone and latest["surface"].inner:
            # each inner surface separately
            within, reported["inner"] = {}, {}
            for name, one in latest["surface"].inner.items():
                own = arguments_of(config, stage.name, {**facts, "source": str(inner_sources.get(name, name))})
                inside = {"inside": True} if stage.takes_inside else {}
                within[name], report = stage.run(one, *taken[1:], **own, **inside)
                reported["inner"][name] = asdict(report)
            latest["surface"] = nested(latest["surface"], within)
        seconds = time.perf_counter() - began
        logger.info("%s: %.1f s", stage.name, seconds)
        parameters = record_of(config, stage.name, facts)
        yield Step(stage.name, latest[stage.gives], latest["surface"], parameters, reported, seconds)


def warm_up() -> None:
    """Compile the kernels of the line if this machine has not done so yet, by meshing a coarse phantom."""
    from cortet.phantoms import phantom

    mesh_surface(phantom(24.0, subdivisions=3), load({"generate": {"cell_size": 4.0}}))


def mesh_surface(
    surface: TriSurface,
    config: Config,
    *,
    case: str = "",
    progress: Callable[[Step], None] = lambda _: None,
    **about: Unpack[About],
) -> Meshed:
    """Mesh one surface and check the mesh.

    Parameters are those of `run`. `case` is named in the certificate; `progress` is called after every stage.
    """
    line, native = run(surface, config, **about), placed(surface, config.placement())
    size = config.generate.cell_size[0]
    source = about.get("source")
    return _certified(line, config, progress, cell_size=size, native=native, case=case, source=source)


def _certified(
    line: Iterable[Step],
    config: Config,
    progress: Callable[[Step], None],
    before: Mapping[str, Any] = MappingProxyType({}),
    *,
    cell_size: float,
    native: TriSurface | None = None,
    **of: Any,
) -> Meshed:
    """The mesh at the end of a line with its certificate, which records each stage; `of` goes to `certify`.

    Parameters
    ----------
    before : reports of stages that ran before the line
    """
    parameters, reports = {}, dict(before)
    for step in line:
        progress(step)
        parameters[step.stage], reports[step.stage] = step.parameters, step.report
        mesh, surface = step.result, step.surface
        if step.stage == "gate" and reports.get("repair", {}).get("repaired"):
            native = step.surface  # the file lacks what repair made
    assert isinstance(mesh, TetMesh)  # the line ends with solver_ready
    parameters["certify"] = certify_record(config, cell_size)
    certificate = certify(
        mesh,
        surface,
        config.certify,
        cell_size=cell_size,
        native=native,
        parameters=parameters,
        reports=reports,
        layers=config.export.layers,
        **of,
    )
    return Meshed(mesh, certificate, surface)


def improve(
    mesh: TetMesh,
    surface: TriSurface,
    config: Config,
    *,
    cell_size: float,
    source: str | Path | None = None,
    case: str = "",
    repaired: Mapping[str, Any] | None = None,
    progress: Callable[[Step], None] = lambda _: None,
) -> Meshed:
    """Run the stages that follow the mesher on a mesh of any program, and check the result.

    Parameters
    ----------
    mesh : positive volumes; `region` of its cell data numbers the regions, where `surface` has inner ones
    surface : mm, that the mesh fills, with its inner surfaces
    config : of the line
    cell_size : mm, of the mesh
    source : file of the surface, whose hash the certificate records
    case : name in the certificate
    repaired : the report of `repair` on the surface, by stage, if there is one
    progress : called after every stage
    """
    require_programs(config)
    facts = {
        "cell_size": cell_size,
        "source": str(source) if source is not None else None,
        "nested": bool(surface.inner),
    }
    after_transfer = [*MESH_STAGES][2:]
    line = [stage for stage in stages_of(config, nested=bool(surface.inner)) if stage.name in after_transfer]
    steps = _through(line, {"mesh": mesh, "surface": surface}, config, facts, {})
    return _certified(steps, config, progress, repaired or {}, cell_size=cell_size, case=case, source=source)


class Companions(NamedTuple):
    """Files that are written with a mesh; their names begin with its stem."""

    certificate: Path
    #: region -> surface that was meshed
    surfaces: dict[str, Path]
    #: table of the labels of its volumes, where it has some
    tissues: Path | None

    @property
    def files(self) -> list[Path]:
        """All of them."""
        return [self.certificate, *self.surfaces.values(), *([self.tissues] if self.tissues else [])]


def companions(path: Path, inner: Iterable[str], *, volumes: bool) -> Companions:
    """The companions of a mesh with some inner regions, and with or without volumes."""
    table = path.with_name(f"{path.name.removesuffix(path.suffix)}.volumes.tsv")
    return Companions(certificate_path(path), meshed_files(region_names(inner), path), table if volumes else None)
