"""Per-vertex fields that lie beside a surface in files of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cortet.errors import InputError
from cortet.formats.gifti import read_fields
from cortet.mesh import TriSurface


def with_fields(surface: TriSurface, files: Mapping[str, str | Path]) -> TriSurface:
    """The surface with the fields of .shape, .func or .label GIfTI files added to its `point_data`.

    Parameters
    ----------
    files : name of the field -> file; of a file with several arrays each becomes a field `<name>_<array's name>`

    Raises
    ------
    InputError
        a file cannot be read, holds no array, or another number of values than the surface has vertices
    """
    fields = dict(surface.point_data)
    for name, file in files.items():
        arrays = read_fields(file)
        if not arrays:
            raise InputError("holds no per-vertex array", file=file, remedy="give a .shape, .func or .label GIfTI file")
        for own_name, values in arrays.items():
            if len(values) != len(surface.points):
                raise InputError(
                    f"{len(values)} values for {len(surface.points)} vertices",
                    file=file,
                    remedy="give a field of this very surface",
                )
            fields[name if len(arrays) == 1 else f"{name}_{own_name}"] = values
    return replace(surface, point_data=fields)
