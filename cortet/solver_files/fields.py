"""Per-vertex fields in separate files beside a surface, and the source of each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, counted
from cortet.formats.gifti import read_fields, read_label_names
from cortet.formats.hashing import input_sha256
from cortet.measure.quality import quality
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.transfer import THICKNESS

#: name of the field of tetrahedra that files for viewers have
Q = "q"


@dataclass(frozen=True)
class FieldSource:
    """Where a field came from."""

    file: str
    sha256: str
    #: units of the values, `unknown` for those of most files
    units: str
    kind: Literal["label", "scalar"]
    #: key -> name of a label, as the file states it
    labels: dict[int, str]


def with_fields(surface: TriSurface, files: Mapping[str, str | Path]) -> TriSurface:
    """The surface with the fields of .shape, .func or .label GIfTI files added to its `point_data`.

    Parameters
    ----------
    files : name of the field -> file; in a file with several arrays each becomes a field `<name>_<array's name>`
    """
    fields = dict(surface.point_data)
    for name, file in files.items():
        for field, values in _named(name, file):
            if len(values) != len(surface.points):
                raise InputError(
                    f"{len(values)} values for {len(surface.points)} vertices",
                    file=file,
                    remedy="give a field of this surface",
                )
            require_finite(values, f"the field {field}", file)
            fields[field] = values
    return replace(surface, point_data=fields)


def with_q(mesh: TetMesh) -> TetMesh:
    """The mesh with `q` of each tetrahedron, (m,) float32 for files of half the size, in place of a field so named."""
    q = quality(mesh.points, mesh.cells).astype(np.float32)
    return replace(mesh, cell_data={**mesh.cell_data, Q: q})


def without_q(mesh: TetMesh) -> TetMesh:
    """The mesh of a file without the field `q`, which would not follow its tetrahedra as they change."""
    return replace(mesh, cell_data={name: values for name, values in mesh.cell_data.items() if name != Q})


def require_finite(values: NDArray[Any], what: str, file: str | Path | None = None) -> None:
    """Raise InputError for values (n,) or (n, k) of vertices that are not all finite.

    Parameters
    ----------
    what, file : what the message calls the values, and their file
    """
    per_vertex = np.isfinite(values).reshape(len(values), -1) if values.size else np.empty((0, 1), bool)
    bad = np.flatnonzero(~per_vertex.all(axis=1))
    if len(bad):
        raise InputError(
            f"{what} is not finite at {counted(len(bad), 'vertex', 'vertices')}, the first is vertex {bad[0]}",
            file=file,
            remedy="give these vertices a value, such as 0 on the medial wall: no solver reads NaN",
        )


def field_sources(files: Mapping[str, str | Path]) -> dict[str, FieldSource]:
    """The source of each field that `with_fields` makes from these files; `thickness` is in mm."""
    return {
        field: FieldSource(
            file=str(file),
            sha256=input_sha256(file),
            units="mm" if THICKNESS in (field, name) else "unknown",
            kind="label" if np.issubdtype(values.dtype, np.integer) else "scalar",
            labels=read_label_names(file),
        )
        for name, file in files.items()
        for field, values in _named(name, file)
    }


def _named(name: str, file: str | Path) -> Iterator[tuple[str, NDArray[Any]]]:
    """The fields of one file, by names without spaces and signs that a solver may not read."""
    arrays = read_fields(file)
    if not arrays:
        raise InputError("holds no per-vertex array", file=file, remedy="give a .shape, .func or .label GIfTI file")
    for own_name, values in arrays.items():
        full = name if len(arrays) == 1 else f"{name}_{own_name}"
        yield re.sub(r"[^A-Za-z0-9_-]+", "_", full), values
