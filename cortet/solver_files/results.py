"""Results of solvers: read by PyVista or meshio, put in the order of their mesh, and taken to its surface."""

from __future__ import annotations

import pickle
import signal
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError, counted
from cortet.formats import child, result_reader
from cortet.formats.placement import UNITS
from cortet.formats.set_arrays import holds_set
from cortet.formats.untrusted import check_file, require_named_files, safely_named, sound
from cortet.formats.values import in_components
from cortet.formats.volumes import matrices
from cortet.geometry.topology import edges, used_vertices
from cortet.meshes import IntArray, TetMesh
from cortet.solver_files.fields import Q, with_q
from cortet.solver_files.surface_map import ToSurface

#: largest difference of the ratio of two extents from that of two units
_SAME_EXTENT = 1e-3
#: endings of Exodus
_EXODUS = (".e", ".exo", ".ex2", ".exii", ".g")
#: nodes are the same within this share of the shortest edge
_SAME_NODE = 0.05
#: a tensor is symmetric if it differs from its transpose by no more than this share of its largest number
_ASYMMETRY = 1e-4


class Step(NamedTuple):
    """A result at one time."""

    time: float | None
    #: in whatever unit; tetrahedra have their corners only, so that nodes may be unused
    mesh: TetMesh


class Order(NamedTuple):
    """How the nodes and tetrahedra of a result are found in the order of a mesh."""

    #: (n,) number in the result of each node of the mesh
    nodes: IntArray
    #: (m,) likewise of each tetrahedron; None if the result has others
    cells: IntArray | None
    #: what differs, in words
    told: list[str]


def read_result(path: Path) -> Iterator[Step]:
    """The steps of a result, of one time or of a series."""
    check_file(path)
    if path.suffix.lower() in _EXODUS:  # a block for each region, which PyVista tears apart; meshio reads one time
        raise InputError(
            "is an Exodus file, which cortet does not read",
            file=path,
            remedy="in ParaView, Merge Blocks, then save as PVD",
        )
    require_named_files(path)
    with TemporaryDirectory(prefix="cortet-result-") as folder:
        done = child.run([sys.executable, "-P", result_reader.__file__, str(path.absolute()), folder])
        if done.returncode:
            said = (done.stderr.strip() or "no message").splitlines()[-1]
            broke = f"its reader crashed ({signal.Signals(-done.returncode).name})" if done.returncode < 0 else said
            raise InputError(
                f"cannot be read as a result: {broke}",
                file=path,
                remedy="write VTU, VTK, PVD, XDMF or another format that PyVista or meshio reads",
            )
        for file in sorted(Path(folder).glob("*.step")):
            time, points, *content = pickle.loads(file.read_bytes())
            if not len(points):
                raise DamagedFileError("holds no nodes", file=path)
            yield Step(time, sound(path, points, *content))


def chosen(steps: Iterable[Step], names: Collection[str], file: Path) -> Iterator[Step]:
    """The steps with only some of their fields, by name; InputError if one lacks such a field."""
    for time, mesh in steps:
        if absent := [name for name in names if name not in (known := {**mesh.point_data, **mesh.cell_data})]:
            fields = ", ".join(name for name in known if not holds_set(name))
            raise InputError(f"has no field {', '.join(absent)}", file=file, remedy=f"name one of {fields or 'none'}")
        of_nodes, of_cells = (
            {name: values for name, values in fields.items() if name in names}
            for fields in (mesh.point_data, mesh.cell_data)
        )
        yield Step(time, replace(mesh, point_data=of_nodes, cell_data=of_cells))


def in_order(result: TetMesh, mesh: TetMesh, *, file: Path, mesh_file: Path) -> Order:
    """Find the nodes and tetrahedra of a mesh in a result, by where the nodes are.

    Nodes between the corners of tetrahedra, and those of no tetrahedron, are left out.
    """
    used = used_vertices(result.cells, len(result.points)) if len(result.cells) else np.arange(len(result.points))
    if len(used) != len(mesh.points):
        raise _of_another(f"has {len(used):,} nodes, but {mesh_file.name} has {len(mesh.points):,}", file)
    points = result.points[used]
    extent, own = (float(np.linalg.norm(np.ptp(one, axis=0))) for one in (mesh.points, points))
    ratio = extent / max(own, 1e-300)
    unit = next((name for name, mm in UNITS.items() if abs(ratio / mm - 1) < _SAME_EXTENT), None)
    if unit is None:
        raise _of_another(f"is {own / extent:.4g} times as large as {mesh_file.name}", file)
    told = [] if unit == "mm" else [f"its coordinates are in {unit}; values are unchanged"]
    points = points * UNITS[unit]
    ends = mesh.points[edges(mesh.cells)]
    most = _SAME_NODE * float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).min())
    place = np.arange(len(used))
    if np.abs(points - mesh.points).max() > most:
        from scipy.spatial import cKDTree

        distances, place = cKDTree(points).query(mesh.points)
        if len(away := np.flatnonzero(distances > most)) or len(np.unique(place)) < len(place):
            what = (
                f"lacks {len(away):,} nodes of {mesh_file.name}; one of them is {distances.max():.3g} mm from the "
                "nearest node of the result"
            )
            raise _of_another(what, file)
        told.append("its nodes have another order; cortet matched them by position")
    nodes = used[place]
    return Order(nodes.astype(np.int32), _cells_in_order(result.cells, nodes, mesh), told)


def _of_another(what: str, file: Path) -> InputError:
    return InputError(
        f"is not a result on this mesh: it {what}",
        file=file,
        remedy="name the mesh that the solver used, and write results on the undeformed mesh",
    )


def _cells_in_order(cells: IntArray, nodes: NDArray[np.integer], mesh: TetMesh) -> IntArray | None:
    """The row of `cells` (t, 4) that is each tetrahedron of the mesh, of `nodes` (n,); None if one is missing."""
    if len(cells) != len(mesh.cells):
        return None
    wanted, given = np.sort(nodes[mesh.cells], axis=1), np.sort(cells, axis=1)
    of_wanted, of_given = np.lexsort(wanted.T), np.lexsort(given.T)
    if not np.array_equal(wanted[of_wanted], given[of_given]):
        return None
    place = np.empty(len(cells), np.int32)
    place[of_wanted] = of_given
    return place


class OnSurface(NamedTuple):
    """Fields of a result at the vertices of a surface."""

    #: name -> (v,), NaN where there is no value
    fields: dict[str, NDArray[np.float64]]
    #: what was seen, in words
    told: list[str]


def on_surface(steps: Iterable[Step], weights: ToSurface, *, file: Path, mesh_file: Path) -> OnSurface:
    """All fields of a result at the vertices of the native surface, one number for each.

    A field with several numbers becomes `NAME_1`, `NAME_2` and so on. Of a tensor there are its principal values, its
    von Mises equivalent and its pressure, too; where the result has such a name already, theirs ends in a number. In a
    series each name ends in its time, or in the number of the step where two are of one time.

    Parameters
    ----------
    steps : of `read_result`
    weights : of `SurfaceMap.weights` or of `laminar.Laminar`
    """
    mesh, order, last = weights.found.mesh, None, None
    times: list[float | None] = []
    done: list[OnSurface] = []
    told: dict[str, None] = {}  # an ordered set
    if missing := int((np.diff(weights.nodes.indptr) == 0).sum()):
        what = "outside the mesh, or without a column of the cortex"
        if missing == weights.nodes.shape[0]:
            raise InputError(f"all vertices are {what}", file=mesh_file, remedy="give another depth")
        told[f"{counted(missing, 'vertex has', 'vertices have')} no value (NaN): {what}"] = None
    for given in steps:
        if order is None or last is None or not _same_mesh(given.mesh, last):
            order = in_order(given.mesh, mesh, file=file, mesh_file=mesh_file)
            told |= dict.fromkeys(order.told)
        last = given.mesh
        times.append(given.time)
        done.append(_of_step(last, order, mesh, weights))
        told |= dict.fromkeys(done[-1].told)
    if not any(one.fields for one in done):
        raise InputError("has no numeric field", file=file, remedy="make the solver write a numeric field")
    endings = _endings(times)
    if len(set(endings)) < len(endings):
        told["several steps have the same time; names end in the step number, from 0"] = None
        endings = [f"_{number}" for number in range(len(times))]
    ended = zip(endings, done, strict=True)
    fields = {name + ending: values for ending, one in ended for name, values in one.fields.items()}
    return OnSurface(fields, [*told, *_without_value(fields, weights, file)])


def _without_value(fields: Mapping[str, NDArray[np.float64]], weights: ToSurface, file: Path) -> Iterator[str]:
    """How many vertices of the mesh have no finite value, by field; InputError if no field has any."""
    reached = np.diff(weights.nodes.indptr) > 0
    missing = {name: int((~np.isfinite(values[reached])).sum()) for name, values in fields.items()}
    if all(count == reached.sum() for count in missing.values()):
        what = "has no finite value (all are NaN or infinite)"
        raise InputError(what, file=file, remedy="look into the log of the solver: it may have diverged")
    for name, count in missing.items():
        if count:
            yield f"{name}: {count:,} of {reached.sum():,} vertices have no value, where the result is not finite"


def _of_step(step: TetMesh, order: Order, mesh: TetMesh, weights: ToSurface) -> OnSurface:
    """The fields of a step, in the order of `order`, at the vertices."""
    told = []
    nodal, by_cell = {name: values[order.nodes] for name, values in step.point_data.items()}, {}
    if order.cells is not None:
        by_cell = {name: values[order.cells] for name, values in step.cell_data.items()}
        # q of the mesh, as its own file has it, is no result
        if Q in by_cell and np.array_equal(by_cell[Q], with_q(mesh).cell_data[Q]):
            del by_cell[Q]
    elif step.cell_data:
        told.append("its tetrahedra differ from those of the mesh; fields of elements are left out")
    if both := sorted(nodal.keys() & by_cell.keys()):
        told.append(f"{', '.join(both)}: the fields of elements with these names are left out")
    sets = {*mesh.sets.nodes, *mesh.sets.faces, *mesh.sets.cells}
    given = {name: values for name, values in {**by_cell, **nodal}.items() if name not in sets and not holds_set(name)}
    there = {
        name: (weights.of_nodes if name in nodal else weights.of_cells)(values).astype(np.float64)
        for name, values in given.items()
    }
    own = in_components(there, {1})
    tensors, lines = _of_tensors(there)
    if taken := sorted(own.keys() & tensors.keys()):
        told.append(f"{', '.join(taken)}: the result has these fields, so names of tensor components end in a number")
    named = safely_named([*own.items(), *tensors.items()])
    return OnSurface({name: values.ravel() for name, values in named.items()}, [*told, *lines])


def _endings(times: Sequence[float | None]) -> list[str]:
    """What the names of the fields of each step end in: nothing for a single one."""
    if len(times) == 1:
        return [""]
    return [f"_{number if time is None else f'{time:.10g}'}" for number, time in enumerate(times)]


def _same_mesh(one: TetMesh, other: TetMesh) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.cells, other.cells)


def _of_tensors(fields: Mapping[str, NDArray[np.float64]]) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Invariants of the fields that are tensors, by name, and what was taken for granted."""
    found: dict[str, NDArray[np.float64]] = {}
    told = []
    for name, values in fields.items():
        width = values.shape[1] if values.ndim == 2 else 1
        if width not in (6, 9):
            continue
        tensors = matrices(values) if width == 6 else values.reshape(-1, 3, 3)
        turned = np.swapaxes(tensors, 1, 2)
        if np.nanmax(np.abs(tensors - turned), initial=0) > _ASYMMETRY * np.nanmax(np.abs(tensors), initial=0):
            told.append(f"{name} is not symmetric, so it has no principal values")
            continue
        if width == 6:
            told.append(f"{name} is read as xx, yy, zz, xy, yz, xz")
        found |= {f"{name}_{what}": some for what, some in invariants((tensors + turned) / 2).items()}
    return found, told


def invariants(tensors: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Principal values of symmetric tensors (k, 3, 3), largest first, von Mises equivalent and pressure, by name.

    All are (k,), in the unit of the tensors, and NaN where the tensor is not finite. Pressure is minus the mean of the
    diagonal.
    """
    known = np.isfinite(tensors).all(axis=(1, 2))
    principal = np.full((len(tensors), 3), np.nan)
    principal[known] = np.linalg.eigvalsh(tensors[known])[:, ::-1]
    mean = principal.mean(axis=1)
    return {
        **{f"principal_{number}": values for number, values in enumerate(principal.T, start=1)},
        "von_mises": np.sqrt(1.5 * ((principal - mean[:, None]) ** 2).sum(axis=1)),
        "pressure": -mean,
    }
