"""Read a solver's result with PyVista or meshio in a separate process, since damaged files crash VTK (40 % of `.vtk`).

`cortet.solver_files.results` runs this module as a program. It imports no other module of cortet, so it starts at once.
Each step goes into a file, which pickle reads: time, nodes, tetrahedra, fields of nodes, and of tetrahedra.
"""

from __future__ import annotations

import logging
import pickle
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyvista

#: types of cells that are tetrahedra, of four nodes and more, of VTK and of meshio; their corners come first
_OF_VTK, _OF_MESHIO, _CORNERS = (10, 24), ("tetra", "tetra10"), 4
#: arrays that readers of VTK add
_OF_READERS = (
    "ObjectId",
    "GlobalElementId",
    "GlobalNodeId",
    "PedigreeElementId",
    "PedigreeNodeId",
    "vtkGhostType",
    "original_node_ids",
)
#: kinds of numbers that are kept: real ones
_NUMBERS = "fiub"


class _Step(NamedTuple):
    time: float | None
    points: NDArray[Any]
    cells: NDArray[Any]
    of_nodes: Mapping[str, Any]
    of_cells: Mapping[str, Any]


def _with_pyvista(path: Path) -> Iterator[_Step]:
    import pyvista

    try:
        reader = pyvista.get_reader(str(path))
    except ValueError:  # it knows no reader for this ending
        if path.suffix.lower() != ".frd":  # of CalculiX
            yield from _with_meshio(path)
            return
        from pyvista_frd import FRDReader

        reader = FRDReader(path)
    times = list(getattr(reader, "time_values", ()))
    for time in times or [None]:
        if time is not None:
            reader.set_active_time_value(time)
        grid = reader.read()
        grid = grid.combine() if isinstance(grid, pyvista.MultiBlock) else grid.cast_to_unstructured_grid()
        yield _of_grid(grid, time)


def _of_grid(grid: pyvista.UnstructuredGrid, time: float | None) -> _Step:
    if time is None and "TimeValue" in grid.field_data:
        time = float(np.ravel(grid.field_data["TimeValue"])[0])
    known = [kind for kind in _OF_VTK if kind in grid.cells_dict]
    order = np.concatenate([np.flatnonzero(grid.celltypes == kind) for kind in known] or [np.zeros(0, int)])
    of_cells = {name: np.asarray(values)[order] for name, values in grid.cell_data.items()}
    corners = _corners(grid.cells_dict[kind] for kind in known)
    return _Step(time, grid.points, corners, dict(grid.point_data.items()), of_cells)


def _with_meshio(path: Path) -> Iterator[_Step]:
    import meshio

    if path.suffix.lower() == ".xdmf":
        try:
            series = meshio.xdmf.TimeSeriesReader(path)
        except meshio.ReadError:  # of one time
            pass
        else:
            yield from _of_series(series)
            return
    read = meshio.read(path)
    yield _of_blocks(None, read.points, read.cells, read.point_data, read.cell_data)


def _of_series(series: Any) -> Iterator[_Step]:
    """The steps of an XDMF file. dolfinx writes a series for each field, of which meshio takes the last."""
    with series:
        points, blocks = series.read_points_cells()
        #: by time and how often a series had this time before
        found: dict[tuple[float, int], tuple[dict[str, Any], dict[str, Any]]] = {}
        for collection in [list(grid) for grid in series.domain if grid.get("CollectionType") == "Temporal"]:
            series.collection = collection
            seen: Counter[float] = Counter()
            for number in range(len(collection)):
                time, *fields = series.read_data(number)
                for known, more in zip(found.setdefault((time, seen[time]), ({}, {})), fields, strict=True):
                    known.update(more)
                seen[time] += 1
        for (time, _), (of_nodes, of_cells) in sorted(found.items(), key=lambda one: one[0]):
            yield _of_blocks(time, points, blocks, of_nodes, of_cells)


def _of_blocks(
    time: float | None, points: Any, blocks: Any, of_nodes: Mapping[str, Any], of_cells: Mapping[str, Any]
) -> _Step:
    """A step of meshio's blocks of cells."""
    known = [number for number, block in enumerate(blocks) if block.type in _OF_MESHIO]
    joined = {name: np.concatenate([values[number] for number in known]) for name, values in of_cells.items() if known}
    return _Step(time, points, _corners(blocks[number].data for number in known), of_nodes, joined)


def _corners(blocks: Iterable[NDArray[Any]]) -> NDArray[np.int64]:
    none = np.zeros((0, _CORNERS), np.int64)
    return np.concatenate([none, *(block[:, :_CORNERS].astype(np.int64) for block in blocks)])


def _numbers(fields: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """The fields that hold real numbers, (n,) or (n, k), without those that readers add."""
    arrays = {name: np.asarray(values) for name, values in fields.items() if name not in _OF_READERS}
    return {
        name: values if values.ndim == 1 else values.reshape(len(values), -1)
        for name, values in arrays.items()
        if values.dtype.kind in _NUMBERS
    }


def main(source: str, folder: str) -> None:
    """Write the steps of a result into a folder; ends with a message for a file that cannot be read."""
    path = Path(source)
    warnings.simplefilter("ignore")
    logging.disable()
    try:
        for number, step in enumerate(_with_meshio(path) if path.suffix.lower() == ".xdmf" else _with_pyvista(path)):
            of_nodes, of_cells = _numbers(step.of_nodes), _numbers(step.of_cells)
            content = (step.time, np.asarray(step.points, float), step.cells, of_nodes, of_cells)
            (Path(folder) / f"{number:06}.step").write_bytes(pickle.dumps(content))
    except (Exception, SystemExit) as error:  # meshio ends the program for a file that it cannot read
        said = (str(error).strip().splitlines() or [""])[-1].rpartition("): ")[2]  # VTK begins with lines of its code
        sys.exit(f"{said or type(error).__name__}")


if __name__ == "__main__":
    main(*sys.argv[1:])
