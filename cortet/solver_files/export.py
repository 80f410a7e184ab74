"""Export of a mesh to a solver, if it is certified and keeps the conventions of solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cortet.errors import InputError, StageError
from cortet.formats import FORMATS, format_of, read_mesh
from cortet.formats.atomic import atomic_folder, write_json
from cortet.formats.certificates import is_edited
from cortet.formats.hashing import mesh_sha256
from cortet.formats.ownership import final_name, may_write
from cortet.formats.placement import UNITS
from cortet.formats.surface_sets import CORTICAL_SURFACE, INTERFACE, MEDIAL_WALL, OUTER_SURFACE, with_surface
from cortet.geometry.filling import require_body
from cortet.geometry.topology import boundary_faces, boundary_nodes, boundary_with_fields
from cortet.measure.electrodes import ELECTRODE
from cortet.measure.layers import DEPTH, cortex_and_white
from cortet.measure.layers import UNITS as LAYER_UNITS
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, MeshSets, TetMesh, TriSurface
from cortet.solver_files.conventions import broken_conventions
from cortet.solver_files.fields import FieldSource, field_sources, with_q, without_q
from cortet.solver_files.meshed import (
    Origin,
    certificate_beside,
    certificate_file,
    is_named_uncertified,
    moved,
    uncertified_path,
)
from cortet.solver_files.names import held, left_out, writable
from cortet.solver_files.sets import OF_ARRAYS, named_sets, require_same_regions, tagged
from cortet.solver_files.sidecar import CHANGED, changed_since, read_sidecar, sidecar, sidecar_path
from cortet.stages.gate import require_size
from cortet.stages.solver_ready import surface_nodes_first
from cortet.stages.transfer import THICKNESS, with_thickness

VERSION: int = 10


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
    named = named_sets(mesh, **sets, inner=list(surface.inner), label_names=names, tissues=labels)
    return named, _computed(named, surface) | sources


def _computed(mesh: TetMesh, surface: TriSurface) -> dict[str, FieldSource]:
    """What each field is that cortet computed for a mesh of these surfaces, in words in place of a file."""
    how = dict.fromkeys([name for name in mesh.point_data if name.startswith(ELECTRODE)], "load of a contact")
    if DEPTH in mesh.cell_data:
        how |= dict.fromkeys(LAYER_UNITS, "columns of the cortex")
    if with_thickness(surface) is not surface:
        how[THICKNESS] = "distance between the vertices of both surfaces that have the same number"
    units = {**LAYER_UNITS, THICKNESS: "mm"}
    return {
        name: FieldSource(f"computed by cortet: {words}", "", units.get(name, "1"), "scalar", {})
        for name, words in how.items()
    }


def export_made(
    mesh: TetMesh,
    surface: TriSurface,
    path: Path,
    *,
    certificate: Mapping[str, Any],
    uncertified: bool,
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
    uncertified : write the mesh even if it is not certified
    arguments : `Config.export_arguments`
    temporary : folder that holds the surfaces that were meshed, and gets the files; all of them move to that of `path`
    """
    require_certified(mesh, certificate, path, uncertified=uncertified)
    named, sources = with_sets(mesh, surface, origin, sets=sets, labels=labels)
    made_from = origin.made_from(path.parent, temporary) | {"mesh_sha256": certificate["mesh_sha256"]}
    if sets.get("layers") and cortex_and_white(mesh, surface.inner) is not None:
        made_from["layers"] = sets["layers"]
    target = temporary / path.name if temporary else path
    return export(named, target, **arguments, frame=surface.frame, sources=sources, made_from=made_from)


def require_certified(mesh: TetMesh, certificate: Mapping[str, Any], path: Path, *, uncertified: bool) -> None:
    """Raise StageError if a certificate is of another mesh, or if it fails the mesh and `uncertified` is false."""
    if certificate.get("mesh_sha256") not in (None, mesh_sha256(mesh)):
        raise StageError(
            "the certificate is of a different mesh",
            file=final_name(path),
            remedy="certify this one first; in the workflow, by `snakemake --forcerun solver_ready`",
        )
    if not certificate["certified"] and not uncertified:
        raise StageError(
            "not exported, because the mesh is not certified: " + "; ".join(certificate["reasons"]),
            file=final_name(path),
            remedy="set export.uncertified: true to write it under a name that says so",
        )


def export(
    mesh: TetMesh,
    path: Path,
    *,
    solver: str,
    unit: str = "um",
    source: Path | None = None,
    **about: Any,
) -> list[str]:
    """Write `path`, the files that belong to it and its sidecar, complete or not at all.

    Parameters
    ----------
    mesh : from `stages.solver_ready`, with its sets (`sets.named_sets`)
    solver : a key of `formats.FORMATS`
    unit : unit of the coordinates, ``mm`` or ``um``, for formats that do not state it
    source : file that an error names; None: that of the mesh
    about : `frame`, `sources` and `made_from`, as `sidecar.sidecar` takes them

    Returns
    -------
    which fields and sets the format cannot hold, or not by their names, in words

    Raises
    ------
    StageError : the mesh breaks a convention of solvers
    """
    form = FORMATS[solver]
    mesh, renamed = writable(mesh, solver)
    mesh = with_q(mesh) if form.has_q else mesh
    if broken := broken_conventions(with_surface(mesh)):
        raise StageError("solvers cannot read this mesh: " + "; ".join(broken), file=source or final_name(path))
    kept = held(mesh, form.holds, groups=form.has_groups)
    may_write(sidecar_path(path))
    # an earlier export of this name may have had other sets
    with atomic_folder(path, replaced=[sidecar_path(path)]) as folder:
        form.write(mesh, folder / path.name, unit=unit, frame=about.get("frame"))
        content = boundary_with_fields(kept) if form.is_surface else kept
        stated = unit if form.has_unit else "mm"
        record = sidecar(content, mesh, solver=solver, files=sorted(folder.iterdir()), unit=stated, **about)
        write_json(record, sidecar_path(folder / path.name))
    return [] if form.is_surface else renamed + left_out(mesh, kept)


def convert(
    source: Path, target: Path, *, unit: str = "um", source_unit: str | None = None, tags: str | None = None
) -> list[str]:
    """Convert a mesh file to the format that the name of `target` selects.

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
    InputError : `source` cannot be read as a mesh of a brain in mm, or the certificate beside it fails it, and the name
        of `target` does not end with `_uncertified`
    """
    form, record = format_of(target), read_sidecar(source)
    done = [f"{source.name} was {CHANGED}"] if changed_since(source) else []
    mesh = _in_mm(source, record, source_unit)
    refuse_failed(mesh, source, target)
    require_body(mesh, source)
    if source.suffix in OF_ARRAYS:
        require_same_regions(mesh, list((record.get("made_from") or {}).get("meshed") or {})[1:], source)
    surface_nodes = boundary_nodes(mesh)
    if surface_nodes[-1] != len(surface_nodes) - 1:
        mesh = surface_nodes_first(mesh)[0]
        done.append("nodes were renumbered so that surface nodes come first")
    if not mesh.sets.faces:
        mesh, how = _with_face_sets(mesh)
        done.append(how)
    mesh = with_surface(mesh)  # its groups of faces may be parts of the surface, as in files of Gmsh
    mesh = tagged(mesh, tags) if tags else mesh
    stored, fields = record.get("coordinate_system"), record.get("fields", {})
    about = {
        "frame": CoordinateFrame(**{**stored, "matrix": tuple(stored["matrix"])}) if stored else None,
        "sources": {name: _source(field) for name, field in fields.items()},
        "made_from": moved(record.get("made_from"), source.parent, target.parent),
    }
    return done + export(mesh, target, solver=form.name, unit=unit, source=source, **about)


def refuse_failed(mesh: TetMesh, source: Path, target: Path) -> None:
    """Raise InputError if the certificate beside a mesh fails it or was edited, unless the name of `target` says so."""
    if is_named_uncertified(target):
        return
    certificate = certificate_beside(source)
    failed = [check.get("name", "a check") for check in certificate.get("checks", ()) if not check.get("passed")]
    if is_edited(certificate_file(source)):
        raise InputError(
            "its certificate is damaged or edited, so nobody knows whether it is certified",
            file=source,
            remedy=f"mesh the surface again, or write to {uncertified_path(target).name}",
        )
    if is_named_uncertified(source) or (failed and certificate.get("mesh_sha256") == mesh_sha256(mesh)):
        raise InputError(
            "is not certified" + (f" ({'; '.join(failed)})" if failed else ""),
            file=source,
            remedy=f"to convert it anyway, write to {uncertified_path(target).name}",
        )


def _in_mm(source: Path, record: Mapping[str, Any], unit: str | None) -> TetMesh:
    """The mesh of a file in mm, without q; InputError if it cannot be one of a brain."""
    known = record.get("units", {}).get("coordinates")
    if unit and known and unit != known:
        what = f"has coordinates in {known} according to its sidecar, not in {unit}"
        raise InputError(what, file=source, remedy="leave --source-unit out")
    stored = unit or known or ("um" if source.suffix == ".pts" else "mm")
    mesh = without_q(read_mesh(source, unit="mm"))
    if stored != "mm":
        mesh = replace(mesh, points=mesh.points * UNITS[stored])
    volumes = signed_volumes(mesh.points, mesh.cells)
    if wrong := int((volumes <= 0).sum()):
        what = f"{wrong} of its {len(volumes)} tetrahedra are inverted or have no volume"
        raise InputError(what, file=source, remedy="`cortet improve` turns inverted tetrahedra; it needs the surface")
    if not record:
        option = "add --source-unit {unit}"
        require_size(mesh, file=source, to_mm=UNITS[stored], stated=unit is not None, option=option)
    return mesh


def _with_face_sets(mesh: TetMesh) -> tuple[TetMesh, str]:
    """The mesh with sets of faces, which its file does not hold; and how they were made, in words.

    Its own sets of nodes and tetrahedra stay. A face belongs to a set if all its nodes do. If they belong to both the
    cortical surface and the medial wall, the face belongs to the medial wall.
    """
    own = mesh.sets
    if not own.nodes and not own.cells:
        return named_sets(mesh), "it has no sets, so cortet made the default sets"
    faces = boundary_faces(mesh)
    inside = {name: np.isin(faces, nodes).all(axis=1) for name, nodes in own.nodes.items()}
    wall = inside.get(MEDIAL_WALL, np.zeros(len(faces), bool))
    if OUTER_SURFACE not in inside:  # else a region lies around the brain, whose surface is no part of the boundary
        inside[CORTICAL_SURFACE] = ~wall
    made = {name: faces[chosen] for name, chosen in inside.items() if chosen.any()}
    nodes = own.nodes | {name: np.unique(made[name]) for name in (CORTICAL_SURFACE, MEDIAL_WALL) if name in made}
    cells = own.cells or named_sets(mesh).sets.cells
    lost = [name for name in nodes if name.endswith(INTERFACE) and name not in made]
    made_from = "its sets of nodes" if own.nodes else "its boundary"
    how = f"cortet made sets of faces from {made_from}"
    if lost:
        how += f", but none of {', '.join(lost)}, which lie inside the mesh"
    return replace(mesh, sets=MeshSets(nodes, made, cells)), how


def _source(field: Mapping[str, Any]) -> FieldSource:
    """Where a field came from, as a sidecar records it."""
    return FieldSource(field["source"], field["source_sha256"], field["units"], field["kind"], {})
