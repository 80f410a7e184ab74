"""VTU (VTK XML unstructured grid): the interchange file between stages.

Binary, zlib-compressed, float64: every array comes back bit for bit, fields included, and ParaView opens the file at
every stage. Read and written by meshio; format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import meshio
import numpy as np

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.mesh import TetMesh

#: what meshio lets through when a file is cut off or damaged
_DAMAGED = (
    meshio.ReadError,
    ET.ParseError,
    zlib.error,
    AssertionError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
)


def read(path: str | Path) -> TetMesh:
    """Read a tetrahedral mesh.

    Raises
    ------
    InputError
        the file is missing, is not a complete VTU file, holds cells that are not tetrahedra, or indexes nodes it lacks
    """
    try:
        mesh = meshio.vtu.read(path)
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    except _DAMAGED as error:
        raise InputError(f"is not a readable VTU file: {error}", file=path, remedy="delete it and run again") from error
    kinds = sorted({block.type for block in mesh.cells})
    if kinds != ["tetra"]:
        raise InputError(f"holds cells of type {', '.join(kinds) or 'none'}, not only tetrahedra", file=path)
    cells = np.concatenate([block.data for block in mesh.cells])
    if cells.min() < 0 or cells.max() >= len(mesh.points):
        raise InputError(f"has node indices outside 0..{len(mesh.points) - 1}", file=path)
    return TetMesh(
        points=mesh.points,
        cells=cells,
        point_data=dict(mesh.point_data),
        cell_data={name: np.concatenate(blocks) for name, blocks in mesh.cell_data.items()},
    )


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `mesh` losslessly; the file appears under `path` only when complete."""
    grid = meshio.Mesh(
        mesh.points,
        [("tetra", mesh.cells)],
        point_data=dict(mesh.point_data),
        cell_data={name: [values] for name, values in mesh.cell_data.items()},
    )
    with atomic_path(path) as temporary:
        meshio.vtu.write(temporary, grid)
