"""GIfTI: surfaces and per-vertex fields (https://www.nitrc.org/projects/gifti, format 1.0), by NiBabel.

Coordinates are stored as float32, the only type that every GIfTI tool reads (resolution 4e-6 mm at 60 mm).
`single_precision` rounds a surface to what a file holds: stages that move vertices return such surfaces, so that
nothing downstream depends on whether the surface went through a file.
"""

# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from nibabel.gifti.gifti import GiftiCoordSystem, GiftiDataArray, GiftiImage, GiftiMetaData
from nibabel.gifti.parse_gifti_fast import GiftiImageParser
from nibabel.nifti1 import intent_codes, xform_codes
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats import foreign, frames
from cortet.formats.atomic import atomic_path
from cortet.formats.frames import System
from cortet.formats.hashing import external_names
from cortet.formats.untrusted import (
    by_library,
    check_file,
    content,
    naming,
    require_finite_points,
    safe_name,
    safely_named,
)
from cortet.formats.values import in_32_bits
from cortet.meshes import TriSurface

#: name of the region in the file name of an inner surface
_REGION = re.compile(r"_inner-([A-Za-z0-9]+)_")
#: geometry; the last are vertices to which values belong, in place of all of them in their order
_INTENTS: Any = intent_codes.code
_POINTS, _TRIANGLES, _NODES, _LABELS = (
    int(_INTENTS[f"NIFTI_INTENT_{name}"]) for name in ("POINTSET", "TRIANGLE", "NODE_INDEX", "LABEL")
)
#: the format has six at most
_MOST_DIMENSIONS = 6
#: code of NiBabel for text, and for arrays by column
_ASCII, _BY_COLUMN = 1, 2
#: value of the metadata that names the structure, as CDATA or as it stands; and of that which names the surface
_STRUCTURE = rb"AnatomicalStructurePrimary.{0,99}?<Value>\s*(?:<!\[CDATA\[)?\s*(\w+)"
_SECONDARY = _STRUCTURE.replace(b"Primary", b"Secondary")
_SHAPE = _STRUCTURE.replace(b"AnatomicalStructurePrimary", b"GeometricType")
#: shapes that no brain has, in the words of GIfTI; and what follows a dot in names of such surfaces of FreeSurfer
_DEFORMED = ("inflated", "veryinflated", "spherical", "semispherical", "ellipsoid", "flat", "hull", "sphere", "qsphere")
_INFLATED = re.compile(r"\.(inflated|q?sphere)(\.|$)")


class _Parser(GiftiImageParser):
    """NiBabel's parser, which here keeps every coordinate system of an array, as the file states it."""

    da: Any

    def StartElementHandler(self, name: str, attrs: dict[str, str]) -> None:  # noqa: N802
        if name == "DataArray":
            _require_shape(attrs)
        super().StartElementHandler(name, attrs)
        if name == "DataArray":
            self.da.systems = []
        if name == "CoordinateSystemTransformMatrix":
            self.da.systems.append({"DataSpace": "", "TransformedSpace": "", "MatrixData": ""})

    def CharacterDataHandler(self, data: str) -> None:  # noqa: N802
        if self.write_to in ("DataSpace", "TransformedSpace", "MatrixData"):
            self.da.systems[-1][self.write_to] += data
        else:
            super().CharacterDataHandler(data)


def _require_shape(attributes: dict[str, str]) -> None:
    """Raise ValueError for a shape that no array has: NiBabel counts to its dimension, and turns counts below 0."""
    dimensions = int(attributes.get("Dimensionality", "0"))
    counts = [int(count) for name, count in attributes.items() if name.startswith("Dim") and name[3:].isdigit()]
    if not 0 <= dimensions <= _MOST_DIMENSIONS or min(counts, default=0) < 0:
        raise ValueError(f"an array has {dimensions} dimensions of {counts} numbers")


def read_surface(path: str | Path, *, finite: bool = True) -> TriSurface:
    """Read a triangulated surface; further per-vertex arrays in the file become its `point_data`.

    A surface of FreeSurfer (`lh.white`), STL, PLY, OBJ or OFF is read as well; its first bytes tell what it is.
    A GIfTI may have its arrays in either order, row- or column-major, either endianness, as base64, compressed or in an
    external file, or as text by rows, with triangles of any integer type; or all of that packed by gzip.
    Names of fields that cannot be part of a file name are changed (`untrusted.safe_name`).

    Parameters
    ----------
    finite : false also accepts coordinates that are not finite, for the repair
    """
    if (read := foreign.surface_reader(Path(path))) is not None:
        return read(Path(path), finite=finite)
    image = _read(Path(path))
    points, triangles = (_geometry(image, intent, path) for intent in (_POINTS, _TRIANGLES))
    with by_library("a coordinate system", path):
        systems = [
            System(one["DataSpace"].strip(), one["TransformedSpace"].strip(), [*map(float, one["MatrixData"].split())])
            for one in points.systems
        ]
    frame = frames.of_gifti(systems, dict(points.meta), " ".join(image.meta.values()), path)
    if finite:
        require_finite_points(points.data, path)
    with naming(path):
        return TriSurface(points.data, triangles.data, _fields(image, path, len(points.data)), frame)


def hemisphere_of(path: str | Path) -> Literal["L", "R"] | None:
    """The hemisphere that a GIfTI file names in AnatomicalStructurePrimary; None if it names none."""
    named = re.search(_STRUCTURE, content(path), re.DOTALL)
    known: dict[bytes, Literal["L", "R"]] = {b"CortexLeft": "L", b"CortexRight": "R"}
    return known.get(named[1]) if named else None


def require_same_hemisphere(path: str | Path, hemisphere: str | None) -> None:
    """Raise InputError if a file states another hemisphere than that of the surface it belongs to; None: unknown."""
    if hemisphere and (named := hemisphere_of(path)) not in (None, hemisphere):
        raise InputError(
            f"is hemisphere {named} according to its metadata, not {hemisphere}",
            file=path,
            remedy=f"name the file of hemisphere {hemisphere}",
        )


def require_anatomical(path: str | Path) -> None:
    """Raise InputError for a surface that is inflated, a sphere or flat, by its GeometricType or FreeSurfer's name."""
    found = re.search(_SHAPE, content(path), re.DOTALL)
    named = None if found else _INFLATED.search(Path(path).name)
    _require_brain(found[1].decode() if found else named[1] if named else "", path)


def _require_brain(shape: str, file: str | Path | None) -> None:
    """Raise InputError for a GeometricType, or what it is in FreeSurfer's names, that is not the shape of a brain."""
    if shape.lower() in _DEFORMED:
        what = f"its shape is {shape}, which is not that of a brain"
        remedy = "give the white, midthickness or pial surface; if this is one, set its GeometricType to Anatomical"
        raise InputError(what, file=file, remedy=remedy)


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
    if (found := foreign.values_of(Path(path))) is not None:
        return found.field
    return _fields(_read(Path(path)), path)


def read_label_names(path: str | Path) -> dict[int, str]:
    """Key -> name of the labels in the LabelTable of a file; empty if it has none.

    A label without a name is left out. Raises InputError like `read_surface`, and for two labels of one key.
    """
    if (found := foreign.values_of(Path(path))) is not None:
        return found.names
    labels = _read(Path(path)).labeltable.labels
    if len({label.key for label in labels}) < len(labels):
        raise InputError("two labels of its table have the same key", file=path, remedy="keep one of the two")
    texts = {label.key: getattr(label, "label", "") for label in labels}  # NiBabel sets no empty text
    return {key: safe_name(text) for key, text in texts.items() if text}


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
    image = _read(Path(path))
    return dict(image.meta), next((dict(one.meta) for one in image.darrays if one.intent == _POINTS), {})


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


def _geometry(image: Any, intent: int, path: str | Path) -> Any:
    """The one (n, 3) array of this intent."""
    found = [array for array in image.darrays if array.intent == intent]
    if len(found) != 1 or found[0].data.ndim != 2 or found[0].data.shape[1] != 3 or not len(found[0].data):
        intended = intent_codes.niistring[intent]
        if not found and image.darrays:
            kinds = ", ".join(dict.fromkeys(str(intent_codes.niistring[one.intent]) for one in image.darrays))
            what = f"holds values ({kinds}) without a surface"
            raise InputError(what, file=path, remedy="name the surface to which they belong")
        what = f"needs one {intended} array of shape (n, 3), but has {[one.data.shape for one in found]}"
        raise DamagedFileError(what, file=path)
    return found[0]


def _fields(image: Any, path: str | Path, count: int | None = None) -> dict[str, NDArray[Any]]:
    """Arrays that are not geometry, each with one value (or row) for each of `count` vertices."""
    fields = []
    nodes = next((array.data.ravel() for array in image.darrays if array.intent == _NODES), None)
    for array in image.darrays:
        if array.intent in (_POINTS, _TRIANGLES, _NODES):
            continue
        name, values = array.meta.get("Name") or Path(path).name.split(".")[0], array.data
        count = len(values) if count is None else count
        if len(values) != count or not (nodes is None or np.array_equal(np.sort(nodes), np.arange(count))):
            what = f"field `{name}` has {len(values)} values, but the surface has {count} vertices"
            raise InputError(what, file=path, remedy="export one value for each vertex of this surface")
        values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
        values = values if nodes is None else values[np.argsort(nodes)]
        fields.append((name, in_32_bits(values, f"field `{name}`", path) if array.intent == _LABELS else values))
    return safely_named(fields)


def _read(path: Path) -> Any:
    """All arrays of a file, in the byte order of this machine; InputError for those that NiBabel misreads."""
    data, parser = content(path), _Parser(mmap=False)
    for external in external_names(data):  # NiBabel opens each as it meets it
        if Path(external).name != external:
            what = f"the external file {external} is not in the same folder"
            raise InputError(what, file=path, remedy="move it there, and refer to it without a folder")
        check_file(path.with_name(external))
    file = BytesIO(data)
    file.name = str(path)  # NiBabel looks for external files beside it
    with warnings.catch_warnings(), by_library("GIfTI", path, foreign.name_of):
        warnings.simplefilter("ignore")
        parser.parse(fptr=file)
        if parser.img is None:
            raise ValueError("its XML has no <GIFTI>")
        for array in parser.img.darrays:
            if array.encoding == _ASCII and array.ind_ord == _BY_COLUMN:
                raise ValueError("an array is ASCII in column-major order")
            if array.data is None or array.data.dtype.kind not in "iuf":
                raise ValueError("an array holds no numbers")
            array.data = array.data.astype(array.data.dtype.newbyteorder("="))
    return parser.img


def surface_of(image: Any, *, anatomical: bool = False) -> TriSurface:
    """The surface of a NiBabel image (`nibabel.gifti.GiftiImage`), in its frame; `anatomical`: no inflated one."""
    points, faces = (image.get_arrays_from_intent(f"NIFTI_INTENT_{name}") for name in ("POINTSET", "TRIANGLE"))
    if not (points and faces):
        raise InputError("the image holds no surface", remedy="give an image with a pointset and triangles")
    if anatomical:
        _require_brain(str({**image.meta, **points[0].meta}.get("GeometricType", "")), None)
    system, systems = points[0].coordsys, []
    if system is not None:
        dataspace, xformspace = (str(xform_codes.niistring[code]) for code in (system.dataspace, system.xformspace))
        systems = [System(dataspace, xformspace, np.asarray(system.xform, float).ravel().tolist())]
    frame = frames.of_gifti(systems, dict(points[0].meta), str(dict(image.meta)), "the image")
    return TriSurface(points[0].data, faces[0].data, frame=frame)
