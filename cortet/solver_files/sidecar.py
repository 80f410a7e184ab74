"""The JSON file beside an exported mesh: what the mesh holds, where it came from, and the hashes that identify it.

`<file>.json` names units, coordinate system, sets and the source of each field. It also holds the SHA-256 of each file
of the export, so that it tells a file that was changed since.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.hashing import sha256
from cortet.formats.ownership import files_of, record_of
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import face_tags, regions
from cortet.formats.untrusted import by_library, content
from cortet.geometry.topology import boundary_faces, face_areas
from cortet.measure.layers import UNITS
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, TetMesh, TriSurface
from cortet.solver_files.fields import FieldSource
from cortet.stages.transfer import THICKNESS

#: message for a file that differs from what its sidecar records
CHANGED = "changed after cortet wrote it, so its certificate does not apply (one of its files differs or is missing)"


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
    known, units = sources or {}, {THICKNESS: "mm", **(UNITS if (made_from or {}).get("layers") else {})}
    fields = {
        name: _field(values, known.get(name), units.get(name, "unknown")) for name, values in content.point_data.items()
    }
    return record | {
        "boundary_faces": len(faces),
        "surface_area_mm2": float(face_areas(content.points, faces).sum()),
        "fields": fields,
    }


def read_sidecar(path: Path) -> dict[str, Any]:
    """Content of the sidecar of a mesh file; empty if there is none, or a JSON file of another program."""
    file = sidecar_path(path)
    if not file.exists():
        return {}
    with by_library("JSON", file):
        record: dict[str, Any] = json.loads(content(file))
    return record if files_of(file) else {}


def changed_since(path: Path) -> bool:
    """Whether a file, or one that belongs to it, differs from the sidecar, so that no certificate beside it applies.

    A file that was renamed, with its sidecar, is known by its content.
    """
    recorded = files_of(sidecar_path(path))
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
