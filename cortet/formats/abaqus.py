"""Abaqus `.inp`, which CalculiX reads too: nodes, C3D4 elements, and the named sets of nodes, elements and faces.

Nodes and elements count from 1 in the order of the mesh, volumes are positive. `*SURFACE` names faces by element and
side: S1 = 1-2-3, S2 = 1-4-2, S3 = 2-4-3, S4 = 3-4-1 (Abaqus Elements Guide, "Three-dimensional solid element library").
There is no material and no step: a job includes the file (`*INCLUDE, INPUT=mesh.inp`) and adds both. Coordinates have
12 significant digits, since CalculiX reads 20 characters of a number.

Fields of nodes are in a separate file, `<name>_fields.inp`, as `*INITIAL CONDITIONS, TYPE=FIELD`. Abaqus reads it,
CalculiX does not. Comments `** region 1: cortex` give the numbers of the sets that are regions (`tags`). A field of k
components takes k variables; a comment before each variable names it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.numbering import in_32_bits, indices, whole
from cortet.formats.surface_sets import faces_of_sides, sides, with_surface
from cortet.formats.tags import regions
from cortet.formats.text import BadRowError, read_rows, write_rows, write_wrapped
from cortet.formats.untrusted import content, require_ascii, sound
from cortet.meshes import REGION, FloatArray, IntArray, MeshSets, TetMesh

#: names of the sets of all nodes and of all elements
ALL_NODES, ALL_ELEMENTS = "all_nodes", "all_elements"
#: number of the side opposite each corner; the table is its own inverse
_SIDE = np.array([3, 4, 2, 1])
_OPPOSITE = np.array([-1, 3, 2, 0, 1])
_PER_LINE = 16
#: names that Abaqus accepts (Analysis User's Guide, "Input syntax rules"); it ignores case
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,79}$")

#: keywords that add or move nodes or elements in ways that `read` does not support
_ELSEWHERE = {
    "INCLUDE": "takes lines from another file",
    "SYSTEM": "changes the coordinate system",
    **dict.fromkeys(("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"), "makes nodes or elements of others"),
}
#: most numbers that the ranges of one block may expand to
_MOST_GENERATED = 2**24
_REGION = re.compile(rb"^\*\* region (\d{1,9}): (\S+)\s*$", re.MULTILINE)
#: elements of four nodes: C3D4, and its kin for hybrid, thermal, acoustic and other analyses
_TETRAHEDRON = re.compile(r"[AD]?C3D4[A-Z]*$")
#: exponents of double precision, as Fortran writes them
_EXPONENT = re.compile(rb"(?<=[\d.])[dD](?=[+-]?\d)")
#: commas that are not within quotation marks
_OUTSIDE_QUOTES = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')
_COMMENT = re.compile(rb"^\*\*[^\n]*", re.MULTILINE)
_FIELD = re.compile(rb"^\*\* variable (\d+): (\S+), component (\d+) of (\d+), (\w+)$", re.MULTILINE)


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path` and, if the mesh has fields, the file of its fields; each complete or not at all."""
    mesh = with_surface(mesh)
    require_ascii(mesh.point_data, path)
    write_elements(mesh, mesh.points, mesh.cells, mesh.sets.nodes, path)
    if mesh.point_data:
        with atomic_path(fields_path(path)) as temporary, temporary.open("w", encoding="ascii") as file:
            _write_fields(file, mesh.point_data)


def write_elements(
    mesh: TetMesh, points: FloatArray, cells: IntArray, node_sets: Mapping[str, IntArray], path: str | Path
) -> None:
    """Write `path` without fields, complete or not at all, with C3D4 or with C3D10 elements.

    Parameters
    ----------
    mesh : has the sets of elements and faces
    points : (n, 3) mm
    cells : (m, 4), or (m, 10) whose midside nodes are in the order 1-2, 2-3, 3-1, 1-4, 2-4, 3-4
    node_sets : name -> nodes
    """
    require_ascii([*node_sets, *mesh.sets.cells, *mesh.sets.faces], path)
    kind, numbers = {4: "C3D4", 10: "C3D10"}[cells.shape[1]], ", ".join(["%d"] * (1 + cells.shape[1]))
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write("*HEADING\nTetrahedral mesh, coordinates in mm\n")
        file.write(f"*NODE, NSET={ALL_NODES}\n")
        write_rows(file, "%d, %.12g, %.12g, %.12g\n", np.arange(1, len(points) + 1), points)
        file.write(f"*ELEMENT, TYPE={kind}, ELSET={ALL_ELEMENTS}\n")
        write_rows(file, f"{numbers}\n", np.arange(1, len(cells) + 1), cells + 1)
        for name, nodes in node_sets.items():
            file.write(f"*NSET, NSET={name}\n")
            write_wrapped(file, nodes + 1, _PER_LINE)
        named = {name: number for name, number in regions(mesh).items() if name in mesh.sets.cells}
        file.writelines(f"** region {number}: {name}\n" for name, number in named.items())
        for name, members in mesh.sets.cells.items():
            file.write(f"*ELSET, ELSET={name}\n")
            write_wrapped(file, members + 1, _PER_LINE)
        for name, faces in mesh.sets.faces.items():
            owners, opposite = sides(mesh, faces)
            file.write(f"*SURFACE, TYPE=ELEMENT, NAME={name}\n")
            write_rows(file, "%d, S%d\n", owners + 1, _SIDE[opposite])


def fields_path(path: str | Path) -> Path:
    """The file of the fields beside a mesh file."""
    return Path(path).with_name(Path(path).name.removesuffix(".inp") + "_fields.inp")


def _write_fields(file: IO[str], fields: dict[str, NDArray[Any]]) -> None:
    variable = 0
    for name, values in fields.items():
        columns = values.reshape(len(values), -1)
        kind = "integer" if np.issubdtype(values.dtype, np.integer) else "real"
        number = "%d" if kind == "integer" else "%.12g"
        columns = in_32_bits(columns, f"field `{name}`") if kind == "integer" else columns
        for component, column in enumerate(columns.T, start=1):
            variable += 1
            file.write(f"** variable {variable}: {name}, component {component} of {columns.shape[1]}, {kind}\n")
            file.write(f"*INITIAL CONDITIONS, TYPE=FIELD, VARIABLE={variable}\n")
            write_rows(file, f"%d, {number}\n", np.arange(1, len(values) + 1), column)


def read(path: str | Path) -> TetMesh:
    """Read a mesh of C3D4 elements with its sets, and with its fields if their file is beside it.

    Tetrahedra are returned as they are in the file, positive or not; any node and element numbers are allowed.

    Raises
    ------
    InputError
        the file is missing, holds other elements, or names nodes or elements it lacks; or a line cannot be read
    """
    node_rows, element_rows = [np.empty((0, 4))], [np.empty((0, 5), np.int64)]
    node_sets, cell_sets, surfaces = _Sets(), _Sets(), _Sets()
    blocks = _blocks(path)
    _refuse_several(blocks, path)
    for keyword, options, data, line in blocks:
        _refuse_unread(keyword, options, data, line, path)
        try:
            if keyword == "NODE":
                node_rows.append(read_rows(_EXPONENT.sub(b"E", data), 4, float, delimiter=","))
                node_sets.add(options.get("NSET", ALL_NODES), whole(node_rows[-1][:, 0], "node", path))
            elif keyword == "ELEMENT":
                if not _TETRAHEDRON.match(kind := options.get("TYPE", "none")):
                    what = f"line {line}: elements of type {kind}, not C3D4"
                    raise InputError(what, file=path, remedy="export the tetrahedra of four nodes alone")
                element_rows.append(read_rows(data, 5, np.int64, delimiter=","))
                cell_sets.add(options.get("ELSET", ALL_ELEMENTS), element_rows[-1][:, 0])
            elif keyword in ("NSET", "ELSET"):
                named = node_sets if keyword == "NSET" else cell_sets
                named.add(options[keyword], _ranges(data) if "GENERATE" in options else named.members(data))
            elif keyword == "SURFACE":
                surfaces.add(options["NAME"], _sides(data, cell_sets))
        except BadRowError as error:
            raise DamagedFileError(f"line {_line_of(error.row, data, line)} {error}", file=path) from error
        except (KeyError, ValueError, OverflowError) as error:
            what = f"line {line}: *{keyword} cannot be read: {error}"
            raise InputError(what, file=path, remedy="write sets as numbers, and sides as S1 to S4") from error
    nodes, elements = np.concatenate(node_rows), np.concatenate(element_rows)
    if not len(nodes) or not len(elements):
        raise DamagedFileError("holds no nodes or no elements", file=path)
    number_of_node, number_of_cell = whole(nodes[:, 0], "node", path), elements[:, 0]
    cells = indices(elements[:, 1:], number_of_node, "node", path)
    faces = {}
    for name, rows in surfaces.joined().items():
        if len(rows) and not (rows[:, 1].min() >= 1 and rows[:, 1].max() <= 4):
            raise DamagedFileError(f"*SURFACE {name} names a side that is not S1 to S4", file=path)
        owners = indices(rows[:, 0], number_of_cell, "element", path)
        faces[name] = faces_of_sides(cells, owners, _OPPOSITE[rows[:, 1]])
    sets = MeshSets(
        {
            name: indices(numbers, number_of_node, "node", path)
            for name, numbers in node_sets.joined().items()
            if name != ALL_NODES
        },
        faces,
        {
            name: indices(numbers, number_of_cell, "element", path)
            for name, numbers in cell_sets.joined().items()
            if name != ALL_ELEMENTS
        },
    )
    fields = _read_fields(fields_path(path), number_of_node)
    return sound(path, nodes[:, 1:], cells, fields, _region(content(path), sets, len(cells)), sets)


def _region(text: bytes, sets: MeshSets, count: int) -> dict[str, IntArray]:
    """The number of the region of each element, if comments number sets that hold them all."""
    number = np.zeros(count, np.int32)
    for tag, name in _REGION.findall(text):
        number[sets.cells.get(name.decode("ascii", "replace"), [])] = int(tag)
    return {REGION: number} if count and number.all() else {}


def _line_of(row: int, data: bytes, line: int) -> int:
    """Line number of a row of the data below line `line`; blank lines are not rows."""
    filled = (number for number, text in enumerate(data.split(b"\n"), start=1) if text.strip())
    return line + next(itertools.islice(filled, row, None), 1)


class _Sets:
    """Sets by name. Each block of a file adds its members to the set that it names."""

    def __init__(self) -> None:
        self._parts: dict[str, list[NDArray[np.int64]]] = {}

    def add(self, name: str, members: NDArray[np.int64]) -> None:
        """Add the members that a block lists, one per row."""
        self._parts.setdefault(name, []).append(members)

    def members(self, data: bytes) -> NDArray[np.int64]:
        """The integers of lines of any length, and the members of the sets that they name; ValueError for no set."""
        plain = data.replace(b",", b" ")
        if not re.search(rb"[^\s0-9+-]", plain):
            return np.array(plain.split(), np.int64)
        return np.unique(np.concatenate([self.of_word(word) for word in _words(data)]))

    def of_word(self, word: str) -> NDArray[np.int64]:
        """The number that a word is, or the members of the set that it names, perhaps after an instance and a dot."""
        if re.fullmatch(r"[+-]?\d+", word):
            return np.array([int(word)], np.int64)
        for name in (word, word.partition(".")[2]):
            if found := [part for own, part in self._parts.items() if own.lower() == name.lower()]:
                return np.concatenate(found[0])
        raise ValueError(f"there is no set {word} before it")

    def joined(self) -> dict[str, NDArray[np.int64]]:
        """All members of each set, without repetitions even if several blocks list them."""
        return {
            name: parts[0] if len(parts) == 1 else np.unique(np.concatenate(parts), axis=0)
            for name, parts in self._parts.items()
        }


def _sides(data: bytes, sets: _Sets) -> NDArray[np.int64]:
    """Elements and sides (k, 2) of lines `element, side` or `set of elements, side`."""
    plain = data.replace(b"S", b"").replace(b"s", b"")
    if not re.search(rb"[^\s0-9,]", plain):
        return read_rows(plain, 2, np.int64, delimiter=",")
    found = [np.empty((0, 2), np.int64)]
    for line in data.split(b"\n"):
        if len(words := _words(line)) == 2 and (side := re.fullmatch(r"[Ss](\d+)", words[1])):
            members = sets.of_word(words[0])
            found.append(np.column_stack([members, np.full(len(members), int(side[1]))]))
        elif words:
            raise ValueError(f"`{', '.join(words)}` names no element or set, and a side S1 to S4")
    return np.concatenate(found)


def _words(line: bytes) -> list[str]:
    """The words between commas, without quotation marks."""
    words = _OUTSIDE_QUOTES.split(line.decode("ascii", "replace").replace("\n", ","))
    return [word.strip().strip('"') for word in words if word.strip()]


def _refuse_several(blocks: list[tuple[str, dict[str, str], bytes, int]], path: str | Path) -> None:
    """Raise InputError for a file with more than one part or instance, or with nodes outside of it."""
    remedy, where = "export one part as one mesh", "a part"
    for keyword in ("PART", "INSTANCE"):
        lines = [(options.get("NAME", ""), line) for word, options, _, line in blocks if word == keyword]
        if len(lines) > 1:
            what = f"line {lines[1][1]}: *{keyword}, NAME={lines[1][0]} is the second, and one mesh is read"
            raise InputError(what, file=path, remedy=remedy)
    for keyword, _, _, line in blocks:
        if keyword in ("PART", "ASSEMBLY", "INSTANCE", "END PART", "END INSTANCE"):
            where = "the assembly" if keyword in ("ASSEMBLY", "END INSTANCE") else "a part"
        elif keyword in ("NODE", "ELEMENT") and where == "the assembly":
            what = f"line {line}: *{keyword} in the assembly, beside the part, is not read"
            raise InputError(what, file=path, remedy=remedy)


def _refuse_unread(keyword: str, options: Mapping[str, str], data: bytes, line: int, path: str | Path) -> None:
    """Raise InputError if a block says more about the mesh than `read` understands: the result would be wrong."""
    where, remedy = f"line {line}: *{keyword}", "export the mesh as plain *NODE, *ELEMENT, *NSET, *ELSET and *SURFACE"
    if keyword in _ELSEWHERE:
        raise InputError(f"{where}, which {_ELSEWHERE[keyword]}, is not read", file=path, remedy=remedy)
    if "INPUT" in options and keyword in ("NODE", "ELEMENT", "NSET", "ELSET"):
        raise InputError(
            f"{where} takes its lines from {options['INPUT']}, which is not read", file=path, remedy=remedy
        )
    if keyword == "NODE" and options.get("SYSTEM", "R").upper() != "R":
        raise InputError(f"{where}: coordinates are not rectangular", file=path, remedy=remedy)
    if keyword == "NSET" and "ELSET" in options:
        raise InputError(f"{where}: a set of the nodes of {options['ELSET']} is not read", file=path, remedy=remedy)
    if keyword == "SURFACE" and options.get("TYPE", "ELEMENT") != "ELEMENT":
        raise InputError(f"{where} of type {options['TYPE']} is not read, only ELEMENT", file=path, remedy=remedy)
    if keyword == "INSTANCE" and data.strip():
        raise InputError(f"{where} moves its part, which is not read", file=path, remedy=remedy)


def _blocks(path: str | Path) -> list[tuple[str, dict[str, str], bytes, int]]:
    """Keyword, options, data lines and line number of every block; comments become blank lines.

    Keywords, options and the values that Abaqus knows are in capitals; names of sets keep their case.
    """
    text = _COMMENT.sub(b"", content(path).replace(b"\r\n", b"\n"))
    starts = [0] if text.startswith(b"*") else []
    while (newline := text.find(b"\n*", starts[-1] if starts else 0)) >= 0:
        starts.append(newline + 1)
    blocks, line = [], 1 + text.count(b"\n", 0, starts[0] if starts else 0)
    for start, end in zip(starts, [*starts[1:], len(text)], strict=False):
        head, _, data = text[start:end].partition(b"\n")
        lines = 1
        while head.rstrip().endswith(b","):  # the keyword line continues
            more, _, data = data.partition(b"\n")
            head, lines = head + more, lines + 1
        keyword, *options = (word.strip() for word in _OUTSIDE_QUOTES.split(head[1:].decode("ascii", "replace")))
        pairs = (option.partition("=") for option in options)
        values = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        if "TYPE" in values:
            values["TYPE"] = values["TYPE"].upper()
        blocks.append((keyword.upper(), values, data, line + lines - 1))
        line += text.count(b"\n", start, end)
    return blocks


def _ranges(data: bytes) -> NDArray[np.int64]:
    """The integers of lines `first, last, increment`, both ends included; without an increment it is 1 or -1."""
    found, total = [np.empty(0, np.int64)], 0
    for text in data.replace(b",", b" ").split(b"\n"):
        numbers = [int(word) for word in text.split()]
        if not numbers:
            continue
        first, last, step = (*numbers, 1 if numbers[0] <= numbers[1] else -1) if len(numbers) == 2 else numbers
        if step == 0 or (last - first) * step < 0:
            raise ValueError(f"{first} to {last} by {step} is not a range")
        total += (last - first) // step + 1
        if total > _MOST_GENERATED:
            raise ValueError(f"generates more than {_MOST_GENERATED:,} numbers")
        found.append(np.arange(first, last + (1 if step > 0 else -1), step))
    return np.sort(np.concatenate(found))


def _read_fields(path: Path, number_of_node: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """The fields in the file beside the mesh; none if that file is missing."""
    if not path.exists():
        return {}
    names = {match[1]: match for match in _FIELD.finditer(content(path))}
    parts: dict[str, list[NDArray[Any]]] = {}
    for keyword, options, data, line in _blocks(path):
        found = names.get(options.get("VARIABLE", "").encode())
        if keyword != "INITIAL CONDITIONS" or options.get("TYPE") != "FIELD" or found is None:
            raise DamagedFileError(f"line {line}: not a field variable that a comment names", file=path)
        integer = found[5] == b"integer"
        try:
            rows = read_rows(data, 2, float, delimiter=",")
        except BadRowError as error:
            raise DamagedFileError(f"line {_line_of(error.row, data, line)} {error}", file=path) from error
        name = found[2].decode(errors="replace")
        if not np.array_equal(rows[:, 0], number_of_node):
            raise DamagedFileError(
                f"field {name} has {len(rows)} values for {len(number_of_node)} nodes, or other nodes", file=path
            )
        values = rows[:, 1]
        parts.setdefault(name, []).append(whole(values, "value", path).astype(np.int32) if integer else values)
    return {name: columns[0] if len(columns) == 1 else np.stack(columns, axis=1) for name, columns in parts.items()}


def as_read(path: Path) -> AsRead:
    """The file as Abaqus and CalculiX see it; raises InputError if it cannot be read."""
    mesh = read(path)
    return AsRead(mesh, [*_names(mesh)], directs_faces=False)


def _names(mesh: TetMesh) -> Iterator[str]:
    for names in (mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells):
        for name in names:
            if not _NAME.match(name):
                yield f"set {name!r} has a name that Abaqus does not take"
        folded = [name.lower() for name in names]
        for name in sorted({name for name in folded if folded.count(name) > 1}):
            yield f"two sets are named {name}: Abaqus does not tell upper from lower case"
