"""A written file beside the mesh that was meant, and beside what other programs find in it.

These are meshio, which PyVista uses for some formats, VTK, Gmsh and NiBabel. FEBio, openCARP and BrainGrowth have
readers of their own, and no package has one; there, cortet's must do.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.formats import Format
from cortet.formats.tags import region_numbers, regions
from cortet.geometry.topology import boundary_surface
from cortet.meshes import REGION, TetMesh, TriSurface

#: two readers of one file differ by less than this, of the largest number
_SAME = 1e-12


@dataclass(frozen=True)
class Seen:
    """What a program finds in a file."""

    points: NDArray[Any]
    #: (m, 4) tetrahedra or (m, 3) triangles
    cells: NDArray[Any]
    #: name -> values of the nodes
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    #: (m,) number of the region of each tetrahedron, and the name of each number; None, and none, where it finds none
    region: NDArray[Any] | None = None
    names: dict[int, str] = field(default_factory=dict)
    #: name -> tetrahedra of each set
    sets: dict[str, NDArray[Any]] = field(default_factory=dict)


def _by_meshio(module: str, tags: str) -> Callable[[Path], Seen]:
    """Reader of meshio, whose cell data `tags` are the numbers of regions."""

    def read(path: Path) -> Seen:
        import importlib

        found = importlib.import_module(f"meshio.{module}").read(str(path))
        chosen = [number for number, block in enumerate(found.cells) if block.type == "tetra"]
        blocks = [np.asarray(found.cells[number].data) for number in chosen]
        number = [found.cell_data[tags][number] for number in chosen] if tags in found.cell_data else None
        names = {int(one[0]): name for name, one in found.field_data.items() if len(one) == 2 and one[1] == 3}
        return Seen(
            np.asarray(found.points),
            np.concatenate([np.empty((0, 4), int), *blocks]),
            dict(found.point_data),
            None if number is None else np.concatenate(number),
            names,
            {name: np.concatenate(some) for name, some in found.cell_sets.items()} if module == "abaqus" else {},
        )

    return read


def _by_vtk(path: Path) -> Seen:
    import pyvista

    with contextlib.redirect_stdout(
        io.StringIO()
    ):  # meshio, by which it reads Gmsh files, prints which formats it tries
        grid = pyvista.read(str(path))
    if isinstance(grid, pyvista.PolyData):
        return Seen(np.asarray(grid.points), np.asarray(grid.regular_faces))
    fields = {name: np.asarray(grid.point_data[name]) for name in grid.point_data}
    tetrahedra = grid.celltypes == pyvista.CellType.TETRA  # a file of Gmsh has triangles, too
    region = np.asarray(grid.cell_data[REGION])[tetrahedra] if REGION in grid.cell_data else None
    tags = {name: np.asarray(grid.field_data[name]) for name in grid.field_data}
    names = {int(one[0]): name for name, one in tags.items() if len(one) == 2 and one[1] == 3}
    return Seen(np.asarray(grid.points), grid.cells_dict[pyvista.CellType.TETRA], fields, region, names)


def _by_gmsh(path: Path) -> Seen:
    from cortet.formats import msh

    mesh = msh.read(path)
    names = {number: name for name, number in regions(mesh).items()}
    return Seen(mesh.points, mesh.cells, dict(mesh.point_data), region_numbers(mesh), names)


def _by_nibabel(path: Path) -> Seen:
    import nibabel

    image: Any = nibabel.load(path)
    points, faces = image.agg_data(("pointset", "triangle"))
    return Seen(points, faces, {one.meta["Name"]: one.data for one in image.darrays if "Name" in one.meta})


#: format -> program -> its reader
READERS: dict[str, dict[str, Callable[[Path], Seen]]] = {
    "vtu": {"PyVista": _by_vtk, "meshio": _by_meshio("vtu", REGION)},
    "vtk": {"PyVista": _by_vtk, "meshio": _by_meshio("vtk", REGION)},
    "abaqus": {"meshio": _by_meshio("abaqus", REGION)},
    "fenics": {"meshio": _by_meshio("xdmf", REGION)},
    "gmsh": {"Gmsh": _by_gmsh, "PyVista": _by_vtk, "meshio": _by_meshio("gmsh", "gmsh:physical")},
    "gmsh_v2": {"Gmsh": _by_gmsh},
    "nastran": {"meshio": _by_meshio("nastran", "nastran:ref")},
    "stl": {"PyVista": _by_vtk},
    "gifti": {"NiBabel": _by_nibabel},
}


#: formats that cortet itself reads by such a program
_NO_OTHER = {("nastran", "meshio"), ("gmsh", "Gmsh"), ("gmsh_v2", "Gmsh")}


def seen_otherwise(path: Path, solver: str, own: TetMesh | TriSurface) -> Iterator[str]:
    """What other programs find in a file that differs from what cortet read there, in words.

    Parameters
    ----------
    own : the file as cortet reads it
    """
    for program, read in READERS.get(solver, {}).items():
        if (solver, program) in _NO_OTHER:
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = read(path)
        except Exception as error:  # whatever a reader of another project raises, its users cannot read the file
            yield f"{program} cannot read it: {type(error).__name__} {error}"
            continue
        for what in _differences(found, own):
            yield f"{program} reads other {what}"


def _differences(found: Seen, own: TetMesh | TriSurface) -> Iterator[str]:
    for name, values in own.point_data.items():
        seen = found.fields.get(name)
        if seen is not None and (seen.size != values.size or not _same(seen.reshape(values.shape), values)):
            yield f"values of the field {name}"
    if isinstance(own, TriSurface):  # an STL file has no vertices, only triangles
        if not _same(found.points[found.cells], own.points[own.faces]):
            yield "triangles"
        return
    corners = own.cells
    if not _same(found.points, own.points):
        yield "nodes"
        return
    # Gmsh keeps the elements of a group together, so their order is not that of the mesh
    order, given = (np.lexsort(np.asarray(rows).T) for rows in (found.cells, corners))
    if found.cells.shape != corners.shape or not np.array_equal(found.cells[order], corners[given]):
        yield "elements"
        return
    for name, members in found.sets.items():
        if not np.array_equal(np.sort(members), own.sets.cells.get(name, np.arange(len(own.cells)))):
            yield f"members of the set {name}"
    if found.region is not None:
        if not np.array_equal(found.region[order], region_numbers(own)[given]):
            yield "regions"
        elif found.names and own.sets.cells and {n: name for name, n in regions(own).items()} != found.names:
            yield "names of regions"


def _same(found: NDArray[Any], own: NDArray[Any], rounding: float = _SAME) -> bool:
    """Whether two arrays have the same shape and numbers, up to rounding."""
    return found.shape == own.shape and bool(
        np.allclose(found, own, rtol=0, atol=rounding * np.abs(own).max(initial=0))
    )


def not_as_meant(meant: TetMesh | TriSurface, back: TetMesh | TriSurface, form: Format) -> Iterator[str]:
    """What a file holds, of the things that it holds at all, that differs from the mesh that was meant, in words.

    Parameters
    ----------
    back : what was read back, in the unit of `meant`
    """
    if isinstance(back, TriSurface) or isinstance(meant, TriSurface):
        given = meant if isinstance(meant, TriSurface) else boundary_surface(meant)[0]
        found = back if isinstance(back, TriSurface) else boundary_surface(back)[0]
        if not _same(found.points[found.faces], given.points[given.faces], form.rounding):
            yield "its triangles are not those of the mesh"
        return
    if not _same(back.points, meant.points, form.rounding):
        yield "its nodes are not those of the mesh"
    if not np.array_equal(back.cells, meant.cells):
        yield "its elements are not those of the mesh"
    if not np.array_equal(region_numbers(back), region_numbers(meant)):
        yield "its regions are not those of the mesh"
    for name, values in back.point_data.items():
        wanted = meant.point_data.get(name, values)
        # a field of one component may be a column, too
        if wanted.size != values.size or not _same(values, wanted.reshape(values.shape), form.rounding):
            yield f"its field {name} is not that of the mesh"
    for kind in ("nodes", "cells", *(("faces",) if form.names_faces else ())):
        for name, members in getattr(back.sets, kind).items():
            expected = getattr(meant.sets, kind).get(name)
            if expected is not None and not np.array_equal(_rows(members), _rows(expected)):
                yield f"its set {name} of {kind} is not that of the mesh"


def _rows(members: NDArray[Any]) -> NDArray[Any]:
    """Members of a set in an order of their own; a face may begin at any of its corners."""
    rows = members.reshape(len(members), -1)
    turned = np.take_along_axis(rows, (rows.argmin(axis=1)[:, None] + np.arange(rows.shape[1])) % rows.shape[1], axis=1)
    return turned[np.lexsort(turned.T)]
