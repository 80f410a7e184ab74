"""Export of a mesh to a solver, if it is certified and the written file keeps the solver's conventions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import save_npz

from cortet.errors import InputError, StageError
from cortet.formats import FORMATS, Format, format_of, require_holes
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_folder, write_json
from cortet.formats.hashing import array_sha256, mesh_sha256
from cortet.formats.ownership import delete_made, final_name, may_write
from cortet.formats.placement import UNITS
from cortet.formats.surface_sets import CORTICAL_SURFACE, MEDIAL_WALL, with_surface
from cortet.geometry.filling import require_body
from cortet.geometry.topology import boundary_faces, boundary_nodes, boundary_surface
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, MeshSets, TetMesh, TriSurface
from cortet.solver_files.earlier import numbered_today
from cortet.solver_files.fields import FieldSource, with_q, without_q
from cortet.solver_files.holes import hollow
from cortet.solver_files.meshed import moved
from cortet.solver_files.names import left_out, writable
from cortet.solver_files.others import not_as_meant, seen_otherwise
from cortet.solver_files.sets import named_sets, tagged
from cortet.solver_files.sidecar import CHANGED, changed_since, read_sidecar, sidecar, sidecar_path
from cortet.solver_files.verify import problems
from cortet.stages.gate import require_size
from cortet.stages.solver_ready import surface_nodes_first

VERSION: int = 8

#: gives sparse matrices of a mesh, by name
Matrices = Callable[[TetMesh], Mapping[str, Any]]


def export(
    mesh: TetMesh,
    path: Path,
    *,
    solver: str,
    certificate: Mapping[str, Any],
    uncertified: bool = False,
    unit: str = "um",
    frame: CoordinateFrame | None = None,
    sources: Mapping[str, FieldSource] | None = None,
    interior: str | None = None,
    made_from: Mapping[str, Any] | None = None,
    holes: Collection[str] = (),
    beside: Matrices | None = None,
) -> list[str]:
    """Write `path`, the files that belong to it and its sidecar, complete and verified or not at all.

    Parameters
    ----------
    mesh : from `stages.solver_ready`, with its sets (`sets.named_sets`)
    solver : a key of `formats.FORMATS`
    certificate : content of the mesh's certificate.json
    uncertified : write the mesh even if it is not certified
    unit : unit of the coordinates, ``mm`` or ``um``, for formats that do not state it
    frame : coordinate system of the surface the mesh was made from
    sources : field -> where it came from
    interior : how interior nodes got their values
    made_from : which surfaces were meshed, from `meshed.made_from`
    holes : inner regions whose tetrahedra are left out; the certificate is that of the whole mesh
    beside : gives, of the mesh as it was read back, sparse matrices that are written beside it, by name

    Returns
    -------
    which fields and sets the format cannot hold, or not by their names, in words

    Raises
    ------
    InputError
        a region lies in a hole, the format knows no holes, or a field has no real numbers
    StageError
        the certificate is of another mesh, the mesh is not certified, or the written file breaks a convention of the
        solver
    """
    require_holes(holes, solver)
    require_certified(mesh, certificate, path, uncertified=uncertified)
    bound_to = mesh_sha256(mesh)
    if len((hollowed := hollow(mesh, holes)).cells) < len(mesh.cells):
        mesh, made_from = hollowed, {**(made_from or {}), "holes": list(holes)}
    mesh, renamed = writable(mesh, solver)
    back = _write_verified(
        mesh,
        path,
        solver=solver,
        unit=unit,
        frame=frame,
        sources=sources or {},
        interior=interior,
        made_from=made_from,
        body=bool(certificate["certified"]),
        beside=beside,
        bound_to=bound_to,
    )
    return [] if isinstance(back, TriSurface) else renamed + left_out(mesh, back.mesh)


def require_certified(mesh: TetMesh, certificate: Mapping[str, Any], path: Path, *, uncertified: bool) -> None:
    """Raise StageError if a certificate is of another mesh, or if it fails the mesh and `uncertified` is false."""
    if certificate.get("mesh_sha256") not in (None, mesh_sha256(mesh)):
        raise StageError("the certificate is of another mesh", file=final_name(path), remedy="certify this one first")
    if not certificate["certified"] and not uncertified:
        raise StageError(
            "not certified, so not exported: " + "; ".join(certificate["reasons"]),
            file=final_name(path),
            remedy="set export.uncertified: true to write it anyway",
        )


def _write_verified(
    content: TetMesh | TriSurface,
    path: Path,
    *,
    solver: str,
    unit: str,
    frame: CoordinateFrame | None,
    sources: Mapping[str, FieldSource],
    interior: str | None,
    made_from: Mapping[str, Any] | None = None,
    body: bool = True,
    beside: Matrices | None = None,
    bound_to: str = "",
) -> AsRead | TriSurface:
    """Write and verify a file; returns what was read back. `body` is false for an uncertified mesh, which may overlap.

    Matrices `beside` are those of the mesh whose hash is `bound_to`.

    Raises StageError if the file breaks a convention of the solver.
    """
    may_write(sidecar_path(path))
    with atomic_folder(path) as folder:
        form = FORMATS[solver]
        if form.has_q and isinstance(content, TetMesh):
            content = with_q(content)
        write(content, folder / path.name, solver=solver, unit=unit, frame=frame)
        content = with_surface(content) if isinstance(content, TetMesh) else content
        as_read = form.as_read(folder / path.name)
        back = as_read if isinstance(as_read, TriSurface) else as_read.mesh
        broken = problems(as_read, body=body)
        if form.has_unit and unit == "mm":  # it was read as micrometres
            back = replace(back, points=1000 * back.points)
        if broken := broken or [*not_as_meant(content, back, form), *seen_otherwise(folder / path.name, solver, back)]:
            what = "the written file is not what the solver reads: " + "; ".join(broken)
            raise StageError(what, file=final_name(path))
        matrices = {} if beside is None or not isinstance(back, TetMesh) else beside(back)
        names = {name: f"{path.name}.{name}.npz" for name in matrices}
        for name, matrix in matrices.items():
            save_npz(folder / names[name], matrix)
        record = sidecar(
            back,
            nodes_sha256=array_sha256((as_read if isinstance(as_read, TriSurface) else as_read.mesh).points),
            solver=solver,
            files=sorted(folder.iterdir()),
            unit=unit if FORMATS[solver].has_unit else "mm",
            frame=frame or CoordinateFrame(),
            sources=sources,
            interior=interior,
            made_from=made_from,
            meant=content,
        )
        if names:
            record["map"] = {**names, "mesh_sha256": bound_to}
        for file in folder.iterdir():
            may_write(path.with_name(file.name))  # check before deleting anything
        delete_made(sidecar_path(path))  # an earlier export of this name may have had other sets
        write_json(record, sidecar_path(folder / path.name))
    return as_read


def write(
    content: TetMesh | TriSurface, path: Path, *, solver: str, unit: str = "um", frame: CoordinateFrame | None = None
) -> None:
    """Write a mesh, or its boundary, in one format, without verifying the file."""
    form = FORMATS[solver]
    if form.is_surface:
        surface = content if isinstance(content, TriSurface) else _boundary(content)
        form.write(replace(surface, frame=frame or CoordinateFrame()), path)
    else:
        form.write(content, path, **({"unit": unit} if form.has_unit else {}))


def _boundary(mesh: TetMesh) -> TriSurface:
    """The boundary with its fields."""
    surface, nodes = boundary_surface(mesh)
    return replace(surface, point_data={name: values[nodes] for name, values in mesh.point_data.items()})


def convert(
    source: Path, target: Path, *, unit: str = "um", source_unit: str | None = None, tags: str | None = None
) -> list[str]:
    """Convert a mesh file to the format that the name of `target` selects, and verify the written file.

    Nodes are renumbered if those of the surface do not come first; a mesh without sets gets the default sets. If
    `source` has a sidecar, units, coordinate system and sources of fields come from there.

    Parameters
    ----------
    unit : of the coordinates of a CARP file that is written, mm or um
    source_unit : one of `UNITS`, of the coordinates of `source`; None: as its sidecar says, else um for CARP and mm for
        other formats, and a mesh that then has not the size of a brain is refused
    tags : field of tetrahedra whose labels take the place of the regions (`sets.tagged`)

    Returns
    -------
    what was changed on the way, in words

    Raises
    ------
    InputError
        a file name selects no format; or `source` cannot be read, holds a surface although `target` is a mesh, has
        inverted tetrahedra, has not the size of a brain, or holds tetrahedra that fill no body
    StageError
        the mesh has tetrahedra without volume, or the written file breaks a convention of its solver
    """
    read_from, written_as = format_of(source), format_of(target)
    record = read_sidecar(source)
    done = [f"{source.name} was {CHANGED}"] if changed_since(source) else []
    if read_from.is_surface:
        if not written_as.is_surface:
            raise InputError("holds a surface, not a mesh", file=source, remedy="`cortet mesh` fills it")
        content = read_from.read(source)
    else:
        content = _in_mm(read_from, source, record, source_unit)
        require_body(content, source, holes=True)
        surface_nodes = boundary_nodes(content)
        if surface_nodes[-1] != len(surface_nodes) - 1:
            content = surface_nodes_first(content)[0]
            done.append("nodes were renumbered, those of the surface first")
        content, what = numbered_today(without_q(content), record)
        done += what
        if not content.sets.faces:
            content, how = _with_face_sets(content)
            done.append(how)
        content = with_surface(content)  # its groups of faces may be parts of the surface, as in files of Gmsh
        content = tagged(content, tags) if tags else content
        content, renamed = writable(content, written_as.name)
        done += renamed
    frame = record.get("coordinate_system")
    known = getattr(content, "frame", None)
    back = _write_verified(
        content,
        target,
        solver=written_as.name,
        unit=unit,
        frame=CoordinateFrame(**{**frame, "matrix": tuple(frame["matrix"])}) if frame else known,
        sources={name: _source(field) for name, field in record.get("fields", {}).items() if field["source"]},
        interior=next((field["interior"] for field in record.get("fields", {}).values()), None),
        made_from=moved(record.get("made_from"), source.parent, target.parent),
    )
    if isinstance(content, TetMesh) and not isinstance(back, TriSurface):
        done += left_out(content, back.mesh)
    return done


def _in_mm(form: Format, source: Path, record: Mapping[str, Any], unit: str | None) -> TetMesh:
    """The mesh of a file in mm; InputError if it cannot be one of a brain."""
    known = record.get("units", {}).get("coordinates")
    if unit and known and unit != known:
        what = f"has coordinates in {known}, as its sidecar says, not in {unit}"
        raise InputError(what, file=source, remedy="leave --source-unit out")
    if form.has_unit:
        unit = unit or known or "um"
    if form.has_unit and unit in ("mm", "um"):
        mesh = form.read(source, unit=unit)
    else:
        mesh = form.read(source, **({"unit": "mm"} if form.has_unit else {}))
        mesh = replace(mesh, points=UNITS[unit or "mm"] * mesh.points)
    volumes = signed_volumes(mesh.points, mesh.cells)
    if wrong := int((volumes <= 0).sum()):
        what = f"{wrong} of its {len(volumes)} tetrahedra are inverted or have no volume"
        raise InputError(what, file=source, remedy="`cortet improve` turns inverted ones, given the surface")
    if unit is None and not record:
        try:
            require_size(np.ptp(mesh.points, axis=0), float(volumes.sum()) / 1000, option="--source-unit")
        except InputError as error:
            remedy = f"{error.remedy}; --source-unit mm takes any size"
            raise InputError(error.what, file=source, remedy=remedy) from None
    return mesh


def _with_face_sets(mesh: TetMesh) -> tuple[TetMesh, str]:
    """The mesh with sets of faces, which its file does not hold; and how they were made, in words.

    Its own sets of nodes and tetrahedra stay. A face belongs to a set if all its nodes do. If they belong to both the
    cortical surface and the medial wall, the face belongs to the medial wall.
    """
    own = mesh.sets
    if not own.nodes and not own.cells:
        return named_sets(mesh), "it has no sets: the default ones were made"
    faces = boundary_faces(mesh)
    inside = {name: np.isin(faces, nodes).all(axis=1) for name, nodes in own.nodes.items()}
    wall = inside.get(MEDIAL_WALL, np.zeros(len(faces), bool))
    inside[CORTICAL_SURFACE] = ~wall
    made = {name: faces[chosen] for name, chosen in inside.items() if chosen.any()}
    nodes = own.nodes | {name: np.unique(made[name]) for name in (CORTICAL_SURFACE, MEDIAL_WALL) if name in made}
    cells = own.cells or named_sets(mesh).sets.cells
    return replace(mesh, sets=MeshSets(nodes, made, cells)), "sets of faces were made of its sets of nodes"


def _source(field: Mapping[str, Any]) -> FieldSource:
    """Where a field came from, as a sidecar records it."""
    return FieldSource(field["source"], field["source_sha256"], field["units"], field["kind"], {})
