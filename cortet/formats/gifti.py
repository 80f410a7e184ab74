"""GIfTI: surfaces and per-vertex fields (https://www.nitrc.org/projects/gifti, format 1.0).

nibabel writes files, but does not read them: version 5.4 misreads column-major ASCII that is wrapped into lines of
three, and rejects ASCII lines of unequal length.

Coordinates are stored as float32, the only type that every GIfTI tool reads (resolution 4e-6 mm at 60 mm).
`single_precision` rounds a surface to what a file holds: stages that move vertices return such surfaces, so that
nothing downstream depends on whether the surface went through a file.
"""

# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import base64
import math
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
from nibabel.gifti.gifti import GiftiCoordSystem, GiftiDataArray, GiftiImage, GiftiMetaData
from nibabel.nifti1 import xform_codes
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import foreign, frames
from cortet.formats.atomic import atomic_path
from cortet.formats.frames import System
from cortet.formats.numbering import in_32_bits
from cortet.formats.untrusted import (
    XML_ERRORS,
    check_file,
    content,
    naming,
    numbers,
    safe_name,
    safely_named,
    xml_root,
)
from cortet.meshes import TriSurface

#: name of the region in the file name of an inner surface
_REGION = re.compile(r"_inner-([A-Za-z0-9]+)_")
_INSTEAD = (
    "give GIfTI; a surface may also be one of FreeSurfer, STL, PLY, OBJ or OFF, and a field values or an annotation of "
    "FreeSurfer"
)
_EXPORT_AGAIN = "export the surface again as GIfTI (.surf.gii)"
_TYPES = {
    f"NIFTI_TYPE_{name.upper()}": np.dtype(name)
    for name in ("uint8", "int8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
}
#: GIfTI 1.0 has the first two; NiBabel up to 2.1 wrote the others
_ENDIANS: dict[str, Literal["<", ">"]] = {
    "LittleEndian": "<",
    "BigEndian": ">",
    "GIFTI_ENDIAN_LITTLE": "<",
    "GIFTI_ENDIAN_BIG": ">",
}
_ZLIB_OR_GZIP = 47
#: most dimensions of an array (GIfTI 1.0, section 5)
_MAX_DIMENSIONS = 6
#: vertices to which values belong, in place of all of them in their order
_NODES = "NIFTI_INTENT_NODE_INDEX"
_GEOMETRY = ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE", _NODES)


#: value of the metadata that names the structure, as CDATA or as it stands; and of that which names the surface
_STRUCTURE = rb"AnatomicalStructurePrimary.{0,99}?<Value>\s*(?:<!\[CDATA\[)?\s*(\w+)"
_SECONDARY = _STRUCTURE.replace(b"Primary", b"Secondary")


class _Array(NamedTuple):
    intent: str
    name: str
    values: NDArray[Any]
    systems: list[System]
    #: metadata
    about: dict[str, str]


def read_surface(path: str | Path, *, finite: bool = True) -> TriSurface:
    """Read a triangulated surface; further per-vertex arrays in the file become its `point_data`.

    A surface of FreeSurfer (`lh.white`), STL, PLY, OBJ or OFF is read as well; its first bytes tell what it is.
    Any valid GIfTI will do: arrays in either order, row- or column-major, either endianness, ASCII, base64, compressed
    or in an external file, integer triangles of any type; or all of that packed by gzip.
    Names of fields that cannot be part of a file name are changed (`untrusted.safe_name`).

    Parameters
    ----------
    finite : false also accepts coordinates that are not finite, for the repair
    """
    if (read := foreign.surface_reader(Path(path))) is not None:
        return read(Path(path), finite=finite)
    arrays, provenance = _read(Path(path))
    points = _geometry(arrays, "NIFTI_INTENT_POINTSET", path)
    triangles = _geometry(arrays, "NIFTI_INTENT_TRIANGLE", path)
    frame = frames.of_gifti(points.systems, points.about, provenance, path)
    bad = np.flatnonzero(~np.isfinite(points.values).all(axis=1))
    if finite and len(bad):
        what = f"{len(bad)} vertices have coordinates that are not finite, the first is vertex {bad[0]}"
        raise InputError(f"{what}: {points.values[bad[0]].tolist()}", file=path, remedy=_EXPORT_AGAIN)
    with naming(path):
        return TriSurface(points.values, triangles.values, _fields(arrays, path, len(points.values)), frame)


def hemisphere_of(path: str | Path) -> Literal["L", "R"] | None:
    """The hemisphere that a GIfTI file names in AnatomicalStructurePrimary; None if it names none."""
    named = re.search(_STRUCTURE, content(path), re.DOTALL)
    known: dict[bytes, Literal["L", "R"]] = {b"CortexLeft": "L", b"CortexRight": "R"}
    return known.get(named[1]) if named else None


def require_same_hemisphere(path: str | Path, hemisphere: str | None) -> None:
    """Raise InputError if a file states another hemisphere than that of the surface it belongs to; None: unknown."""
    if hemisphere and (named := hemisphere_of(path)) not in (None, hemisphere):
        raise InputError(
            f"is of hemisphere {named} according to its metadata, not {hemisphere}",
            file=path,
            remedy="name the file of the same hemisphere",
        )


def kind_of(path: str | Path) -> Literal["white", "pial"] | None:
    """Which surface of the cortex a file holds, as a GIfTI states or its name says; None: unknown."""
    stated = re.search(_SECONDARY, content(path), re.DOTALL)
    known: dict[bytes, Literal["white", "pial"]] = {b"GrayWhite": "white", b"Pial": "pial"}
    if stated and stated[1] in known:
        return known[stated[1]]
    name = re.search(r"(?<![A-Za-z0-9])(?:(wm|white|smoothwm)|pial)(?![A-Za-z0-9])", Path(path).name)
    return None if name is None else "white" if name[1] else "pial"


def read_nested(path: str | Path, inner: Iterable[str | Path], fields: str | Path | None = None) -> TriSurface:
    """Read a surface and its inner surfaces, whose files are named `..._inner-NAME_...` after the regions inside them.

    Parameters
    ----------
    fields : another file of the same surface, whose fields replace those of `path`
    """
    from cortet.geometry.nesting import nested  # loads Numba and SciPy, which one surface does without

    named = {str(_REGION.findall(Path(file).name)[-1]): read_surface(file) for file in inner}
    surface = read_surface(path)
    if fields:
        surface = replace(surface, point_data=read_surface(fields).point_data)
    return nested(surface, named)


def read_fields(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read the per-vertex arrays of a .shape, .func or .label file: name -> (n,) or (n, k).

    Names come from the metadata `Name`, else from the file. Labels are int32 keys. Values and annotations of FreeSurfer
    (`lh.thickness`, `lh.aparc.annot`) are read as well. Raises InputError like `read_surface`.
    """
    if (fields := foreign.fields_of(Path(path))) is not None:
        return fields
    return _fields(_read(Path(path))[0], path)


def read_label_names(path: str | Path) -> dict[int, str]:
    """Key -> name of the labels in the LabelTable of a file; empty if it has none.

    A label without a name is left out. Raises InputError like `read_surface`, and for two labels of one key.
    """
    if (names := foreign.label_names_of(Path(path))) is not None:
        return names
    found: dict[int, str] = {}
    try:
        for label in xml_root(content(path), path).iterfind("LabelTable/Label"):
            text, stated = (label.text or "").strip(), label.get("Key") or label.get("Index")  # as before GIfTI 1.0
            if stated is None:
                raise ValueError(f"the label {text!r} has no key")
            if (key := int(stated)) in found:
                raise InputError(f"two labels of its table have the key {key}", file=path, remedy="keep one of the two")
            found[key] = text
        return {key: safe_name(text) for key, text in found.items() if text}
    except ValueError as error:
        raise InputError(f"its label table cannot be read: {error}", file=path, remedy=_EXPORT_AGAIN) from error


def write_surface(surface: TriSurface, path: str | Path, *, like: str | Path | None = None) -> None:
    """Write a surface, its fields and its coordinate frame; float32 coordinates, int32 triangles, compressed base64.

    Parameters
    ----------
    like : GIfTI file whose metadata it gets, such as the structure that it shows; another file has none
    """
    of_file, of_points = _metadata_of(like)
    frame = GiftiCoordSystem(
        xform_codes.code[surface.frame.dataspace],
        xform_codes.code[surface.frame.xformspace],
        np.reshape(surface.frame.matrix, (4, 4)),
    )
    arrays = [
        GiftiDataArray(
            surface.points.astype(np.float32),
            "NIFTI_INTENT_POINTSET",
            "NIFTI_TYPE_FLOAT32",
            coordsys=frame,
            meta=GiftiMetaData(of_points),
        ),
        GiftiDataArray(surface.faces, "NIFTI_INTENT_TRIANGLE", "NIFTI_TYPE_INT32"),
        *_arrays(surface.point_data),
    ]
    with atomic_path(path) as temporary:
        temporary.write_bytes(GiftiImage(darrays=arrays, meta=GiftiMetaData(of_file)).to_xml())


def _metadata_of(path: str | Path | None) -> tuple[dict[str, str], dict[str, str]]:
    """Metadata of a file and of its pointset; none of a file that is not GIfTI."""
    if path is None or foreign.surface_reader(Path(path)) is not None:
        return {}, {}
    root = xml_root(content(path), path)
    found = (one for one in root.iter("DataArray") if one.get("Intent") == "NIFTI_INTENT_POINTSET")
    return _metadata(root), next(map(_metadata, found), {})


def write_fields(
    fields: Mapping[str, NDArray[Any]], path: str | Path, *, hemisphere: Literal["L", "R"] | None = None
) -> None:
    """Write named per-vertex fields without a surface (.shape.gii, .func.gii); float32, labels int32.

    Parameters
    ----------
    hemisphere : whose structure the file names, as Connectome Workbench asks of it
    """
    named = {"L": "CortexLeft", "R": "CortexRight"}
    meta = GiftiMetaData(**({"AnatomicalStructurePrimary": named[hemisphere]} if hemisphere else {}))
    with atomic_path(path) as temporary:
        temporary.write_bytes(GiftiImage(darrays=_arrays(fields), meta=meta).to_xml())


def _arrays(fields: Mapping[str, NDArray[Any]]) -> list[GiftiDataArray]:
    """The fields as GIfTI holds them."""
    arrays = []
    for name, values in fields.items():
        meta = GiftiMetaData(Name=name)
        if np.issubdtype(values.dtype, np.integer):
            labels = in_32_bits(values, f"field `{name}`")
            array = GiftiDataArray(labels, "NIFTI_INTENT_LABEL", "NIFTI_TYPE_INT32", meta=meta)
        else:
            array = GiftiDataArray(values.astype(np.float32), "NIFTI_INTENT_NONE", "NIFTI_TYPE_FLOAT32", meta=meta)
        arrays.append(array)
    return arrays


def _geometry(arrays: list[_Array], intent: str, path: str | Path) -> _Array:
    """The one (n, 3) array of this intent."""
    found = [array for array in arrays if array.intent == intent]
    if len(found) != 1:
        raise InputError(f"{len(found)} {intent} arrays instead of one", file=path, remedy=_EXPORT_AGAIN)
    shape = found[0].values.shape
    if len(shape) != 2 or shape[1] != 3 or not shape[0]:
        raise InputError(f"{intent} has the shape {shape} instead of (n, 3)", file=path, remedy=_EXPORT_AGAIN)
    return found[0]


def _fields(arrays: list[_Array], path: str | Path, count: int | None = None) -> dict[str, NDArray[Any]]:
    """Arrays that are not geometry, each with one value (or row) for each of `count` vertices."""
    fields = []
    nodes = next((array.values.ravel() for array in arrays if array.intent == _NODES), None)
    for array in arrays:
        if array.intent in _GEOMETRY:
            continue
        count = len(array.values) if count is None else count
        if len(array.values) != count:
            what = f"field `{array.name}` has {len(array.values)} values for {count} vertices"
            raise InputError(what, file=path, remedy="use fields of this very surface")
        values = array.values[:, 0] if array.values.ndim == 2 and array.values.shape[1] == 1 else array.values
        if nodes is not None:
            if not np.array_equal(np.sort(nodes), np.arange(count)):
                what = f"field `{array.name}` lists {len(nodes)} vertices, not all vertices of the surface"
                raise InputError(what, file=path, remedy="export one value for each vertex of the surface")
            values = values[np.argsort(nodes)]
        fields.append(
            (
                array.name,
                in_32_bits(values, f"field `{array.name}`", path) if array.intent == "NIFTI_INTENT_LABEL" else values,
            )
        )
    return safely_named(fields)


def _read(path: Path) -> tuple[list[_Array], str]:
    """All arrays of a file, and its own metadata as text."""
    data = content(path)
    if not data:
        raise InputError("the file is empty", file=path, remedy=_EXPORT_AGAIN)
    try:
        root = ElementTree.fromstring(data)
    except XML_ERRORS as error:
        if other := foreign.name_of(path):
            raise InputError(f"is not GIfTI but {other}", file=path, remedy=_INSTEAD) from error
        what = f"truncated or not GIfTI: {error} (the file has {path.stat().st_size:,} bytes)"
        raise InputError(what, file=path, remedy=_EXPORT_AGAIN) from error
    if root.tag != "GIFTI":
        if other := foreign.name_of(path):
            raise InputError(f"is not GIfTI but {other}", file=path, remedy=_INSTEAD)
        raise InputError(f"not GIfTI: its XML begins with <{root.tag}>", file=path, remedy=_EXPORT_AGAIN)
    return [_array(element, path) for element in root.iter("DataArray")], " ".join(_metadata(root).values())


def _array(element: ElementTree.Element, path: Path) -> _Array:
    """Decode one <DataArray>, after a check that it holds what it declares."""
    get = element.attrib.get
    intent = get("Intent", "NIFTI_INTENT_NONE")
    about = _metadata(element)
    name = about.get("Name") or _stem(path)
    try:
        shape = [int(get(f"Dim{i}", "")) for i in range(min(int(get("Dimensionality", "")), _MAX_DIMENSIONS + 1))]
        dtype = _TYPES[get("DataType", "")].newbyteorder(_ENDIANS[get("Endian", "LittleEndian")])
        if not shape or min(shape) < 0 or len(shape) > _MAX_DIMENSIONS:
            raise ValueError(f"dimensions {shape}")
        flat = _decode(element, math.prod(shape), dtype, path.parent)
        values = flat.reshape(shape, order="F" if get("ArrayIndexingOrder") == "ColumnMajorOrder" else "C")
        systems = _systems(element)
    except KeyError as error:
        raise InputError(f"{intent} array: {error} is not known", file=path, remedy=_EXPORT_AGAIN) from error
    except (ValueError, OverflowError, OSError, zlib.error) as error:
        raise InputError(f"{intent} array: {error}", file=path, remedy=_EXPORT_AGAIN) from error
    return _Array(intent, name, values.astype(dtype.newbyteorder("=")), systems, about)


def _decode(element: ElementTree.Element, count: int, dtype: np.dtype[Any], folder: Path) -> NDArray[Any]:
    """The `count` values of a <DataArray>, in their stored order; ValueError if it holds fewer or more."""
    text, encoding, expected = _text(element, "Data"), element.get("Encoding", ""), count * dtype.itemsize
    if encoding == "ASCII":
        values = numbers(text, dtype)
        if len(values) != count:
            raise ValueError(f"declares {count:,} values, holds {len(values):,}")
        return values
    if encoding == "ExternalFileBinary":
        data = _external(element, folder, expected)
    elif encoding in ("Base64Binary", "GZipBase64Binary"):
        data = base64.b64decode("".join(text.split()), validate=True)
    else:
        raise ValueError(f"encoding `{encoding}` is not known")
    if encoding == "GZipBase64Binary":
        data = zlib.decompress(data, wbits=_ZLIB_OR_GZIP)
    if len(data) != expected:
        raise ValueError(f"declares {expected:,} bytes, holds {len(data):,}")
    return np.frombuffer(data, dtype)


def _external(element: ElementTree.Element, folder: Path, size: int) -> bytes:
    """`size` bytes of the binary file beside the GIfTI file."""
    name = element.get("ExternalFileName", "")
    if Path(name).name != name or not name:
        raise ValueError(f"external file `{name}` is not in the same folder")
    offset = element.get("ExternalFileOffset") or "0"
    if not offset.isdecimal():
        raise ValueError(f"ExternalFileOffset is {offset!r}, not a number of bytes from 0 on")
    check_file(folder / name)
    return (folder / name).read_bytes()[int(offset) :][:size]


def _systems(element: ElementTree.Element) -> list[System]:
    """The coordinate systems of a <DataArray>."""
    return [
        System(
            _text(one, "DataSpace"),
            _text(one, "TransformedSpace"),
            [float(word) for word in _text(one, "MatrixData").split()],
        )
        for one in element.iterfind("CoordinateSystemTransformMatrix")
    ]


def surface_of(image: Any) -> TriSurface:
    """The surface of a NiBabel image (`nibabel.gifti.GiftiImage`), in its frame."""
    points, faces = (image.get_arrays_from_intent(f"NIFTI_INTENT_{name}") for name in ("POINTSET", "TRIANGLE"))
    if not (points and faces):
        raise InputError("the image holds no surface", remedy="give one with a pointset and triangles")
    system, systems = points[0].coordsys, []
    if system is not None:
        dataspace, xformspace = (str(xform_codes.niistring[code]) for code in (system.dataspace, system.xformspace))
        systems = [System(dataspace, xformspace, np.asarray(system.xform, float).ravel().tolist())]
    frame = frames.of_gifti(systems, dict(points[0].meta), str(dict(image.meta)), "the image")
    return TriSurface(points[0].data, faces[0].data, frame=frame)


def _metadata(element: ElementTree.Element) -> dict[str, str]:
    return {_text(one, "Name"): _text(one, "Value") for one in element.iterfind("MetaData/MD")}


def _text(element: ElementTree.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _stem(path: Path) -> str:
    return path.name.split(".")[0]
