"""Files other than GIfTI, recognised by their first bytes: readers for some, names for the others."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import drawn_surfaces, freesurfer, stl
from cortet.formats.numbering import in_32_bits
from cortet.formats.untrusted import GZIP, content, numbers, safe_name
from cortet.meshes import TriSurface

#: number of bytes examined; an OBJ file may begin with comments
_HEAD = 1 << 16
#: CIVET: a surface begins with P, five properties of light and the number of vertices, values with a line of one number
_MNI = re.compile(rb"\s*P(\s+[-+.\dEe]+){5}\s+\d+\s")
_NUMBERS = re.compile(rb"\s*[-+.\d]+([eE][-+]?\d+)?[ \t]*\r?\n")
_VTK = re.compile(rb"<VTKFile[^>]*\btype=[\"'](\w+)")
_CONVERT = "convert it to GIfTI or PLY: ParaView, or pyvista.read(FILE).save(PLY)"
#: first bytes and kind of files that are not read; a remedy, if there is one, follows in brackets
_NAMES: tuple[tuple[bytes, str], ...] = (
    (b"#!ascii", "a FreeSurfer surface in text (convert it: mris_convert)"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file (git lfs pull)"),
    (b"/annex/objects", "a pointer of git-annex, not the file (datalad get, or git annex get)"),
    (b"PK\x03\x04", "a ZIP archive (unpack it)"),
    (b"<!DOCTYPE html", "a web page, not the file (download it again)"),
    (b"<html", "a web page, not the file (download it again)"),
    (b"# vtk DataFile", f"a VTK file ({_CONVERT})"),
    (b"$MeshFormat", "a Gmsh mesh"),
    (b"*HEADING", "an Abaqus mesh"),
    (b"\x89HDF", "an HDF5 file"),
    (b"\x5c\x01\x00\x00", "a NIfTI image"),
    (b"\x1c\x02\x00\x00", "a NIfTI-2 or CIFTI file"),
    (b"\x00\x00\x00\x01\x00\x00", "an MGH image"),
    (b"MATLAB", "a MATLAB file"),
    (b"mz3", "an MZ3 surface"),
)


def surface_reader(path: Path) -> Callable[..., TriSurface] | None:
    """The reader of a surface that is not GIfTI, `read(path, finite=...)`; None if the first bytes are unknown."""
    head, size = _beginning(path)
    if freesurfer.is_surface(head, size):
        return freesurfer.read_surface
    if stl.begins(head, size):
        return _always_finite(stl.read)
    return _always_finite(drawn_surfaces.read) if drawn_surfaces.kind_of(head) else None


def fields_of(path: Path) -> dict[str, NDArray[Any]] | None:
    """Per-vertex values of a FreeSurfer file, or of plain numbers, by its name; None for any other file."""
    head, size = _beginning(path)
    if freesurfer.is_values(head, size):
        return freesurfer.read_values(path)
    if _NUMBERS.match(head):
        return {safe_name(path.name.split(".")[0]): _plain(path)}
    return freesurfer.read_annotation(path).field if freesurfer.is_annotation(head, size) else None


def label_names_of(path: Path) -> dict[int, str] | None:
    """Key -> name of the labels of a FreeSurfer annotation; empty for values and numbers; None for any other file."""
    head, size = _beginning(path)
    if freesurfer.is_values(head, size) or _NUMBERS.match(head):
        return {}
    return freesurfer.read_annotation(path).names if freesurfer.is_annotation(head, size) else None


def name_of(path: Path) -> str:
    """Kind of a file that can be read neither as a surface nor as a field; empty if its first bytes are unknown."""
    head, size = _beginning(path)
    known = [name for begin, name in _NAMES if head.lstrip().startswith(begin) or head.startswith(begin)]
    if known:
        return known[0]
    if vtk := _VTK.search(head):
        return f"VTK {vtk[1].decode()} ({_CONVERT})"
    if stl.begins(head, size) or drawn_surfaces.kind_of(head):
        return "a surface without values"
    if freesurfer.is_surface(head, size):
        return "a FreeSurfer surface"
    if freesurfer.is_values(head, size):
        return "values of FreeSurfer, no surface"
    if _MNI.match(head):
        return "a surface of MNI, as CIVET writes it (convert it with AFNI: ConvertSurface -i_mni FILE -o_gii GII)"
    if _NUMBERS.match(head):
        return "plain numbers, no surface"
    return "an annotation of FreeSurfer, no surface" if freesurfer.is_annotation(head, size) else ""


def _plain(path: Path) -> NDArray[Any]:
    """Numbers of a text, one a line: (n,); whole numbers without a point are labels, int32."""
    text = content(path).decode("utf-8", "replace").rstrip()
    whole = re.fullmatch(r"[-+\d\s]+", text) is not None
    try:
        values = numbers(text, np.dtype(np.int64 if whole else np.float64))
        if len(values) != len(text.strip().splitlines()):
            raise ValueError("some lines have no number or several")
    except ValueError as error:
        raise InputError(
            f"does not have one number per line: {error}", file=path, remedy="write one number per line"
        ) from None
    return in_32_bits(values, "labels", path) if whole else values


def _always_finite(read: Callable[[Path], TriSurface]) -> Callable[..., TriSurface]:
    """A reader that refuses coordinates that are not finite, whatever `finite` says."""

    def reader(path: Path, *, finite: bool = True) -> TriSurface:  # noqa: ARG001
        return read(path)

    return reader


def _beginning(path: Path) -> tuple[bytes, int]:
    """The first bytes of a file and its size, both unpacked from gzip; no bytes if it is not a regular file."""
    if not path.is_file():
        return b"", 0
    try:
        with path.open("rb") as file:
            head, size = file.read(_HEAD), path.stat().st_size
    except OSError:
        return b"", 0
    if head.startswith(GZIP):
        data = content(path)
        return data[:_HEAD], len(data)
    return head, size
