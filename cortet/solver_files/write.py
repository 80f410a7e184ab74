"""A mesh as it leaves the house: with its sets and its sidecar, for a solver.

What the workflow, the command and Python write for solvers goes through `write`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cortet.measure.layers import cortex_and_white
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.export import export
from cortet.solver_files.fields import FieldSource, field_sources
from cortet.solver_files.meshed import Origin
from cortet.solver_files.sets import named_sets


def with_sets(
    mesh: TetMesh,
    surface: TriSurface,
    origin: Origin,
    *,
    sets: Mapping[str, Any],
    labels: Mapping[str, Mapping[int, str]],
) -> tuple[TetMesh, dict[str, FieldSource]]:
    """A mesh with its named sets, as files hold it, and where each of its fields comes from.

    Parameters
    ----------
    surface : that was meshed
    sets : `Export.sets`
    labels : volume -> label -> name
    """
    sources = field_sources(origin.fields)
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
    named, sources = with_sets(mesh, surface, origin, sets=sets, labels=labels)
    made_from = origin.made_from(path.parent, temporary)
    if sets.get("layers") and cortex_and_white(mesh, surface.inner) is not None:
        made_from["layers"] = sets["layers"]
    return export(
        named,
        temporary / path.name if temporary else path,
        certificate=certificate,
        frame=surface.frame,
        sources=sources,
        made_from=made_from,
        **arguments,
    )
