"""`read`, `improve` and `convert`: meshes that are there already, of cortet or of any other program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cortet.api.given import Settings, SurfaceLike, sections, surface
from cortet.api.meshing import Mesh, teller, tetrahedra
from cortet.config import Config, load
from cortet.errors import InputError, counted
from cortet.formats.gifti import read_surface
from cortet.formats.hashing import input_sha256, mesh_sha256
from cortet.formats.ownership import guarded
from cortet.formats.placement import placed
from cortet.geometry.filling import require_body
from cortet.geometry.kernel_cache import require_threads
from cortet.geometry.limits import CELL_SIZE_MM, require_within
from cortet.geometry.nesting import nested
from cortet.geometry.topology import edges
from cortet.measure.certify import certify, with_contacts
from cortet.measure.electrodes import ElectrodeRecord
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, IntArray, TetMesh, TriSurface, region_names
from cortet.pipeline import Step
from cortet.pipeline import improve as improved
from cortet.solver_files import export
from cortet.solver_files.meshed import (
    Origin,
    cell_size_of,
    certificate_beside,
    electrodes_of,
    meshed_surface,
    parameters_of,
    repair_of,
)
from cortet.solver_files.sets import OF_ARRAYS, require_same_regions, with_regions
from cortet.solver_files.sidecar import changed_since, read_sidecar
from cortet.stages.gate import require_size
from cortet.stages.stage import About, State

#: no inner surfaces
NO_FILES: Mapping[str, str | Path] = MappingProxyType({})
#: part of the length of a surface by which the box of its mesh may differ from its own
_ELSEWHERE = 0.25


def read(path: str | Path, shape: SurfaceLike | None = None, cell_size: float | None = None) -> Mesh:
    """A mesh from a file of any format, checked against the surface that it fills.

    Parameters
    ----------
    path : its ending names the format; coordinates in mm
    shape : closed surface, mm; None: the one that was meshed, by the sidecar of the file
    cell_size : mm, the scale of limits on distances; None: as the certificate beside the file records it, else the
        mean length of the edges

    Returns
    -------
    nodes (n, 3) mm, tetrahedra (m, 4), fields, regions, and a new certificate

    Raises
    ------
    InputError : the file cannot be read, or no sidecar names its surface and none is given

    Examples
    --------
    >>> made = cortet.read("x.vtu")
    >>> made.points.shape[1], made.cells.shape[1], made.certified
    (3, 4, True)
    """
    file = Path(path)
    mesh, filled, source = filling(file, shape, Config())
    size = _size(cell_size, file, mesh)
    stages = {} if changed_since(file) else parameters_of(file)
    certificate = certify(
        mesh,
        filled,
        cell_size=size,
        case=file.stem,
        source=source,
        parameters=stages,
        reports=known_repair(file, source),
    )
    certificate = with_contacts(certificate, mesh, known_electrodes(file, mesh))
    return _known(Mesh(mesh, certificate, filled, size), file, source)


def improve(
    made: TetMesh | Mesh | str | Path,
    shape: SurfaceLike | None = None,
    cell_size: float | None = None,
    *,
    settings: Settings | None = None,
    progress: bool | Callable[[Step], None] = True,
) -> Mesh:
    """Take the mesh of any program through the stages that follow the mesher, S3 to S6, and check it.

    Worst elements are moved and reconnected, the boundary is put onto the surface, nodes are ordered for solvers. Of
    fields and sets only `region` stays; the fields of the surface come anew.

    Parameters
    ----------
    made : tetrahedra that fill the surface; a file, what `mesh` or `read` returns, or a `TetMesh`
    shape : closed surface, mm; None: the one that was meshed, as far as that is known
    cell_size : mm; None: as it is known, else the mean length of the edges
    settings : a configuration file, or its keys by section: {"relocate": {"enabled": True}}
    progress : False: silent; a function: called after every stage

    Returns
    -------
    nodes (n, 3) mm, tetrahedra (m, 4), and the certificate, whose `reports` say what each stage did

    Raises
    ------
    InputError : the tetrahedra form no valid solid, no surface is known, or a setting is impossible
    CortetError : a stage failed

    Examples
    --------
    >>> better = cortet.improve("x.vtu", "x.surf.gii", progress=False)
    >>> better.certified
    True
    """
    file = Path(made) if isinstance(made, str | Path) else None
    asked = sections(settings)
    mesh, filled, source = filling(made, shape, load(asked))
    cells = _oriented(mesh, file)
    require_body(mesh, file)
    size = _size(cell_size, made, mesh)
    config = load({"snap": {"enabled": True}, **asked})
    region = {REGION: mesh.cell_data[REGION]} if REGION in mesh.cell_data else {}
    bare = TetMesh(mesh.points, cells, {}, region)
    case = file.stem if file else ""
    found = improved(
        State(filled, mesh=bare),
        config,
        About(cell_size=size, source=None if source is None else str(source)),
        case=case,
        repaired=known_repair(made, source),
        progress=teller(progress),
    )
    better = Mesh(*found, size, config=config)
    return _known(better, made if isinstance(made, TetMesh | Mesh) else Path(made), source)


def convert(source: str | Path, target: str | Path, *, force: bool = False) -> list[str]:
    """Write a mesh file in another format, which the ending of `target` names.

    Parameters
    ----------
    source, target : mm; CARP files in um
    force : replace a file that cortet did not make; never `source`

    Returns
    -------
    what was changed or left out, in words

    Raises
    ------
    InputError : an ending names no format, `source` cannot be read, or `target` exists and cortet did not make it
    CortetError : the mesh breaks a convention of solvers

    Examples
    --------
    >>> cortet.convert("x.vtu", "x.msh")
    ['left out, because the format has no sets of nodes: cortical_surface']
    """
    with guarded([Path(source)], files=[Path(target)], force=force):
        return export.convert(Path(source), Path(target))


def filling(
    made: TetMesh | Mesh | str | Path,
    shape: SurfaceLike | None,
    config: Config,
    inner: Mapping[str, str | Path] = NO_FILES,
) -> tuple[TetMesh, TriSurface, Path | None]:
    """A mesh with the numbers of its regions, the surface that it fills, and the file of that.

    Parameters
    ----------
    shape, inner : as of `certify`
    config : `gate.unit: mm` accepts a brain of any size

    Raises
    ------
    InputError : mesh or surface is not in mm, or they lie in different locations
    """
    require_threads()
    mesh = tetrahedra(made)
    named = Path(shape) if isinstance(shape, str | Path) else None
    if isinstance(made, str | Path) and (shape is None or named):
        filled, named = meshed_surface(Path(made), named, {name: Path(file) for name, file in inner.items()})
    elif shape is None and isinstance(made, Mesh):
        filled = made.surface
    elif shape is None:
        raise InputError("cortet cannot tell which surface was meshed", remedy="also give the surface")
    else:
        filled = surface(shape)
    if inner and not isinstance(made, str | Path):
        filled = nested(filled, {**filled.inner, **{name: read_surface(file) for name, file in inner.items()}})
    file = Path(made) if isinstance(made, str | Path) else None
    of_cortet = file is not None and bool(read_sidecar(file)) and not changed_since(file)
    in_mm = config.gate.unit == "mm" or isinstance(made, Mesh) or of_cortet
    for one, source in ((mesh, file), (filled, named)):
        require_size(one, file=source, stated=in_mm, convert="give mesh and surface in mm")
    _require_one_place(mesh, filled, file)
    if file is None or file.suffix in OF_ARRAYS:
        require_same_regions(mesh, list(filled.inner), file)
    return with_regions(mesh, list(filled.inner)) if filled.inner else mesh, filled, named


def _require_one_place(mesh: TetMesh, filled: TriSurface, file: Path | None) -> None:
    """Raise InputError for a mesh in other units or coordinates than its surface, whose boundary cannot be put there.

    The stages would run, and the certificate would advise smaller cells.
    """
    box, wanted = (np.array([points.min(0), points.max(0)]) for points in (mesh.points, filled.points))
    if np.abs(box - wanted).max() > _ELSEWHERE * np.ptp(wanted, axis=0).max():
        here, there = (
            " to ".join(f"({', '.join(f'{x:.4g}' for x in corner)})" for corner in corners) for corners in (box, wanted)
        )
        raise InputError(
            f"lies elsewhere than its surface: it extends from {here} mm, the surface from {there} mm",
            file=file,
            remedy="give the mesh in mm, in the coordinates of its surface, or name the surface that it fills",
        )


def _known(found: Mesh, made: TetMesh | Mesh | Path, source: Path | None) -> Mesh:
    """The mesh with what is known of the brain: age, hemisphere, kind of surface, and its files."""
    if isinstance(made, Mesh):
        return replace(found, origin=replace(made.origin, fields={}, volumes={}), inputs=made.inputs)
    if isinstance(made, TetMesh):
        return found
    record: dict[str, Any] = read_sidecar(made).get("made_from") or {}
    given = {region: made.parent / one["file"] for region, one in record.get("given", {}).items()}
    given = {region: file for region, file in given.items() if file.is_file()}
    if not given and source is not None:
        given = {region_names(found.surface.inner)[0]: source}
    origin = Origin(
        given, age=record.get("gestational_age"), hemisphere=record.get("hemisphere"), kind=record.get("surface")
    )
    to_mm, stored = parameters_of(made).get("gate", {}).get("to_mm"), record.get("given", {})
    native = {
        region: placed(replace(read_surface(file, finite=False), point_data={}), to_mm)
        for region, file in given.items()
        if region in stored and input_sha256(file) == stored[region]["sha256"]
    }
    return replace(found, origin=origin, native=native, inputs=(made, *([source] if source else [])))


def known_repair(made: TetMesh | Mesh | str | Path, source: Path | None) -> dict[str, Any]:
    """The report of `repair` on the surface that a mesh fills, by stage, as far as that is known.

    Parameters
    ----------
    source : file of the surface
    """
    if isinstance(made, Mesh):
        found = made.certificate.reports.get("repair") if source is None else None
    else:
        found = repair_of(Path(made), source) if isinstance(made, str | Path) else None
    return {"repair": found} if found else {}


def known_electrodes(made: TetMesh | Mesh | str | Path, mesh: TetMesh) -> tuple[ElectrodeRecord, ...]:
    """The contacts of electrodes on a mesh, as far as they are known; of a file by the certificate beside it.

    Parameters
    ----------
    mesh : the nodes and tetrahedra of `made`
    """
    if isinstance(made, Mesh):
        return made.certificate.electrodes
    if isinstance(made, TetMesh) or certificate_beside(Path(made)).get("mesh_sha256") != mesh_sha256(mesh):
        return ()
    return electrodes_of(Path(made))


def known_size(made: TetMesh | Mesh | str | Path) -> float | None:
    """The cell size that a mesh was made with, mm; of a file by the certificate beside it."""
    if isinstance(made, Mesh):
        return made.cell_size
    return cell_size_of(Path(made)) if isinstance(made, str | Path) else None


def _size(cell_size: float | None, made: TetMesh | Mesh | Path | str, mesh: TetMesh) -> float:
    """The given cell size, else the known one, else the mean length of the edges, mm; InputError if none can be."""
    size = known_size(made) if cell_size is None else cell_size
    if size is None:
        ends = mesh.points[edges(mesh.cells)]
        size = round(float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()), 3)
    require_within(size, CELL_SIZE_MM, "the cell size in mm")
    return float(size)


def _oriented(mesh: TetMesh, file: Path | None) -> IntArray:
    """Tetrahedra (m, 4) with positive volumes: programs differ in the order of nodes; InputError if one is flat."""
    volumes = signed_volumes(mesh.points, mesh.cells)
    if flat := int((volumes == 0).sum()):
        raise InputError(
            f"{counted(flat, 'tetrahedron has', 'tetrahedra have')} no volume, the first is number "
            f"{int(np.argmax(volumes == 0))}",
            file=file,
            remedy="mesh the surface again",
        )
    return np.where((volumes < 0)[:, None], mesh.cells[:, [1, 0, 2, 3]], mesh.cells).astype(np.int32)
