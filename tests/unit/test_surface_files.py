"""GIfTI files: every valid form is read, every invalid one is refused with its reason."""

from __future__ import annotations

import base64
import gzip
import re
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
from shapes import ball_surface

from cortet.cohort.user_files import content, require_unchanged
from cortet.errors import InputError, StageError
from cortet.formats.gifti import (
    hemisphere_of,
    kind_of,
    read_fields,
    read_label_names,
    read_surface,
    write_fields,
    write_surface,
)
from cortet.formats.hashing import input_sha256, sha256
from cortet.meshes import CoordinateFrame, TriSurface, single_precision

POINTS = np.array([[0, 0, 0], [1.5, 0, 0], [0, 2.25, 0], [0, 0, -3]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
MATRIX = "1 0 0 -90 0 1 0 -126 0 0 1 -72 0 0 0 1"


def data_array(
    values: np.ndarray,
    intent: str,
    encoding: str = "GZipBase64Binary",
    order: str = "C",
    endian: str = "<",
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
    frame = (
        "<CoordinateSystemTransformMatrix><DataSpace>NIFTI_XFORM_SCANNER_ANAT</DataSpace><TransformedSpace>"
        f"NIFTI_XFORM_TALAIRACH</TransformedSpace><MatrixData>{MATRIX}</MatrixData></CoordinateSystemTransformMatrix>"
        if intent == "POINTSET"
        else ""
    )
    written = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    return f"<DataArray {written}>{frame}<Data>{text}</Data></DataArray>"


def points(values: np.ndarray = POINTS, **how: str) -> str:
    return data_array(values, "POINTSET", **how)


def triangles(values: np.ndarray = FACES, **how: str) -> str:
    return data_array(values, "TRIANGLE", **how)


@pytest.fixture
def file(tmp_path: Path):
    """Writes a GIfTI file of the given arrays."""

    def write(*arrays: str) -> Path:
        path = tmp_path / "x.surf.gii"
        path.write_text(f'<?xml version="1.0"?>\n<GIFTI Version="1.0">{"".join(arrays)}</GIFTI>')
        return path

    return write


@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("endian", ["<", ">"])
@pytest.mark.parametrize("index", [np.int32, np.uint32, np.int64])
def test_every_valid_form_is_read(file, encoding, order, endian, index) -> None:
    how = {"encoding": encoding, "order": order, "endian": endian}
    for arrays in ([points(**how), triangles(FACES.astype(index), **how)], [triangles(**how), points(**how)]):
        surface = read_surface(file(*arrays))
        assert np.array_equal(surface.points, POINTS)
        assert np.array_equal(surface.faces, FACES)
        assert surface.frame.dataspace == "NIFTI_XFORM_SCANNER_ANAT"
        assert surface.frame.xformspace == "NIFTI_XFORM_TALAIRACH"
        assert surface.frame.matrix == tuple(map(float, MATRIX.split()))


@pytest.mark.parametrize(("name", "order"), [("GIFTI_ENDIAN_BIG", ">"), ("GIFTI_ENDIAN_LITTLE", "<")])
def test_names_of_endianness_that_nibabel_wrote_are_known(file, name: str, order: str) -> None:
    how = {"encoding": "Base64Binary", "endian": order, "Endian": name}
    assert np.array_equal(read_surface(file(points(**how), triangles(**how))).points, POINTS)
    with pytest.raises(InputError, match="POINTSET array: 'BIG' is not known"):
        read_surface(file(points(Endian="BIG"), triangles()))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("sub-01_hemi-L_wm.surf.gii", "white"),
        ("sub-01_hemi-L_desc-x_smoothwm.surf.gii", "white"),
        ("100307.L.white.native.surf.gii", "white"),
        ("lh.white", "white"),
        ("lh.pial.T1", "pial"),
        ("whitehead_surface.gii", None),
        ("sub-wm01.surf.gii", None),
    ],
)
def test_which_surface_a_file_holds(file, tmp_path: Path, name: str, kind: str | None) -> None:
    assert kind_of(file(points(), triangles()).rename(tmp_path / name)) == kind
    stated = points().replace(
        "<DataArray",
        "<MetaData><MD><Name><![CDATA[AnatomicalStructureSecondary]]></Name><Value>"
        "<![CDATA[Pial]]></Value></MD></MetaData><DataArray",
    )
    assert kind_of(file(stated, triangles()).rename(tmp_path / name)) == "pial"


def test_a_file_that_is_packed_as_a_whole_is_read(file, tmp_path: Path) -> None:
    named = points().replace(
        "<DataArray",
        "<MetaData><MD><Name>AnatomicalStructurePrimary</Name><Value>CortexLeft</Value></MD></MetaData><DataArray",
    )
    packed = tmp_path / "x.surf.gii.gz"
    packed.write_bytes(gzip.compress(file(named, triangles()).read_bytes()))
    assert np.array_equal(read_surface(packed).points, POINTS)
    assert hemisphere_of(packed) == "L"
    whole = gzip.decompress(packed.read_bytes())
    packed.write_bytes(gzip.compress(whole[:99]) + gzip.compress(whole[99:]))  # as of bgzip
    assert np.array_equal(read_surface(packed).points, POINTS)
    packed.write_bytes(packed.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"x\.surf\.gii\.gz: cannot be unpacked: Compressed file ended before"):
        read_surface(packed)


def test_a_file_beside_the_gifti_is_an_input_like_it(file, tmp_path: Path) -> None:
    """The hash of an input, by which a case runs again, is that of both files."""
    (tmp_path / "x.dat").write_bytes(POINTS.tobytes())
    path = file(points(encoding="ExternalFileBinary", ExternalFileName="x.dat"), triangles())
    before, planned = input_sha256(path), content({"surface": path})
    assert before == planned["surface"] != sha256(path)
    (tmp_path / "x.dat").write_bytes((POINTS + 1).astype(np.float32).tobytes())
    assert input_sha256(path) != before
    assert content({"surface": path}) == {"surface": input_sha256(path)}
    with pytest.raises(StageError, match="has changed since this run was planned"):
        require_unchanged({"surface": path}, planned)
    plain = file(points(), triangles())
    assert input_sha256(plain) == sha256(plain)


def test_data_in_an_external_file_is_read(file, tmp_path: Path) -> None:
    (tmp_path / "x.data").write_bytes(b"head" + POINTS.tobytes())
    where = {"ExternalFileName": "x.data", "ExternalFileOffset": "4"}
    path = file(points(encoding="ExternalFileBinary", **where), triangles())
    assert np.array_equal(read_surface(path).points, POINTS)
    (tmp_path / "x.data").write_bytes(POINTS.tobytes())
    with pytest.raises(InputError, match="declares 48 bytes, holds 44"):
        read_surface(path)
    for offset in ("-1", "4.5", "x"):
        wrong = file(
            points(encoding="ExternalFileBinary", ExternalFileName="x.data", ExternalFileOffset=offset), triangles()
        )
        with pytest.raises(InputError, match=rf"ExternalFileOffset is '{offset}', not a number of bytes from 0 on"):
            read_surface(wrong)
    with pytest.raises(InputError, match="not beside"):
        read_surface(file(points(encoding="ExternalFileBinary", ExternalFileName="../x.data"), triangles()))


def test_a_transform_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.surf.gii"
    write_surface(replace(ball_surface(1), frame=CoordinateFrame(matrix=tuple(np.arange(16.0)))), path)
    path.write_text(re.sub(r"\b15(\.0*)?\b", "1e999", path.read_text()))
    with pytest.raises(InputError, match="not finite"):
        read_surface(path)


def test_what_is_written_is_read_back_and_is_what_nibabel_reads(tmp_path: Path) -> None:
    ball = ball_surface(2)
    matrix = (*np.add(np.eye(4), 0.1).ravel()[:12].tolist(), 0, 0, 0, 1)
    frame = CoordinateFrame("NIFTI_XFORM_ALIGNED_ANAT", "NIFTI_XFORM_MNI_152", matrix)
    fields = {"thickness": np.linspace(1, 2, len(ball.points)), "region": np.arange(len(ball.points)) % 3}
    surface = single_precision(replace(ball, point_data=fields, frame=frame))
    path = tmp_path / "new" / "x.surf.gii"
    write_surface(surface, path)
    again = read_surface(path)
    assert np.array_equal(again.points, surface.points)
    assert np.array_equal(again.faces, surface.faces)
    assert again.frame == frame
    assert again.point_data["region"].dtype == np.int32
    assert np.array_equal(again.point_data["region"], fields["region"])
    assert np.allclose(again.point_data["thickness"], fields["thickness"], atol=1e-6)

    image = nibabel.load(path)
    assert np.array_equal(image.agg_data("pointset"), surface.points)
    assert np.array_equal(image.agg_data("triangle"), surface.faces)
    assert image.darrays[0].coordsys.dataspace == 2

    written = path.read_bytes()
    write_surface(again, path)
    assert path.read_bytes() == written


@pytest.mark.parametrize(
    ("linear", "spaces", "words"),
    [
        (np.eye(3), (0, 1), None),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0, 1), None),
        (np.diag([0.9, 1.05, 1.1]), (1, 3), None),  # a native brain, and the way to a template
        (0.5 * np.eye(3), (0, 1), r"not a rigid motion: lengths change by 0.5 to 0.5 \(apply the matrix"),
        (np.diag([0.5, 0.5, 0.8]), (0, 3), "lengths change by 0.5 to 0.8"),
        (np.diag([-1, 1, 1]), (0, 1), "lengths change by 1 to 1, mirrored"),
        ([[1, 0.3, 0], [0, 1, 0], [0, 0, 1]], (1, 2), "not a rigid motion"),
        (np.zeros((3, 3)), (0, 1), "lengths change by 0 to 0"),
    ],
)
def test_a_matrix_that_says_that_coordinates_are_not_mm_is_refused(tmp_path: Path, linear, spaces, words) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, [1, 2, 3]
    names = [nibabel.nifti1.xform_codes.niistring[space] for space in spaces]
    frame = CoordinateFrame(*names, tuple(matrix.ravel().tolist()))
    ball = single_precision(replace(ball_surface(2), frame=frame))
    write_surface(ball, tmp_path / "x.surf.gii")
    if words is None:
        again = read_surface(tmp_path / "x.surf.gii")
        assert np.array_equal(again.points, ball.points) and again.frame == frame
        return
    with pytest.raises(InputError, match=words):
        read_surface(tmp_path / "x.surf.gii")


def test_fields_take_their_names_from_metadata_or_the_file(tmp_path: Path) -> None:
    values = np.array([0.5, 1.5, 2.5], np.float32)
    named = nibabel.gifti.GiftiDataArray(values, "NIFTI_INTENT_SHAPE", meta=nibabel.gifti.GiftiMetaData(Name="sulc"))
    labels = nibabel.gifti.GiftiDataArray(np.array([3, 0, 7], np.int32), "NIFTI_INTENT_LABEL")
    path = tmp_path / "regions.label.gii"
    nibabel.save(nibabel.GiftiImage(darrays=[named, labels]), path)
    fields = read_fields(path)
    assert list(fields) == ["sulc", "regions"]
    assert np.array_equal(fields["sulc"], values)
    assert np.array_equal(fields["regions"], [3, 0, 7])
    assert fields["regions"].dtype == np.int32


@pytest.mark.parametrize("kind", [np.uint32, np.int64])
def test_labels_of_more_than_32_bits_are_refused_and_never_wrapped(file, tmp_path: Path, kind: type) -> None:
    values = np.array([1, 2**31 + 5, 3], kind)
    with pytest.raises(InputError, match="has the label 2147483653, and labels have at most 32 bits"):
        read_fields(file(data_array(values, "LABEL")))
    with pytest.raises(InputError, match="has the label 2147483653"):
        write_fields({"label": values}, tmp_path / "again.label.gii")


def test_values_are_those_of_the_vertices_that_a_file_lists(tmp_path: Path) -> None:
    """AFNI writes values in an order of its own, with an array of the vertices that they belong to."""
    path = tmp_path / "afni.func.gii"

    def saved(nodes: list[int], intent: str = "NIFTI_INTENT_NODE_INDEX") -> Path:
        index = nibabel.gifti.GiftiDataArray(np.array(nodes, np.int32), intent)
        nibabel.save(nibabel.GiftiImage(darrays=[index, _array("thickness", [2.5, 0.5, 1.5])]), path)
        return path

    fields = read_fields(saved([2, 0, 1]))
    assert list(fields) == ["thickness"]
    assert fields["thickness"].tolist() == [0.5, 1.5, 2.5]
    for nodes in ([2, 0, 4], [2, 0, 0], [-1, 0, 1], [0, 1]):
        with pytest.raises(InputError, match="its values are not of all vertices"):
            read_fields(saved(nodes))


def _array(name: str, values: list[float], intent: str = "NIFTI_INTENT_NONE") -> nibabel.gifti.GiftiDataArray:
    meta = nibabel.gifti.GiftiMetaData(Name=name)
    return nibabel.gifti.GiftiDataArray(np.array(values, np.float32), intent, meta=meta)


@pytest.mark.parametrize("value", [2.5, np.nan])
def test_labels_that_are_no_whole_numbers_are_refused(tmp_path: Path, value: float) -> None:
    path = tmp_path / "smoothed.label.gii"
    nibabel.save(nibabel.GiftiImage(darrays=[_array("parcel", [1, value, 0], "NIFTI_INTENT_LABEL")]), path)
    with pytest.raises(InputError, match=f"field `parcel` has the label {value}, which is not a whole number"):
        read_fields(path)


def test_label_tables_of_earlier_tools_are_read_and_labels_without_a_name_have_none(tmp_path: Path) -> None:
    labels = '<Label Index="1">insula</Label><Label Key="-2"><![CDATA[]]></Label>'
    path = tmp_path / "caret.label.gii"
    path.write_text(f"<GIFTI><LabelTable>{labels}</LabelTable></GIFTI>")
    assert read_label_names(path) == {1: "insula"}
    path.write_text(path.read_text().replace("-2", "1"))
    with pytest.raises(InputError, match="two labels of its table have the key 1"):
        read_label_names(path)
    path.write_text("<GIFTI><LabelTable><Label>insula</Label></LabelTable></GIFTI>")
    with pytest.raises(InputError, match="its label table cannot be read: the label 'insula' has no key"):
        read_label_names(path)


def test_a_field_of_another_surface_is_refused(file) -> None:
    with pytest.raises(InputError, match="3 values for 4 vertices"):
        read_surface(file(points(), triangles(), data_array(np.zeros(3, np.float32), "SHAPE")))


def bad_points(value: float) -> np.ndarray:
    values = POINTS.copy()
    values[2, 1] = value
    return values


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ([], "0 NIFTI_INTENT_POINTSET"),
        ([points()], "0 NIFTI_INTENT_TRIANGLE"),
        ([points(), points(), triangles()], "2 NIFTI_INTENT_POINTSET"),
        ([points(np.zeros((0, 3), np.float32)), triangles()], r"shape \(0, 3\)"),
        ([points(POINTS[:, :2]), triangles()], r"shape \(4, 2\)"),
        ([points(bad_points(np.nan)), triangles()], "vertex 2: .*nan"),
        ([points(bad_points(np.inf)), triangles()], "vertex 2: .*inf"),
        ([points(), triangles(FACES + 1)], r"triangle 1 is \[1, 2, 4\], but vertices run from 0 to 3"),
        ([points(), triangles(FACES - 1)], r"triangle 0 is \[-1, 1, 0\]"),
        ([points(), triangles((FACES.astype(np.int64) + 2**32 - 4).astype(np.uint32))], "4294967292"),
        ([points(), triangles(FACES.astype(np.float32))], "float32, not integer"),
        ([points(Dim0="3"), triangles()], "declares 36 bytes, holds 48"),
        ([points(Dim0="5"), triangles()], "declares 60 bytes, holds 48"),
        ([points(encoding="ASCII", Dim0="5"), triangles()], "declares 15 values, holds 12"),
        ([points(Dim0="99999999999999"), triangles()], "declares 1,199,999,999,999,988 bytes, holds 48"),
        ([points(Dim0="99999999"), triangles()], "declares 1,199,999,988 bytes, holds 48"),
        ([points(Dim0="-4"), triangles()], r"dimensions \[-4, 3\]"),
        ([points(Dim1="many"), triangles()], "'many'"),
        ([points(DataType="NIFTI_TYPE_RGB24"), triangles()], "'NIFTI_TYPE_RGB24' is not known"),
        ([points(Encoding="Base32"), triangles()], "encoding `Base32` is not known"),
        ([points(Encoding="GZipBase64Binary", encoding="Base64Binary"), triangles()], "while decompressing"),
    ],
)
def test_contents_that_make_no_surface_are_refused(file, arrays: list[str], words: str) -> None:
    path = file(*arrays)
    with pytest.raises(InputError, match=words) as caught:
        read_surface(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy


def test_compressed_data_of_another_size_are_refused(file) -> None:
    more = base64.b64encode(zlib.compress(bytes(60))).decode()
    path = file(points().replace(points().split("<Data>")[1].split("<")[0], more), triangles())
    with pytest.raises(InputError, match="declares 48 bytes, holds 60"):
        read_surface(path)


def test_empty_truncated_missing_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.surf.gii"
    with pytest.raises(InputError, match="No such file"):
        read_surface(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="is empty"):
        read_surface(path)
    write_surface(ball_surface(2), path)
    whole = path.read_bytes()
    for size in (10, 100, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="truncated or not GIfTI"):
            read_surface(path)
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    with pytest.raises(InputError, match="PLY surface"):
        read_surface(path)
    path.write_text("<VTKFile></VTKFile>")
    with pytest.raises(InputError, match="not GIfTI: its XML begins with <VTKFile>"):
        read_surface(path)


def test_real_surfaces_agree_with_nibabel() -> None:
    data = Path(__file__).parents[2] / "../shared/data"
    files = sorted(data.glob("*/*.surf.gii"))
    if not files:
        pytest.skip("no real surfaces in ../shared/data")
    for path in files:
        surface, image = read_surface(path), nibabel.load(path)
        assert np.array_equal(surface.points, image.agg_data("pointset"))
        assert np.array_equal(surface.faces, image.agg_data("triangle"))


def test_single_precision_changes_nothing_twice() -> None:
    rounded = single_precision(TriSurface([[1 / 3, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]]))
    assert rounded.points[0, 0] == np.float32(1 / 3)
    assert np.array_equal(single_precision(rounded).points, rounded.points)


@pytest.mark.parametrize(
    ("structure", "hemisphere"), [("CortexLeft", "L"), ("CortexRight", "R"), ("Cerebellum", None), (None, None)]
)
def test_a_file_may_name_its_hemisphere(tmp_path: Path, structure: str | None, hemisphere: str | None) -> None:
    path = tmp_path / "x.surf.gii"
    write_surface(ball_surface(2), path)
    image = nibabel.load(path)
    if structure:
        image.darrays[0].meta = nibabel.gifti.GiftiMetaData(AnatomicalStructurePrimary=structure)
    nibabel.save(image, path)
    assert hemisphere_of(path) == hemisphere


def test_reading_a_surface_loads_no_numba_and_no_part_of_scipy(tmp_path: Path) -> None:
    """Each job of the workflow reads one; most do nothing else that takes time."""
    write_surface(ball_surface(1), tmp_path / "x.surf.gii")
    code = (
        f"import sys; from cortet.formats.gifti import read_surface; read_surface({str(tmp_path / 'x.surf.gii')!r})\n"
    )
    code += "print([name for name in ('numba', 'scipy.sparse', 'scipy.spatial', 'pandas') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
