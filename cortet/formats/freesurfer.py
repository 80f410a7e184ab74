"""FreeSurfer's triangle surfaces, `lh.white` and the like, read by nibabel.

Coordinates are in the tool's own space ("surface RAS", mm); the translation to the scanner's, where the file has it,
becomes the matrix of the coordinate frame (https://surfer.nmr.mgh.harvard.edu/fswiki/CoordinateSystems).
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from nibabel.freesurfer.io import read_geometry

from cortet.errors import InputError
from cortet.mesh import CoordinateFrame, TriSurface

#: the first bytes of a file of triangles
_MAGIC = b"\xff\xff\xfe"


def is_surface(path: Path) -> bool:
    """Whether a file, which need not exist, begins like one of FreeSurfer's surfaces."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def read_surface(path: Path, *, finite: bool = True) -> TriSurface:
    """Read a triangulated surface; with `finite` false its coordinates need not be.

    Raises
    ------
    InputError : the file is truncated, a coordinate is not finite, or a triangle refers to a vertex that does not exist
    """
    remedy = "run recon-all again, or export the surface as GIfTI (mris_convert)"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without a footer is whole
        try:
            points, faces, footer = read_geometry(str(path), read_metadata=True)  # type: ignore[no-untyped-call]
        except (ValueError, IndexError, OverflowError, MemoryError, UnicodeDecodeError) as error:
            raise InputError(f"no complete FreeSurfer surface ({error})", file=path, remedy=remedy) from None
    if finite and not np.isfinite(points).all():
        raise InputError("coordinates are not finite", file=path, remedy=remedy)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        what = f"triangles refer to vertices {faces.min()} to {faces.max()}, but there are {len(points)}"
        raise InputError(what, file=path, remedy=remedy)
    return TriSurface(points, faces, frame=_frame(footer))


def _frame(footer: dict[str, Any]) -> CoordinateFrame:
    """The translation of a file's footer; none where it says that it is not valid."""
    if not str(footer.get("valid", "")).startswith("1"):
        return CoordinateFrame()
    matrix = np.eye(4)
    matrix[:3, 3] = footer["cras"]
    return CoordinateFrame("NIFTI_XFORM_UNKNOWN", "NIFTI_XFORM_SCANNER_ANAT", tuple(matrix.ravel().tolist()))
