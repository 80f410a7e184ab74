"""The JSON file beside an exported mesh: what the mesh holds, where it came from, and the hashes that identify it.

`<file>.json` names units, coordinate system, sets and the source of each field. It also holds the SHA-256 of the nodes
and of the values of each field, as they are read back. So it exposes fields of another mesh, or of an earlier state of
this mesh.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from cortet.errors import InputError
from cortet.formats.hashing import array_sha256, input_sha256, sha256
from cortet.formats.ownership import files_of, record_of
from cortet.formats.tags import face_tags, regions
from cortet.formats.untrusted import content
from cortet.geometry.topology import boundary_faces, face_areas
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, TetMesh, TriSurface
from cortet.solver_files.fields import FieldSource
from cortet.stages.transfer import THICKNESS

#: message for a file that differs from what its sidecar records
CHANGED = "changed after cortet wrote it: no certificate beside it is of it (a file of it is another one, or missing)"


def sidecar_path(path: Path) -> Path:
    """The JSON file beside a mesh file; InputError for a path without a name."""
    if not path.name:
        raise InputError("is a folder", file=path, remedy="name a mesh file")
    return path.with_name(path.name + ".json")


def sidecar(
    as_read: TetMesh | TriSurface,
    *,
    nodes_sha256: str,
    solver: str,
    files: Iterable[Path],
    unit: str,
    frame: CoordinateFrame,
    sources: Mapping[str, FieldSource],
    interior: str | None,
    made_from: Mapping[str, Any] | None = None,
    meant: TetMesh | TriSurface | None = None,
) -> dict[str, Any]:
    """Content of the sidecar.

    Parameters
    ----------
    as_read : the mesh, read back from the file, in mm
    nodes_sha256 : of the nodes as `verify` reads them, whatever the unit of the file
    files : files of the export
    unit : unit of the coordinates in the file
    frame : coordinate system of the surface the mesh was made from
    sources : name of a field -> where it came from
    interior : how interior nodes got their values; None if that is not known
    made_from : from `meshed.made_from`
    meant : the mesh that was written, with the names of regions that a format may not hold; default: as it was read
    """
    record: dict[str, Any] = {
        "format": solver,
        **record_of(files),
        "units": {"coordinates": unit},
        "coordinate_system": asdict(frame),
        "nodes": len(as_read.points),
        "nodes_sha256": nodes_sha256,
    }
    if made_from:
        record["made_from"] = dict(made_from)
    if isinstance(as_read, TetMesh):
        faces = boundary_faces(as_read)
        record |= {
            "tetrahedra": len(as_read.cells),
            "volume_mm3": float(signed_volumes(as_read.points, as_read.cells).sum()),
            "regions": regions(meant if isinstance(meant, TetMesh) else as_read),
            "surface": face_tags(as_read),
            "sets": {
                kind: {name: len(members) for name, members in sets.items()}
                for kind, sets in vars(as_read.sets).items()
            },
        }
    else:
        faces = as_read.faces
    record |= {
        "boundary_faces": len(faces),
        "surface_area_mm2": float(face_areas(as_read.points, faces).sum()),
        "fields": {name: _field(name, values, sources, interior) for name, values in as_read.point_data.items()},
    }
    return record


class _Field(BaseModel):
    """The part of a field's record that is read."""

    source: str
    source_sha256: str
    units: str
    kind: Literal["label", "scalar", "unknown"]
    interior: str
    values_sha256: str


class _Frame(BaseModel, extra="forbid"):
    dataspace: str
    xformspace: str
    matrix: Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=16, max_length=16)]


class _Surface(BaseModel):
    file: str
    sha256: str


class _MadeFrom(BaseModel):
    """The part of a mesh's origin that is read."""

    given: dict[str, _Surface]
    meshed: dict[str, _Surface]
    hemisphere: Literal["L", "R"] | None = None
    gestational_age: Annotated[float, Field(strict=True, allow_inf_nan=False)] | None = None
    holes: list[str] = []


class _Record(BaseModel):
    """The part of a sidecar, of whatever origin, that is read."""

    fields_: dict[str, _Field] = Field(alias="fields")
    nodes_sha256: str
    files: dict[str, str] = {}
    units: dict[str, str] = {}
    sets: dict[str, dict[str, int]] = {}
    coordinate_system: _Frame | None = None
    made_from: _MadeFrom | None = None


def read_sidecar(path: Path) -> dict[str, Any]:
    """Content of the sidecar of a mesh file; empty if there is none.

    Raises
    ------
    InputError
        the file of that name is not a sidecar
    """
    file = sidecar_path(path)
    if not file.exists():
        return {}
    try:
        record: dict[str, Any] = json.loads(content(file))
        _Record.model_validate(record)
    except ValidationError as error:
        wrong = ", ".join(".".join(map(str, one["loc"])) for one in error.errors())
        raise InputError(
            f"is not a sidecar: wrong or missing {wrong}", file=file, remedy="export the mesh again"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not a sidecar: {error}", file=file, remedy="export the mesh again") from error
    return record


def changed_since(path: Path) -> bool:
    """Whether a file, or one that belongs to it, differs from the sidecar, so that no certificate beside it applies.

    A file that was renamed, with its sidecar, is known by its content.
    """
    recorded = files_of(sidecar_path(path))
    if path.name not in recorded:
        return bool(recorded) and sha256(path) not in recorded.values()
    beside = {path.with_name(name): digest for name, digest in recorded.items()}
    return any(not file.is_file() or sha256(file) != digest for file, digest in beside.items())


def stale(path: Path, as_read: TetMesh | TriSurface) -> Iterator[str]:
    """Differences between a file and its sidecar, in words; none if there is no sidecar."""
    record = read_sidecar(path)
    if not record:
        return
    fields, nodes, sets = record["fields"], record["nodes_sha256"], record.get("sets", {})
    if nodes != array_sha256(as_read.points):
        yield "the nodes are not those that the sidecar records: the fields belong to other nodes"
    for kind, recorded in sets.items():
        found = vars(as_read.sets).get(kind, {}) if isinstance(as_read, TetMesh) else {}
        for name, count in recorded.items():
            if len(found.get(name, ())) != count:
                yield f"set {name} has {len(found.get(name, ()))} {kind}, the sidecar records {count}"
    for name in as_read.point_data.keys() - fields.keys():
        yield f"field {name} is not in the sidecar: its source is not known"
    for name, field in fields.items():
        if name not in as_read.point_data:
            yield f"field {name} of the sidecar is missing"
        elif field["values_sha256"] != array_sha256(as_read.point_data[name]):
            yield f"field {name} is stale: its values are not those that the sidecar records"
        elif (
            field["source"]
            and os.path.isfile(field["source"])  # noqa: PTH113, false of names that are too long; no device, which has no end
            and input_sha256(field["source"]) != field["source_sha256"]
        ):
            yield f"field {name} is stale: {field['source']} has changed since"


def _field(name: str, values: NDArray[Any], sources: Mapping[str, FieldSource], interior: str | None) -> dict[str, Any]:
    """Record of a field; a component `<name>_2` has the source of `<name>`."""
    source = sources.get(name) or sources.get(name.rpartition("_")[0])
    return {
        "components": int(values[0].size) if len(values) else 1,
        "units": source.units if source else "mm" if name == THICKNESS else "unknown",
        "kind": source.kind if source else "unknown",
        "source": source.file if source else "",
        "source_sha256": source.sha256 if source else "",
        "boundary": {"label": "label of the largest barycentric weight", "scalar": "barycentric"}.get(
            source.kind if source else "", "unknown"
        ),
        "interior": "unknown"
        if source is None or interior is None
        else "nearest"
        if source.kind == "label"
        else interior,
        "values_sha256": array_sha256(values),
    }
