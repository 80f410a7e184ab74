"""Files of surfaces: GIfTI in every form, and what other programs write."""

from __future__ import annotations

import base64
import re
import zlib
from pathlib import Path

import numpy as np
import trimesh
from shapes import ball_surface

POINTS = np.array([[0, 0, 0], [1.5, 0, 0], [0, 2.25, 0], [0, 0, -3]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
MATRIX = "1 0 0 -90 0 1 0 -126 0 0 1 -72 0 0 0 1"
BALL = ball_surface(2, 20.0)
MESH = trimesh.Trimesh(BALL.points, BALL.faces, process=False)
#: a surface as other programs write it
FOREIGN = {
    "binary.stl": MESH.export(file_type="stl"),
    "text.stl": MESH.export(file_type="stl_ascii").encode(),
    "binary.ply": MESH.export(file_type="ply"),
    "text.ply": MESH.export(file_type="ply", encoding="ascii"),
    "plain.obj": MESH.export(file_type="obj").encode(),
    "plain.off": MESH.export(file_type="off").encode(),
}


def data_array(
    values: np.ndarray,
    intent: str,
    encoding: str = "GZipBase64Binary",
    order: str = "C",
    endian: str = "<",
    inside: str = "",
    **other: str,
) -> str:
    """One <DataArray>; `other` replaces any of its attributes."""
    flat = values.ravel(order=order)
    stored = flat.astype(flat.dtype.newbyteorder(endian)).tobytes()
    text = {
        "ASCII": lambda: re.sub(r"((\S+ ){3})", r"\1\n", " ".join(map(str, flat))),
        "Base64Binary": lambda: base64.b64encode(stored).decode(),
        "GZipBase64Binary": lambda: base64.b64encode(zlib.compress(stored)).decode(),
        "ExternalFileBinary": lambda: "",
    }[encoding]()
    attributes = {
        "Intent": f"NIFTI_INTENT_{intent}",
        "DataType": f"NIFTI_TYPE_{values.dtype.name.upper()}",
        "ArrayIndexingOrder": "RowMajorOrder" if order == "C" else "ColumnMajorOrder",
        "Dimensionality": str(values.ndim),
        **{f"Dim{i}": str(n) for i, n in enumerate(values.shape)},
        "Encoding": encoding,
        "Endian": "LittleEndian" if endian == "<" else "BigEndian",
        **other,
    }
    written = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    return f"<DataArray {written}>{inside}<Data>{text}</Data></DataArray>"


def system(dataspace: str, space: str, matrix: str) -> str:
    """A coordinate system."""
    return (
        f"<CoordinateSystemTransformMatrix><DataSpace><![CDATA[{dataspace}]]></DataSpace><TransformedSpace><![CDATA["
        f"{space}]]></TransformedSpace><MatrixData>{matrix}</MatrixData></CoordinateSystemTransformMatrix>"
    )


def metadata(known: dict[str, str]) -> str:
    told = "".join(f"<MD><Name>{key}</Name><Value><![CDATA[{value}]]></Value></MD>" for key, value in known.items())
    return f"<MetaData>{told}</MetaData>"


def points(values: np.ndarray = POINTS, **how: str) -> str:
    given = {"inside": system("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH", MATRIX)} | how
    return data_array(values, "POINTSET", **given)


def triangles(values: np.ndarray = FACES, **how: str) -> str:
    return data_array(values, "TRIANGLE", **how)


def gifti(*arrays: str) -> bytes:
    return f'<?xml version="1.0"?>\n<GIFTI Version="1.0">{"".join(arrays)}</GIFTI>'.encode()


def saved(folder: Path, name: str, content: bytes) -> Path:
    (folder / name).write_bytes(content)
    return folder / name
