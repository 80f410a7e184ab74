"""Meshes of other programs, which meshio reads: `.vtu`, `.vtk`, `.msh`, `.inp`, `.bdf` and `.xdmf`.

Names and numbers of regions and of parts of the surface come back where a file has them as cortet, Gmsh or meshio write
them. meshio skips what it does not know: a file in which it would miss nodes or elements is refused. Files
of VTK that it cannot read PyVista writes anew for it, in a process of its own, as damaged ones crash VTK.
"""

from __future__ import annotations

import contextlib
import io
import logging
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats import child
from cortet.formats.set_arrays import without_sets
from cortet.formats.tags import with_names
from cortet.formats.untrusted import check_file, content, in_range
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh

logger = logging.getLogger(__name__)

#: cells of surfaces, lines and points, which may accompany tetrahedra
_FLAT = {"vertex", "line", "line3", "triangle", "triangle6", "quad", "quad8", "quad9"}
#: arrays of numbers of regions or of parts of the surface, by what writes them
_NUMBERS = ("gmsh:physical", "nastran:ref", "surface", REGION)
#: set of all elements, which is none
_EVERY = "all_elements"
_REMEDY = "save it as VTU, tetrahedra of four nodes alone: ParaView, or meshio.write(FILE, mesh)"
_LINES = re.MULTILINE | re.IGNORECASE
#: lines of Abaqus that add nodes, elements or members of sets, and of which meshio makes something else
_UNREAD = re.compile(
    rb"^\*(?:(?:INCLUDE|NGEN|NFILL|NCOPY|NMAP|ELGEN|ELCOPY|SYSTEM)\b|NODE\b[^\n]*\bSYSTEM\s*=\s*[^R\s]|"
    rb"(?:N|EL)SET[^\n]*\n\s*[A-Z]|INSTANCE\b[^\n]*\n\s*[-+.\d])[^\n]*",
    _LINES,
)
#: lines of which a file may have one: more are several parts, or nodes that take the place of earlier ones
_ONCE = (rb"^\*NODE\s*(?:,|\r?$)", rb"^\*PART\b", rb"^\*INSTANCE\b")
_BY_VTK = "import sys, pyvista; pyvista.read(sys.argv[1]).save(sys.argv[2])"
#: names of regions in comments of cortet: Nastran, Abaqus
_NAMED = re.compile(rb"^(?:\$ property|\*\* region) (\d{1,8}): (\S.*?)\s*$", re.MULTILINE)
#: lines that meshio takes for the end of a block
_COMMENTS = re.compile(rb"^\*\*[^\n]*(?:\n|\Z)", re.MULTILINE)
#: cards of Nastran that meshio does not follow: nodes of other files, or in other coordinate systems
_ELSEWHERE = re.compile(rb"^(?:INCLUDE\b|CORD[12][RCS]\b)[^\n]*", _LINES)
#: blocks of Gmsh, in text, whose rows meshio takes in the order of the file, whatever their numbers
_IN_TEXT = re.compile(rb"\$MeshFormat\s+[24]\S* 0 ")
_NODE_DATA = re.compile(rb"\$NodeData\s(.*?)\$EndNodeData", re.DOTALL)
_NODES = re.compile(rb"\$Nodes\s(.*?)\$EndNodes", re.DOTALL)
_ELEMENT_DATA = re.compile(rb"\$ElementData\s.*?\$EndElementData\s", re.DOTALL)


def read(path: Path) -> TetMesh:
    """The tetrahedra of a file with their fields, regions and sets; other cells are left out.

    Raises
    ------
    InputError : meshio cannot read the file, or would read it wrongly; it has no tetrahedra, or other cells of a volume
    """
    check_file(path)
    try:
        found, faces = READERS[path.suffix](path), {}
        if path.suffix == ".xdmf" and (beside := path.with_name(f"{path.stem}_facets.xdmf")).is_file():
            faces = _faces(_read_xdmf(beside), len(found.points), path)
    except InputError:
        raise
    except Exception as error:  # whatever meshio raises for a file that is damaged or holds something else
        what = f"cannot be read by meshio ({type(error).__name__}: {error})"
        raise InputError(what, file=path, remedy=_REMEDY) from error
    kinds = [block.type for block in found.cells]
    if other := sorted({*kinds} - _FLAT - {"tetra"}):
        raise InputError(f"holds cells of type {other[0]}, not only tetrahedra", file=path, remedy=_REMEDY)
    if "tetra" not in kinds:
        raise InputError(f"has no tetrahedra, only {', '.join(kinds) or 'nodes'}", file=path, remedy=_REMEDY)
    of_cells = {name: _of("tetra", found, blocks) for name, blocks in found.cell_data.items()}
    if (number := next((of_cells.pop(name) for name in _NUMBERS if name in of_cells), None)) is not None:
        of_cells[REGION] = number
    of_cells.pop("gmsh:geometrical", None)
    found.point_data.pop("gmsh:dim_tags", None)
    corners = _of("tetra", found, [block.data for block in found.cells])
    cells, names = _cell_sets(found) if path.suffix == ".inp" else {}, _names(found, 3)
    if number is None and cells.keys() >= names.keys() > set():  # sets whose numbers a comment of cortet has
        number = np.zeros(len(corners), np.int32)
        for name, tag in names.items():
            number[cells[name]] = tag
        of_cells[REGION] = number
    mesh = without_sets(path, found.points, corners, found.point_data, of_cells)
    sets = MeshSets(
        mesh.sets.nodes | {name: np.asarray(nodes, np.int32) for name, nodes in found.point_sets.items()},
        mesh.sets.faces | faces | _faces(found, len(found.points), path),
        mesh.sets.cells | cells,
    )
    return replace(mesh, sets=sets if number is None else with_names(sets, number, names))


def _read_vtk(path: Path) -> Any:
    try:
        return _of_all_types(path, path)
    except InputError:
        raise
    except Exception:  # of all that VTK writes, meshio reads a part
        return _of_vtk(path)


def _read_abaqus(path: Path) -> Any:
    text = content(path)
    _require_plain(text, path)
    with TemporaryDirectory(prefix="cortet-inp-") as folder:
        (plain := Path(folder) / path.name).write_bytes(_COMMENTS.sub(b"", text))
        found = meshio.abaqus.read(str(plain))
    found.field_data = {name: [tag, 3] for name, tag in _named(text).items()}
    return found


def _read_nastran(path: Path) -> Any:
    text = content(path)
    if not 0 <= text.find(b"BEGIN BULK") < text.find(b"\nENDDATA"):
        raise DamagedFileError("does not hold bulk data from BEGIN BULK to ENDDATA", file=path)
    if card := _ELSEWHERE.search(text):
        what = f"has a card that cortet does not read: {card[0].decode('ascii', 'replace').strip()}"
        raise InputError(what, file=path, remedy=_REMEDY)
    found = meshio.nastran.read(str(path))
    solids = _of("tetra", found, found.cell_data["nastran:ref"])
    found.field_data = {name: [tag, 3 if tag in solids else 2] for name, tag in _named(text).items()}
    return found


def _read_gmsh(path: Path) -> Any:
    text = content(path)
    _require_rising(text, path)
    if text.startswith(b"$MeshFormat\n2") and _ELEMENT_DATA.search(text):
        return _without_element_data(text, path)
    return meshio.gmsh.read(str(path))


def _read_xdmf(path: Path) -> Any:
    for name in sorted({*re.findall(rb"([^\s/>]{1,255}\.h5):", content(path))}):
        check_file(path.with_name(name.decode("utf-8", "replace")))
    return meshio.xdmf.read(str(path))


#: end of a file's name -> what meshio finds in it, after a check that it misses nothing
READERS = {
    ".vtu": _read_vtk,
    ".vtk": _read_vtk,
    ".msh": _read_gmsh,
    ".inp": _read_abaqus,
    ".bdf": _read_nastran,
    ".xdmf": _read_xdmf,
}


def _named(text: bytes) -> dict[str, int]:
    """Name -> number of each region that a comment of cortet names."""
    return {name.decode("ascii", "replace"): int(tag) for tag, name in _NAMED.findall(text)}


def _of_all_types(file: Path, path: Path) -> Any:
    """What meshio finds in a file of VTK."""
    read_file = meshio.vtk.read if file.suffix == ".vtk" else meshio.vtu.read
    with contextlib.redirect_stderr(io.StringIO()) as said:
        found = read_file(str(file))
    if left := re.search(r"cannot handle \((type \d+)\)", " ".join(said.getvalue().split())):
        raise InputError(f"has VTK cells of {left[1]}, which cortet does not read", file=path, remedy=_REMEDY)
    return found


def _require_rising(text: bytes, path: Path) -> None:
    """Raise InputError for fields of nodes in a Gmsh file in text whose rows are not in the order of the nodes."""
    blocks = _NODE_DATA.findall(text) if _IN_TEXT.match(text) else []
    if not blocks or (nodes := _NODES.search(text)) is None:
        return
    rows = [line.split() for line in nodes[1].splitlines()]
    numbers = [int(row[0]) for row in rows[1:] if len(row) == (4 if text.startswith(b"$MeshFormat\n2") else 1)]
    for block in blocks:
        values = [int(line.split()[0]) for line in block.splitlines() if re.match(rb"\d+\s+[-+.\d]", line)]
        if values != numbers[: len(values)]:
            what = "holds fields of nodes in another order than its nodes"
            raise InputError(what, file=path, remedy="save it with Gmsh anew, or as VTU")


def _of_vtk(path: Path) -> Any:
    """What meshio finds in a file of VTK that PyVista has written anew."""
    with TemporaryDirectory(prefix="cortet-vtk-") as folder:
        again = Path(folder) / "again.vtu"
        done = child.run([sys.executable, "-c", _BY_VTK, str(path.absolute()), str(again)])
        if done.returncode or "ERR|" in done.stderr or not again.exists():
            said = (done.stderr.strip().splitlines() or ["VTK broke down"])[-1]
            raise InputError(f"cannot be read by PyVista ({said})", file=path, remedy=_REMEDY)
        return _of_all_types(again, path)


def _require_plain(text: bytes, path: Path) -> None:
    """Raise InputError for an Abaqus file of which meshio would read other nodes, elements or sets."""
    strange = [found[0].split(b"\n")[0].decode("ascii", "replace") for found in _UNREAD.finditer(text)]
    strange += [line.decode().strip("^\\b") for line in _ONCE if len(re.findall(line, text, _LINES)) > 1]
    of_blocks = re.findall(rb"^\*ELEMENT\b[^\n]*ELSET\s*=\s*([^,\s]+)", text, _LINES)
    strange += [] if len({*of_blocks}) == len(of_blocks) else ["several blocks *ELEMENT of one ELSET"]
    if strange:
        remedy = "export one part as plain *NODE, *ELEMENT, *NSET and *ELSET, or as VTU"
        raise InputError(f"has content that cortet does not read: {strange[0]}", file=path, remedy=remedy)


def _without_element_data(text: bytes, path: Path) -> Any:
    """A Gmsh file of version 2 without its fields of elements, of which meshio 5.3 reads none."""
    logger.warning("%s: fields of elements in Gmsh's version 2 are not read", path)
    with TemporaryDirectory(prefix="cortet-msh-") as folder:
        (plain := Path(folder) / path.name).write_bytes(_ELEMENT_DATA.sub(b"", text))
        return meshio.gmsh.read(str(plain))


def _of(kind: str, found: Any, blocks: Sequence[Any]) -> NDArray[Any]:
    """The rows of all blocks of one kind of cell."""
    chosen = [rows for rows, block in zip(blocks, found.cells, strict=True) if block.type == kind]
    return np.concatenate(chosen) if chosen else np.empty((0, 3), np.int32)


def _names(found: Any, dimension: int) -> dict[str, int]:
    """Name -> number of each group of a dimension."""
    pairs = {name: np.ravel(pair) for name, pair in found.field_data.items()}
    return {name: int(pair[0]) for name, pair in pairs.items() if len(pair) == 2 and pair[1] == dimension}


def _faces(found: Any, count: int, path: Path) -> dict[str, IntArray]:
    """The triangles of each group, by its name."""
    names, key = _names(found, 2), next((key for key in _NUMBERS if key in found.cell_data), None)
    if key is None or not names:
        return {}
    triangles = in_range(_of("triangle", found, [block.data for block in found.cells]), count, "node", path)
    number = _of("triangle", found, found.cell_data[key])
    return {name: triangles[number == tag] for name, tag in names.items() if tag in number}


def _cell_sets(found: Any) -> dict[str, IntArray]:
    """The tetrahedra of each set of elements of Abaqus, which counts them anew in each block."""
    first, sets = 0, dict[str, list[Any]]()
    for number, block in enumerate(found.cells):
        if block.type == "tetra":
            for name, parts in found.cell_sets.items():
                sets.setdefault(name, []).append(np.asarray(parts[number], np.int32) + np.int32(first))
            first += len(block.data)
    return {name: np.unique(np.concatenate(parts)) for name, parts in sets.items() if name != _EVERY}
