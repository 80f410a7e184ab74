"""The JSON file beside an exported mesh: what the mesh holds, where it came from, and the hashes that identify it.

`<file>.json` names units, coordinate system, sets and the source of each field. It also holds the SHA-256 of each file
of the export, so that it tells a file that was changed since.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cortet.errors import InputError
from cortet.formats.hashing import sha256
from cortet.formats.ownership import files_of, is_record, record_of
from cortet.formats.placement import UNITS as LENGTHS
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import face_tags, regions
from cortet.formats.untrusted import by_library, content
from cortet.geometry.topology import boundary_faces, face_areas
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, TetMesh, TriSurface
from cortet.solver_files.fields import FieldSource
from cortet.stages.transfer import THICKNESS

#: message for a file that differs from what its sidecar records
CHANGED = "changed after cortet wrote it, so its certificate does not apply (one of its files differs or is missing)"


class _Part(BaseModel):
    """A part of a sidecar, of which the readers ask for these keys; others are anything."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Surface(_Part):
    file: str = Field(min_length=1, pattern=r"^[^\x00]*$")
    sha256: str


class _MadeFrom(_Part):
    given: dict[str, _Surface] = {}
    meshed: dict[str, _Surface] = {}
    hemisphere: Literal["L", "R"] | None = None
    gestational_age: float | None = None
    surface: str | None = None
    layers: list[float] | None = None


class _FieldSource(_Part):
    source: str
    source_sha256: str
    units: str
    kind: str


class _Units(_Part):
    coordinates: Literal[tuple(LENGTHS)]  # type: ignore[valid-type]


class _System(_Part):
    model_config = ConfigDict(extra="forbid")

    dataspace: str
    xformspace: str
    matrix: list[float] = Field(min_length=16, max_length=16)


class _Sidecar(_Part):
    files: dict[str, str]
    units: _Units | None = None
    coordinate_system: _System | None = None
    made_from: _MadeFrom | None = None
    fields: dict[str, _FieldSource] = {}


def sidecar_path(path: Path) -> Path:
    """The JSON file beside a mesh file; InputError for a path without a name."""
    if not path.name:
        raise InputError("is a folder", file=path, remedy="name a mesh file")
    return path.with_name(path.name + ".json")


def sidecar(
    content: TetMesh | TriSurface,
    meant: TetMesh,
    *,
    solver: str,
    files: Iterable[Path],
    unit: str,
    frame: CoordinateFrame | None = None,
    sources: Mapping[str, FieldSource] | None = None,
    made_from: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Content of the sidecar.

    Parameters
    ----------
    content : what the files hold, in mm; the boundary for formats of surfaces
    meant : the mesh that was written, with the names that a format may not hold
    frame : coordinate system of the surface the mesh was made from
    sources : name of a field -> where it came from
    made_from : from `meshed.made_from`
    """
    record: dict[str, Any] = {
        "format": solver,
        **record_of(files),
        "units": {"coordinates": unit},
        "coordinate_system": asdict(frame or CoordinateFrame()),
        "nodes": len(content.points),
    }
    if made_from:
        record["made_from"] = dict(made_from)
    if isinstance(content, TetMesh):
        record |= {
            "tetrahedra": len(content.cells),
            "volume_mm3": float(signed_volumes(content.points, content.cells).sum()),
            "regions": regions(meant),
            "surface": face_tags(with_surface(meant)),
            "sets": {
                kind: {name: len(members) for name, members in sets.items()}
                for kind, sets in vars(content.sets).items()
            },
        }
    faces = boundary_faces(content) if isinstance(content, TetMesh) else content.faces
    known, units = sources or {}, {THICKNESS: "mm"}
    fields = {
        name: _field(values, known.get(name), units.get(name, "unknown")) for name, values in content.point_data.items()
    }
    return record | {
        "boundary_faces": len(faces),
        "surface_area_mm2": float(face_areas(content.points, faces).sum()),
        "fields": fields,
    }


def read_sidecar(path: Path) -> dict[str, Any]:
    """Content of the sidecar of a mesh file; empty if there is none, or a JSON file of another program.

    Raises InputError for one that was damaged or edited to another form than `sidecar` gives it.
    """
    file = sidecar_path(path)
    if not file.exists():
        return {}
    with by_library("a sidecar", file):
        record: dict[str, Any] = json.loads(content(file))
        if not isinstance(record, dict) or not is_record(record):
            return {}
        try:
            _Sidecar.model_validate(record)
        except ValidationError as error:
            first = error.errors()[0]
            raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        if not files_of(file):
            raise ValueError("files: there are none, or one has no plain name")
    return record


def changed_since(path: Path) -> bool:
    """Whether a file, or one that belongs to it, differs from the sidecar, so that no certificate beside it applies.

    A file that was renamed, with its sidecar, is known by its content.
    """
    recorded = read_sidecar(path).get("files", {})
    if path.name not in recorded:
        return bool(recorded) and sha256(path) not in recorded.values()
    beside = {path.with_name(name): digest for name, digest in recorded.items()}
    return any(not file.is_file() or sha256(file) != digest for file, digest in beside.items())


def _field(values: NDArray[Any], source: FieldSource | None, units: str) -> dict[str, Any]:
    """Record of a field; `units` are those of a field without a source."""
    return {
        "components": int(values[0].size) if len(values) else 1,
        "units": source.units if source else units,
        "kind": source.kind if source else "unknown",
        "source": source.file if source else "",
        "source_sha256": source.sha256 if source else "",
    }
