"""A mesh as it leaves the house: with its sets, its sidecar and its map, for a solver.

What the workflow, the command and Python write for solvers goes through `write`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cortet.formats import FORMATS
from cortet.formats.gifti import read_surface
from cortet.formats.placement import placed
from cortet.formats.volumes import is_volume
from cortet.measure.layers import cortex_and_white
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.export import Matrices, export
from cortet.solver_files.fields import FieldSource, field_sources
from cortet.solver_files.meshed import Origin
from cortet.solver_files.sets import named_sets
from cortet.solver_files.surface_map import surface_map


def with_sets(
    mesh: TetMesh,
    surface: TriSurface,
    origin: Origin,
    *,
    sets: Mapping[str, Any],
    labels: Mapping[str, Mapping[int, str]],
    units: Mapping[str, str],
) -> tuple[TetMesh, dict[str, FieldSource]]:
    """A mesh with its named sets, as files hold it, and where each of its fields comes from.

    Parameters
    ----------
    surface : that was meshed
    sets : `Export.sets`
    labels : volume -> label -> name
    units : field -> unit
    """
    sources = field_sources(origin.fields, units)
    names = {**{name: source.labels for name, source in sources.items()}, **labels}
    return named_sets(mesh, **sets, inner=list(surface.inner), label_names=names, tissues=labels), sources


def write(
    mesh: TetMesh,
    surface: TriSurface,
    path: Path,
    *,
    certificate: Mapping[str, Any],
    origin: Origin,
    sets: Mapping[str, Any],
    labels: Mapping[str, Mapping[int, str]],
    units: Mapping[str, str],
    arguments: Mapping[str, Any],
    temporary: Path | None = None,
) -> list[str]:
    """Write a mesh for a solver, with its sets and a sidecar; returns what the format cannot hold.

    Every mesh that cortet makes leaves it here. Parameters are those of `with_sets`; and

    Parameters
    ----------
    mesh : from `stages.solver_ready`, with the values of its volumes
    certificate : content of its certificate.json
    arguments : `Config.export_arguments`
    temporary : folder that holds the surfaces that were meshed, and gets the files; all of them move to that of `path`
    """
    named, sources = with_sets(mesh, surface, origin, sets=sets, labels=labels, units=units)
    made_from = origin.made_from(path.parent, temporary)
    if sets.get("layers") and cortex_and_white(mesh, surface.inner) is not None:
        made_from["layers"] = sets["layers"]
    options = {name: value for name, value in arguments.items() if name != "map"}
    beside, told = None, []
    if arguments.get("map") and not FORMATS[arguments["solver"]].is_surface:
        beside = _matrices(surface, certificate, origin)
        told = [] if beside else ["no map: the input is not a surface file"]
    frame = surface.frame
    lacks = export(
        named,
        temporary / path.name if temporary else path,
        certificate=certificate,
        frame=frame,
        sources=sources,
        made_from=made_from,
        beside=beside,
        **options,
    )
    return lacks + told


def _matrices(surface: TriSurface, certificate: Mapping[str, Any], origin: Origin) -> Matrices | None:
    """What makes the matrices between a mesh and the surface as it was read; None if that was no surface."""
    given = next(iter(origin.given.values()), None)
    if given is None or is_volume(str(given)):
        return None
    parameters = certificate["parameters"]
    native = placed(read_surface(given, finite=False), parameters.get("gate", {}).get("to_mm"))

    def matrices(mesh: TetMesh) -> dict[str, Any]:
        found = surface_map(
            mesh, replace(surface, inner={}), replace(native, point_data={}), renumbered="resample" in parameters
        )
        return {"to_surface": found.to_surface, "from_surface": found.from_surface}

    return matrices
