"""The two data types of cortet: a closed triangulated surface and a tetrahedral mesh.

Both are frozen dataclasses of NumPy arrays. A stage returns a new one (`dataclasses.replace`); the arrays of an
existing one are read-only. `cortet.geometry.topology` derives quantities from the connectivity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, counted

T = TypeVar("T")

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


def require_indices(indices: NDArray[Any], count: int, what: str, of: str) -> None:
    """Raise InputError unless indices are whole numbers from 0 to below `count`: compiled kernels do not check.

    Parameters
    ----------
    indices : (m,) or (m, k)
    what, of : names in messages, of a row of `indices` and of the things that it points to
    """
    if not indices.size:
        return
    if indices.dtype.kind not in "iu":
        raise InputError(
            f"{what} 0 is of type {indices.dtype}, not an integer: {indices[0].tolist()!r}", remedy="give integers"
        )
    if indices.min() < 0 or indices.max() >= count:
        first = int(np.flatnonzero(((indices < 0) | (indices >= count)).reshape(len(indices), -1).any(axis=1))[0])
        raise InputError(
            f"{what} {first} is {indices[first].tolist()}, but {of} are numbered from 0 to {count - 1}",
            remedy="number them from 0, and include all of them",
        )


def _plain(array: Any, name: str) -> NDArray[Any]:
    """An array without a mask; InputError if a value is masked, since what is below a mask may be anything."""
    if np.ma.is_masked(array):
        count = int(np.ma.getmaskarray(array).sum())
        raise InputError(f"{counted(count, 'value')} of {name} masked", remedy="leave these out, or fill them")
    return np.asarray(array)


def _rows(array: Any, columns: int, name: str) -> NDArray[Any]:
    """An array (n, columns), not yet converted: conversion would wrap or truncate values that do not fit."""
    given = _plain(array, name)
    if given.ndim != 2 or given.shape[1] != columns:
        raise InputError(
            f"{name} must have shape (n, {columns}), got {given.shape}", remedy=f"give {columns} numbers in each row"
        )
    return given


def _frozen(array: NDArray[Any], dtype: type | None = None) -> NDArray[Any]:
    """A read-only, C-ordered array of `dtype`; an array that already is one is shared, not copied."""
    result: NDArray[Any] = np.ascontiguousarray(array, dtype=dtype)
    if result.flags.writeable:
        if result is array:
            result = result.copy()
        result.flags.writeable = False
    return result


def _points(array: Any) -> FloatArray:
    """Coordinates (n, 3), frozen."""
    given = _rows(array, 3, "points")
    if given.dtype.kind not in "fiu":
        raise InputError(f"points are of type {given.dtype}", remedy="give real numbers")
    return _frozen(given, np.float64)


def _corners(array: Any, columns: int, name: str, count: int, what: str, of: str) -> IntArray:
    """Indices (m, columns) of `count` points, frozen."""
    given = _rows(array, columns, name)
    require_indices(given, count, what, of)
    return _frozen(given, np.int32)


def _fields(fields: Mapping[str, Any], count: int, of: str) -> dict[str, NDArray[Any]]:
    """Fields with one value, or row of values, per node or cell, read-only; InputError if one has another number."""
    result = {}
    for name, values in fields.items():
        array = _plain(values, f"the field {name}")
        if array.ndim == 0 or len(array) != count:
            what = f"field {name} has shape {array.shape}, which does not match the {count} {of}"
            raise InputError(what, remedy="give one value, or one row of values, for each")
        result[name] = _frozen(array)
    return result


#: spaces of the images of a brain: that of the scanner, and that of an image which others are aligned to
ANATOMICAL = ("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_ALIGNED_ANAT")


@dataclass(frozen=True)
class CoordinateFrame:
    """Coordinate system, as GIfTI states it; carried from the input to every sidecar, never changed silently."""

    #: NIfTI transform code name of the stored coordinates, e.g. ``NIFTI_XFORM_SCANNER_ANAT``
    dataspace: str = "NIFTI_XFORM_UNKNOWN"
    #: code name of the space that `matrix` leads to
    xformspace: str = "NIFTI_XFORM_UNKNOWN"
    #: row-major 4 x 4 affine from dataspace to xformspace
    matrix: tuple[float, ...] = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)

    @property
    def leads_to_scanner(self) -> bool:
        """Whether `matrix` leads from coordinates that are elsewhere to the space of the images of this brain."""
        return self.xformspace in ANATOMICAL and self.dataspace not in (ANATOMICAL[0], self.xformspace)

    @property
    def is_placed(self) -> bool:
        """Whether it is known where the coordinates lie in the space of images."""
        return self.leads_to_scanner or self.dataspace in ANATOMICAL

    @property
    def to_scanner(self) -> FloatArray:
        """(4, 4) from the stored coordinates to the space of images; the identity if nothing is known to lead there."""
        return np.reshape(self.matrix, (4, 4)).astype(float) if self.leads_to_scanner else np.eye(4)


#: integer field of the region of each tetrahedron, from the outside in: 1 between the boundary and the inner surfaces,
#: i + 1 inside the i-th inner surface but outside the surfaces that it contains. Files have the same numbers: 0 is no
#: number of a region in several formats
REGION = "region"
#: name of region 1; the other regions have the names of the inner surfaces around them
OUTERMOST = "cortex"
#: name of everything inside the cortex
INNERMOST = "core"
#: names of region 1 if the brain is an inner surface; name of that surface if it contains no other
AROUND, BRAIN = ("csf", "skull", "skin"), "brain"
#: name of the integer field of a repaired surface that is 1 on the cap of a filled hole
FILLED = "filled"


def region_names(inner: Iterable[str]) -> list[str]:
    """Name of each region, from 1 on, from the names of the inner surfaces.

    Region 1 is the cortex. If an inner surface is the brain or its cortex (`brain`, `cortex`, `cortexL`), region 1 is
    the space around it, `csf`, or the first of `AROUND` that no inner surface is named.

    Raises
    ------
    InputError : an inner surface has a name of `AROUND`, but none is the brain, or all these names are taken; two
        regions have the same name (case does not count, as in some solvers); or one has that of the core
    """
    names = _region_names(list(inner))
    known = {INNERMOST: "everything inside the cortex"}
    for name in names:
        if (other := known.setdefault(name.lower(), f"the region {name}")) != f"the region {name}":
            raise InputError(
                f"the inner surface {name} would have the same name as {other}",
                remedy="give it a different name; case is ignored",
            )
    return names


def _region_names(named: list[str]) -> list[str]:
    around = [name for name in named if name in AROUND]
    if not any(is_brain(name) for name in named):
        if around:
            raise InputError(
                f"the name {around[0]} is reserved for the region around the brain, and no inner surface is the brain",
                remedy="give the inner surface another name, for example ventricle",
            )
        return [OUTERMOST, *named]
    if len(around) == len(AROUND):
        raise InputError(
            f"the inner surfaces use all the names of the outermost region: {', '.join(AROUND)}",
            remedy="rename one of them",
        )
    return [next(name for name in AROUND if name not in named), *named]


def by_region(outer: T, inner: Mapping[str, T]) -> dict[str, T]:
    """The value for the outer surface, and those for the inner ones, by the region inside each."""
    return dict(zip(region_names(inner), (outer, *inner.values()), strict=True))


def is_brain(region: str) -> bool:
    """Whether the name of a region means the brain or its cortex."""
    return region == BRAIN or region.startswith(OUTERMOST)


@dataclass(frozen=True, eq=False)
class TriSurface:
    """A triangulated surface."""

    #: (n, 3) float64, vertex coordinates in mm
    points: FloatArray
    #: (m, 3) int32, vertex indices, counter-clockwise seen from outside
    faces: IntArray
    #: per-vertex fields, name -> (n,) or (n, k)
    point_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: coordinate system of `points`
    frame: CoordinateFrame = CoordinateFrame()
    #: closed surfaces inside this one, name of the region within -> surface; `geometry.nesting.nested` fills it
    inner: dict[str, TriSurface] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _points(self.points))
        faces = _corners(self.faces, 3, "faces", len(self.points), "triangle", "vertices")
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "point_data", _fields(self.point_data, len(self.points), "vertices"))

    def __repr__(self) -> str:
        more = "".join(f", {what}" for what in (*map(repr, self.point_data), *(f"with {name}" for name in self.inner)))
        return f"<TriSurface: {len(self.points):,} vertices, {len(self.faces):,} triangles{more}>"


def single_precision(surface: TriSurface) -> TriSurface:
    """The surface as a file stores it: coordinates rounded to float32."""
    return replace(surface, points=surface.points.astype(np.float32).astype(np.float64))


@dataclass(frozen=True, eq=False)
class MeshSets:
    """Named parts of a mesh, for solvers. A name may occur once among nodes, among faces and among cells."""

    #: name -> (k,) int32, nodes, ascending
    nodes: dict[str, IntArray] = field(default_factory=dict)
    #: name -> (k, 3) int32, boundary faces as node triples, counter-clockwise seen from outside
    faces: dict[str, IntArray] = field(default_factory=dict)
    #: name -> (k,) int32, tetrahedra, ascending
    cells: dict[str, IntArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class TetMesh:
    """A tetrahedral mesh.

    Indices are valid and 0-based; this is checked. Every stage returns positive signed volumes and no unused nodes. A
    mesh of another program may have others, which the certificate counts and `geometry.filling.require_body` refuses.
    """

    #: (n, 3) float64, node coordinates in mm
    points: FloatArray
    #: (m, 4) int32, node indices; where the volume is positive, det(b - a, c - a, d - a) > 0
    cells: IntArray
    #: per-node fields, name -> (n,) or (n, k)
    point_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: per-element fields, name -> (m,) or (m, k)
    cell_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: named nodes, faces and tetrahedra; only meshes prepared for a solver have any
    sets: MeshSets = MeshSets()

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _points(self.points))
        cells = _corners(self.cells, 4, "cells", len(self.points), "tetrahedron", "nodes")
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "point_data", _fields(self.point_data, len(self.points), "nodes"))
        object.__setattr__(self, "cell_data", _fields(self.cell_data, len(self.cells), "cells"))
        for kind, count, of in (("nodes", len(self.points), "nodes"), ("faces", len(self.points), "nodes")):
            for name, members in getattr(self.sets, kind).items():
                require_indices(np.asarray(members), count, f"entry of set {name}", of)
        for name, members in self.sets.cells.items():
            require_indices(np.asarray(members), len(self.cells), f"entry of set {name}", "tetrahedra")

    def __repr__(self) -> str:
        more = "".join(f", {name!r}" for name in [*self.point_data, *self.cell_data])
        return f"<TetMesh: {len(self.points):,} nodes, {len(self.cells):,} tetrahedra{more}>"


def require_measurable(shape: TriSurface | TetMesh) -> None:
    """Raise InputError if a surface or mesh has no elements, or a coordinate is not finite."""
    if isinstance(shape, TetMesh):
        what, corners, elements, count = "mesh", "nodes", "tetrahedra", len(shape.cells)
    else:
        what, corners, elements, count = "surface", "vertices", "triangles", len(shape.faces)
    if not count:
        raise InputError(f"the {what} has no {elements}", remedy=f"make the {what} again")
    if len(bad := np.flatnonzero(~np.isfinite(shape.points).all(axis=1))):
        raise InputError(
            f"{len(bad)} of {len(shape.points)} {corners} of the {what} have coordinates that are not finite, "
            f"the first is number {bad[0]}: {shape.points[bad[0]].tolist()}",
            remedy=f"make the {what} again",
        )
