"""Meshes of other programs, which meshio reads: `.vtu`, `.vtk`, `.msh`, `.inp`, `.bdf` and `.xdmf`.

Names and numbers of regions and of parts of the surface come back where a file has them as cortet, Gmsh or meshio write
them. meshio skips what it does not know: a file in which it would miss nodes or elements is refused. Files
of VTK PyVista writes anew for it, in a process of its own, as damaged ones crash VTK.
"""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import child
from cortet.formats.set_arrays import without_sets
from cortet.formats.tags import with_names
from cortet.formats.untrusted import check_file, content, naming, require_named_files
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh

logger = logging.getLogger(__name__)

#: cells of surfaces, lines and points, which may accompany tetrahedra
_FLAT = {"vertex", "line", "line3", "triangle", "triangle6", "quad", "quad8", "quad9"}
#: arrays of numbers of regions or of parts of the surface, by what writes them
_NUMBERS = ("gmsh:physical", "nastran:ref", "surface", REGION)
#: set of all elements, which is none
_EVERY = "all_elements"
_REMEDY = "save only its four-node tetrahedra, as VTU, with ParaView or meshio.write(FILE, mesh)"
_LINES = re.MULTILINE | re.IGNORECASE
#: lines of Abaqus that add nodes, elements or members of sets, and of which meshio makes something else
_UNREAD = re.compile(
    rb"^\*(?:(?:INCLUDE|NGEN|NFILL|NCOPY|NMAP|ELGEN|ELCOPY|SYSTEM)\b|NODE\b[^\n]*\bSYSTEM\s*=\s*[^R\s]|"
    rb"(?:N|EL)SET[^\n]*\n\s*[A-Z]|INSTANCE\b[^\n]*\n\s*[-+.\d])[^\n]*",
    _LINES,
)
#: lines of which a file may have one: more are several parts, or nodes that take the place of earlier ones
_ONCE = {
    rb"^\*NODE\s*(?:,|\r?$)": "a second block *NODE",
    rb"^\*PART\b": "a second *PART",
    rb"^\*INSTANCE\b": "a second *INSTANCE",
}
#: blocks that add members to a set: Abaqus takes those of all, meshio of the last one
_SETS = re.compile(
    rb"^\*(?:NODE|NSET|ELEMENT|ELSET)\s*,(?:[^\n]*,)?\s*((?:N|EL)SET)\s*=\s*(\"[^\"\n]*\"|[^,\s]+)", _LINES
)
#: array of VTK that hides cells
_GHOSTS = "vtkGhostType"
#: writes a file of VTK anew, in a form that meshio reads
_BY_VTK = f"""import sys, pyvista
grid = pyvista.read(sys.argv[1])
if "{_GHOSTS}" in grid.array_names:
    sys.exit("it has ghost cells")
pyvista.save_meshio(sys.argv[2], grid)
"""
#: writes a file of Gmsh anew, in the version and without the partitions and entities that meshio cannot read
_BY_GMSH = """import sys, gmsh
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
gmsh.open(sys.argv[1])
gmsh.model.mesh.unpartition()
gmsh.option.setNumber("Mesh.SaveAll", not gmsh.model.getPhysicalGroups(3))
gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
gmsh.write(sys.argv[2])
"""
#: names of groups of Gmsh: dimension, number and name
_GROUPS = re.compile(rb'^\s*([0-3])\s+(\d+)\s+"([^"\n]*)"\s*$', re.MULTILINE)
#: names of regions in comments of cortet: Nastran, Abaqus
_NAMED = re.compile(rb"^(?:\$ property|\*\* region) (\d{1,8}): (\S.*?)\s*$", re.MULTILINE)
#: lines that meshio takes for the end of a block
_COMMENTS = re.compile(rb"^\*\*[^\n]*(?:\n|\Z)", re.MULTILINE)
#: what Abaqus takes and meshio does not: commas at the end of data, types of elements in lower case
_LAST_COMMA = re.compile(rb"^([ \t]*[^*\s][^\n]*?),[ \t]*(?=\r?$)", re.MULTILINE)
_TYPE = re.compile(rb"^\*ELEMENT\b[^\n]*\bTYPE\s*=\s*\w+", _LINES)
#: cards of Nastran that meshio does not follow: nodes of other files, or in other coordinate systems
_ELSEWHERE = re.compile(rb"^(?:INCLUDE\b|CORD[12][RCS]\b)[^\n]*", _LINES)
#: fields of Gmsh; meshio takes their rows in the order of the file, whatever their numbers, and fails on some
_FIELDS = re.compile(rb"\$(Node|Element)Data\s.*?\$End\1Data\s", re.DOTALL)


def read(path: Path) -> TetMesh:
    """The tetrahedra of a file with their fields, regions and sets; cells of surfaces and lines are left out.

    A file that meshio would read wrongly, or with other cells of a volume, is refused.
    """
    check_file(path)
    try:
        found, faces = READERS[path.suffix](path), {}
        if path.suffix == ".xdmf" and (beside := path.with_name(f"{path.stem}_facets.xdmf")).is_file():
            faces = _faces(_read_xdmf(beside))
        kinds = {block.type for block in found.cells}
        if _GHOSTS in found.cell_data or _GHOSTS in found.point_data:
            raise ValueError(f"it has ghost cells: remove the array {_GHOSTS}")
        if (solid := kinds - _FLAT) != {"tetra"}:
            raise ValueError(f"its volume cells must be tetrahedra, not {', '.join(sorted(solid)) or 'none'}")
    except InputError:
        raise
    except Exception as error:  # whatever meshio raises for a file that is damaged or holds something else
        what = f"is not a mesh that cortet reads ({type(error).__name__}: {error})"
        raise InputError(what, file=path, remedy=_REMEDY) from error
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
        mesh.sets.faces | faces | _faces(found),
        mesh.sets.cells | cells,
    )
    with naming(path):
        return replace(mesh, sets=sets if number is None else with_names(sets, number, names))


def _read_vtk(path: Path) -> Any:
    """What meshio finds in a file of VTK, written anew by PyVista: of all that VTK writes, meshio reads a part."""
    try:
        return _read_again(_BY_VTK, path, "again.vtu", meshio.vtu.read)
    except ValueError as error:
        try:  # VTK reads only a part of what meshio writes
            return (meshio.vtk.read if path.suffix == ".vtk" else meshio.vtu.read)(str(path))
        except Exception:
            raise error from None


def _read_abaqus(path: Path) -> Any:
    text = content(path)
    strange = [found[0].split(b"\n")[0].decode("ascii", "replace") for found in _UNREAD.finditer(text)]
    strange += [words for line, words in _ONCE.items() if len(re.findall(line, text, _LINES)) > 1]
    sets = [b" ".join(found).decode("utf-8", "replace").upper() for found in _SETS.findall(text)]
    strange += [f"two blocks of {name}" for name in sets if sets.count(name) > 1]
    if strange:
        raise ValueError(f"cortet reads one part of nodes, elements and sets, not {strange[0]}")
    plain = _TYPE.sub(lambda match: match[0].upper(), _LAST_COMMA.sub(rb"\1", _COMMENTS.sub(b"", text)))
    found = _read_changed(plain, path, meshio.abaqus.read)
    found.field_data = {name: [tag, 3] for name, tag in _named(text).items()}
    return found


def _read_nastran(path: Path) -> Any:
    text = content(path).expandtabs(8)
    text = text if b"BEGIN BULK" in text else b"BEGIN BULK\n" + text
    if card := _ELSEWHERE.search(text):
        raise ValueError(f"it is not plain bulk data: {card[0].decode('ascii', 'replace')}")
    if text.find(b"BEGIN BULK") > text.find(b"\nENDDATA"):
        raise ValueError("it has no line ENDDATA: its end may be missing")
    found = _read_changed(text, path, meshio.nastran.read)
    solids = _of("tetra", found, found.cell_data["nastran:ref"])
    found.field_data = {name: [tag, 3 if tag in solids else 2] for name, tag in _named(text).items()}
    return found


def _read_gmsh(path: Path) -> Any:
    """What meshio finds in a file of Gmsh, written anew by Gmsh where meshio cannot read it."""
    text, count = _FIELDS.subn(b"", content(path))
    if count:
        logger.warning("%s: Gmsh views are not read", path)
    groups = [name for dimension, _, name in _GROUPS.findall(text) if dimension in (b"2", b"3")]
    if twice := next((name for name in groups if groups.count(name) > 1), None):
        what = f"two physical groups have the name {twice.decode('utf-8', 'replace')!r}"
        raise InputError(what, file=path, remedy="in Gmsh, give each physical group its own name")
    try:
        return _read_changed(text, path, meshio.gmsh.read)
    except Exception:  # of what Gmsh writes, meshio reads a part
        return _read_again(
            _BY_GMSH,
            path,
            path.name,
            lambda again: _read_changed(_FIELDS.sub(b"", content(again)), path, meshio.gmsh.read),
        )


def _read_xdmf(path: Path) -> Any:
    require_named_files(path)
    return meshio.xdmf.read(str(path))


def _read_again(program: str, path: Path, name: str, read_file: Callable[[Path], Any]) -> Any:
    """What is found in a file that a program writes anew, in a process of its own, as damaged ones crash VTK."""
    with TemporaryDirectory(prefix="cortet-again-") as folder:
        again = Path(folder) / name
        done = child.run([sys.executable, "-c", program, str(path.absolute()), str(again)])
        if done.returncode or re.search(r"ERR\||Error reading", done.stderr) or not again.exists():
            raise ValueError((done.stderr.strip().splitlines() or ["its own program broke down"])[-1]) from None
        return read_file(again)


def _read_changed(text: bytes, path: Path, read_file: Callable[[str], Any]) -> Any:
    """What meshio finds in the text of a file without what it does not read."""
    with TemporaryDirectory(prefix="cortet-mesh-") as folder:
        (plain := Path(folder) / path.name).write_bytes(text)
        return read_file(str(plain))


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


def _of(kind: str, found: Any, blocks: Sequence[Any]) -> NDArray[Any]:
    """The rows of all blocks of one kind of cell."""
    chosen = [rows for rows, block in zip(blocks, found.cells, strict=True) if block.type == kind]
    return np.concatenate(chosen) if chosen else np.empty((0, 3), np.int32)


def _names(found: Any, dimension: int) -> dict[str, int]:
    """Name -> number of each group of a dimension."""
    pairs = {name: np.ravel(pair) for name, pair in found.field_data.items()}
    return {name: int(pair[0]) for name, pair in pairs.items() if len(pair) == 2 and pair[1] == dimension}


def _faces(found: Any) -> dict[str, IntArray]:
    """The triangles of each group, by its name."""
    names, key = _names(found, 2), next((key for key in _NUMBERS if key in found.cell_data), None)
    if key is None or not names:
        return {}
    triangles = _of("triangle", found, [block.data for block in found.cells])
    number = _of("triangle", found, found.cell_data[key])
    return {name: triangles[number == tag].astype(np.int32) for name, tag in names.items() if tag in number}


def _cell_sets(found: Any) -> dict[str, IntArray]:
    """The tetrahedra of each set of elements of Abaqus, which counts them anew in each block."""
    first, sets = 0, dict[str, list[Any]]()
    for number, block in enumerate(found.cells):
        if block.type == "tetra":
            for name, parts in found.cell_sets.items():
                sets.setdefault(name, []).append(np.asarray(parts[number], np.int32) + np.int32(first))
            first += len(block.data)
    return {name: np.unique(np.concatenate(parts)) for name, parts in sets.items() if name != _EVERY}
