"""Files other than GIfTI, recognised by their first bytes: readers for some, names for the others."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.formats import drawn_surfaces, freesurfer, stl
from cortet.formats.freesurfer import Values
from cortet.formats.untrusted import GZIP, by_library, content, safe_name, unreadable
from cortet.formats.values import in_32_bits
from cortet.meshes import TriSurface

#: number of bytes examined; an OBJ file may begin with comments
_HEAD = 1 << 16
#: plain values, as CIVET writes them, begin with a line of one number
_NUMBERS = re.compile(rb"\s*[-+.\d]+([eE][-+]?\d+)?[ \t]*\r?\n")
#: first bytes of files that are not read, and what to do; a remedy, if there is one, follows in brackets
_NAMES = {
    b"#!ascii label": "a FreeSurfer label, a list of vertices",
    b"#!ascii": "a FreeSurfer surface in text (convert it: mris_convert)",
    b"version https://git-lfs": "a pointer of Git LFS (git lfs pull)",
    b"/annex/objects": "a pointer of git-annex (datalad get)",
    b"PK\x03\x04": "a ZIP archive (unpack it)",
    b"<!DOCTYPE html": "a web page (download the file again)",
    b"<html": "a web page (download the file again)",
    b"# vtk DataFile": "a VTK file (convert it to PLY: ParaView, or pyvista.read(FILE).save(PLY))",
    b"<VTKFile": "a VTK file (convert it to PLY: ParaView, or pyvista.read(FILE).save(PLY))",
    b"XSym\n": "a link that a file system of Windows stores as text (copy the file to which it led)",
    b"P ": "a surface of MNI (convert it with AFNI: ConvertSurface -i_mni FILE -o_gii GII)",
    b"\x5c\x01\x00\x00": "a NIfTI image",
    b"\x1c\x02\x00\x00": "a CIFTI file or a NIfTI image (wb_command -cifti-separate extracts the values of a surface)",
    b"\x00\x00\x00\x01": "an image (MGH, MGZ)",
}


def surface_reader(path: Path) -> Callable[..., TriSurface] | None:
    """The reader of a surface that is not GIfTI, `read(path, finite=...)`; None if the first bytes are unknown."""
    head, size = _beginning(path)
    if head.startswith(freesurfer.SURFACES):
        return freesurfer.read_surface
    read = stl.read if stl.begins(head, size) else drawn_surfaces.read if drawn_surfaces.kind_of(head) else None
    return read and (lambda path, *, finite: read(path))  # noqa: ARG005, PLW0108, never what is not finite


def values_of(path: Path) -> Values | None:
    """Per-vertex values or labels of a FreeSurfer file, or of plain numbers; None for any other file."""
    head, size = _beginning(path)
    if head.startswith(freesurfer.VALUES) and not freesurfer.is_rounded(head, size):
        return freesurfer.read_values(path)
    if _NUMBERS.match(head):
        return Values({safe_name(path.name.split(".")[0]): _plain(path)}, {})
    return freesurfer.read_annotation(path) if path.name.endswith(freesurfer.ANNOTATION) else None


def name_of(path: Path) -> str:
    """Kind of a file that can be read neither as a surface nor as a field; empty if its first bytes are unknown."""
    head, size = _beginning(path)
    start = head.removeprefix(b'<?xml version="1.0"?>').lstrip()
    if surface_reader(path) is not None:
        return "a surface without values"
    if freesurfer.is_rounded(head, size):
        return "a FreeSurfer surface of quadrangles with rounded coordinates (convert it: mris_convert)"
    if head.startswith(freesurfer.VALUES) or path.name.endswith(freesurfer.ANNOTATION) or _NUMBERS.match(head):
        return "a file of values without a surface"
    return next((name for begin, name in _NAMES.items() if start.startswith(begin)), "")


def _plain(path: Path) -> NDArray[Any]:
    """Numbers of a text, one a line: (n,); whole numbers without a point are labels, int32."""
    text = content(path).decode("utf-8", "replace").strip()
    whole = re.fullmatch(r"[-+\d\s]+", text) is not None
    with by_library("one number per line", path):
        values = np.array([(int if whole else float)(line) for line in text.splitlines()])
        return in_32_bits(values, "labels", path) if whole else values


def _beginning(path: Path) -> tuple[bytes, int]:
    """The first bytes of a file and its size, both unpacked from gzip; no bytes if it is not a regular file."""
    if not path.is_file():
        return b"", 0
    try:
        with path.open("rb") as file:
            head, size = file.read(_HEAD), path.stat().st_size
    except OSError as error:
        raise unreadable(path, error) from error
    if head.startswith(GZIP):
        data = content(path)
        return data[:_HEAD], len(data)
    return head, size
