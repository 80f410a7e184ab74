"""The two things that flow through cortet: a closed triangulated surface and a tetrahedral mesh.

Both are frozen dataclasses of NumPy arrays; a stage returns a new one (`dataclasses.replace`) and the arrays
of an existing one are read-only. Quantities derived from the connectivity live in `cortet.geometry.topology`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


def _frozen(array: Any, dtype: type, columns: int, name: str) -> NDArray[Any]:
    """A read-only, C-ordered (n, columns) array of `dtype`; an array that already is one is shared, not copied."""
    result: NDArray[Any] = np.ascontiguousarray(array, dtype=dtype)
    if result.ndim != 2 or result.shape[1] != columns:
        raise ValueError(f"{name} must have shape (n, {columns}), got {result.shape}")
    if result.flags.writeable:
        if result is array:
            result = result.copy()
        result.flags.writeable = False
    return result


def _fields(fields: Mapping[str, Any], count: int, of: str) -> dict[str, NDArray[Any]]:
    """Fields with one value, or row of values, per node or cell, read-only; ValueError where one has another number."""
    result = {}
    for name, values in fields.items():
        array = np.asarray(values)
        if array.ndim == 0 or len(array) != count:
            raise ValueError(f"field {name} has shape {array.shape}, but there are {count} {of}")
        if array.flags.writeable:
            array = array.copy()
            array.flags.writeable = False
        result[name] = array
    return result


@dataclass(frozen=True)
class CoordinateFrame:
    """Where coordinates live, as GIfTI states it; carried from the input to every sidecar, never changed silently."""

    #: NIfTI transform code name of the stored coordinates, e.g. ``NIFTI_XFORM_SCANNER_ANAT``
    dataspace: str = "NIFTI_XFORM_UNKNOWN"
    #: code name of the space `matrix` leads to
    xformspace: str = "NIFTI_XFORM_UNKNOWN"
    #: row-major 4 x 4 affine from dataspace to xformspace
    matrix: tuple[float, ...] = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)


#: Name of the integer field that says in which region each tetrahedron lies, which is 0 between the boundary and the
#: inner surfaces, and i inside the i-th inner surface and in none that it contains
REGION = "region"
#: name of region 0; the others are named as the inner surfaces around them
OUTERMOST = "cortex"
#: name of the integer field of a repaired surface that is 1 on the cap of a filled hole
FILLED = "filled"


@dataclass(frozen=True, eq=False)
class TriSurface:
    """A triangulated surface; ValueError where an array has a wrong shape."""

    #: (n, 3) float64, vertex coordinates in mm
    points: FloatArray
    #: (m, 3) int32, vertex indices, counter-clockwise seen from outside
    faces: IntArray
    #: per-vertex fields, name -> (n,) or (n, k)
    point_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: coordinate system of `points`
    frame: CoordinateFrame = CoordinateFrame()
    #: closed surfaces inside this one, name of the region within -> surface; `geometry.nesting.nested` puts them there
    inner: dict[str, TriSurface] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _frozen(self.points, np.float64, 3, "points"))
        object.__setattr__(self, "faces", _frozen(self.faces, np.int32, 3, "faces"))
        object.__setattr__(self, "point_data", _fields(self.point_data, len(self.points), "vertices"))


def single_precision(surface: TriSurface) -> TriSurface:
    """The surface as a file holds it: coordinates rounded to float32."""
    return replace(surface, points=surface.points.astype(np.float32).astype(np.float64))


@dataclass(frozen=True, eq=False)
class MeshSets:
    """Named parts of a mesh, as solvers know them. A name may occur once among nodes, among faces and among cells."""

    #: name -> (k,) int32, nodes, ascending
    nodes: dict[str, IntArray] = field(default_factory=dict)
    #: name -> (k, 3) int32, boundary faces as node triples, counter-clockwise seen from outside
    faces: dict[str, IntArray] = field(default_factory=dict)
    #: name -> (k,) int32, tetrahedra, ascending
    cells: dict[str, IntArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class TetMesh:
    """A tetrahedral mesh; ValueError where an array has a wrong shape.

    Every one in memory has positive signed volumes, 0-based indices and no unused nodes.
    """

    #: (n, 3) float64, node coordinates in mm
    points: FloatArray
    #: (m, 4) int32, node indices; det(b - a, c - a, d - a) > 0
    cells: IntArray
    #: per-node fields, name -> (n,) or (n, k)
    point_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: per-element fields, name -> (m,) or (m, k)
    cell_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: named nodes, faces and tetrahedra; only meshes on their way to a solver have any
    sets: MeshSets = MeshSets()

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _frozen(self.points, np.float64, 3, "points"))
        object.__setattr__(self, "cells", _frozen(self.cells, np.int32, 4, "cells"))
        object.__setattr__(self, "point_data", _fields(self.point_data, len(self.points), "nodes"))
        object.__setattr__(self, "cell_data", _fields(self.cell_data, len(self.cells), "cells"))
