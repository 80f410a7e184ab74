"""Files of surfaces and of their values: every valid form is read, and what is damaged or something else is refused."""

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
import nibabel.freesurfer.io as freesurfer
import numpy as np
import pytest
import trimesh
from shapes import ball_surface

from cortet.cohort import user_files
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
from cortet.geometry.topology import enclosed_volume, surface_topology
from cortet.meshes import CoordinateFrame, TriSurface, single_precision
from cortet.solver_files.fields import with_fields

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


def gifti(*arrays: str) -> bytes:
    return f'<?xml version="1.0"?>\n<GIFTI Version="1.0">{"".join(arrays)}</GIFTI>'.encode()


def with_metadata(array: str, **known: str) -> str:
    told = "".join(f"<MD><Name>{key}</Name><Value><![CDATA[{value}]]></Value></MD>" for key, value in known.items())
    return array.replace("<DataArray", f"<MetaData>{told}</MetaData><DataArray")


def saved(folder: Path, name: str, content: bytes) -> Path:
    (folder / name).write_bytes(content)
    return folder / name


# --- GIfTI that is read


@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(("endian", "name"), [("<", "GIFTI_ENDIAN_LITTLE"), (">", "GIFTI_ENDIAN_BIG"), (">", "")])
@pytest.mark.parametrize("index", [np.int32, np.uint32, np.int64])
def test_every_valid_form_is_read(
    tmp_path: Path, encoding: str, order: str, endian: str, name: str, index: type
) -> None:
    """Those names of endianness NiBabel wrote once."""
    how = {"encoding": encoding, "order": order, "endian": endian} | ({"Endian": name} if name else {})
    for arrays in ([points(**how), triangles(FACES.astype(index), **how)], [triangles(**how), points(**how)]):
        surface = read_surface(saved(tmp_path, "x.surf.gii", gifti(*arrays)))
        assert np.array_equal(surface.points, POINTS) and np.array_equal(surface.faces, FACES)
        frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH", tuple(map(float, MATRIX.split())))
        assert surface.frame == frame


def test_what_is_written_is_read_back_and_is_what_nibabel_reads(tmp_path: Path) -> None:
    matrix = (*np.add(np.eye(4), 0.1).ravel()[:12].tolist(), 0, 0, 0, 1)
    frame = CoordinateFrame("NIFTI_XFORM_ALIGNED_ANAT", "NIFTI_XFORM_MNI_152", matrix)
    fields = {"thickness": np.linspace(1, 2, len(BALL.points)), "region": np.arange(len(BALL.points)) % 3}
    surface = single_precision(replace(BALL, point_data=fields, frame=frame))
    path = tmp_path / "new" / "x.surf.gii"
    write_surface(surface, path)
    again, image = read_surface(path), nibabel.load(path)
    assert np.array_equal(again.points, surface.points) and np.array_equal(again.faces, surface.faces)
    assert again.frame == frame
    assert again.point_data["region"].dtype == np.int32
    assert np.array_equal(again.point_data["region"], fields["region"])
    assert np.allclose(again.point_data["thickness"], fields["thickness"], atol=1e-6)
    assert np.array_equal(image.agg_data("pointset"), surface.points)
    assert np.array_equal(image.agg_data("triangle"), surface.faces)
    assert image.darrays[0].coordsys.dataspace == 2
    written = path.read_bytes()
    write_surface(again, path)
    assert path.read_bytes() == written


def test_real_surfaces_agree_with_nibabel() -> None:
    files = sorted((Path(__file__).parents[2] / "../shared/data").glob("*/*.surf.gii"))
    if not files:
        pytest.skip("no real surfaces in ../shared/data")
    for path in files:
        surface, image = read_surface(path), nibabel.load(path)
        assert np.array_equal(surface.points, image.agg_data("pointset"))
        assert np.array_equal(surface.faces, image.agg_data("triangle"))


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
def test_which_surface_a_file_holds_is_told_by_itself_or_by_its_name(
    tmp_path: Path, name: str, kind: str | None
) -> None:
    assert kind_of(saved(tmp_path, name, gifti(points(), triangles()))) == kind
    stated = with_metadata(points(), AnatomicalStructureSecondary="Pial")
    assert kind_of(saved(tmp_path, name, gifti(stated, triangles()))) == "pial"


@pytest.mark.parametrize(("structure", "hemisphere"), [("CortexLeft", "L"), ("CortexRight", "R"), ("Cerebellum", None)])
def test_a_file_may_name_its_hemisphere(tmp_path: Path, structure: str, hemisphere: str | None) -> None:
    named = with_metadata(points(), AnatomicalStructurePrimary=structure)
    assert hemisphere_of(saved(tmp_path, "x.surf.gii", gifti(named, triangles()))) == hemisphere
    assert hemisphere_of(saved(tmp_path, "y.surf.gii", gifti(points(), triangles()))) is None


def test_a_file_that_is_packed_as_a_whole_is_read(tmp_path: Path) -> None:
    whole = gifti(with_metadata(points(), AnatomicalStructurePrimary="CortexLeft"), triangles())
    of_bgzip = gzip.compress(whole[:99]) + gzip.compress(whole[99:])
    for packed in (gzip.compress(whole), of_bgzip):
        path = saved(tmp_path, "x.surf.gii.gz", packed)
        assert np.array_equal(read_surface(path).points, POINTS) and hemisphere_of(path) == "L"
    with pytest.raises(InputError, match="x.surf.gii.gz"):
        read_surface(saved(tmp_path, "x.surf.gii.gz", of_bgzip[:-20]))


def test_data_in_an_external_file_are_part_of_the_input(tmp_path: Path) -> None:
    """Also of its hash, by which a case runs again."""
    saved(tmp_path, "x.dat", b"head" + POINTS.tobytes())
    how = {"encoding": "ExternalFileBinary", "ExternalFileName": "x.dat", "ExternalFileOffset": "4"}
    path = saved(tmp_path, "x.surf.gii", gifti(points(**how), triangles()))
    assert np.array_equal(read_surface(path).points, POINTS)
    before, planned = input_sha256(path), user_files.content({"surface": path})
    assert before == planned["surface"] != sha256(path)
    saved(tmp_path, "x.dat", b"head" + (POINTS + 1).astype(np.float32).tobytes())
    assert input_sha256(path) != before and user_files.content({"surface": path}) == {"surface": input_sha256(path)}
    with pytest.raises(StageError, match="changed"):
        user_files.require_unchanged({"surface": path}, planned)
    for wrong in ({"ExternalFileOffset": "8"}, {"ExternalFileName": "../x.dat"}):
        with pytest.raises(InputError, match="x.surf.gii"):
            read_surface(saved(tmp_path, "x.surf.gii", gifti(points(**how | wrong), triangles())))
    for offset in ("-1", "4.5", "x"):
        with pytest.raises(InputError, match="ExternalFileOffset"):
            read_surface(
                saved(tmp_path, "x.surf.gii", gifti(points(**how | {"ExternalFileOffset": offset}), triangles()))
            )


@pytest.mark.parametrize(
    ("linear", "spaces", "rigid"),
    [
        (np.eye(3), (0, 1), True),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0, 1), True),
        (np.diag([0.9, 1.05, 1.1]), (1, 3), True),  # a native brain, and the way to a template
        (0.5 * np.eye(3), (0, 1), False),
        (np.diag([0.5, 0.5, 0.8]), (0, 3), False),
        (np.diag([-1, 1, 1]), (0, 1), False),
        ([[1, 0.3, 0], [0, 1, 0], [0, 0, 1]], (1, 2), False),
        (np.zeros((3, 3)), (0, 1), False),
    ],
)
def test_a_matrix_that_says_that_coordinates_are_not_mm_is_refused(
    tmp_path: Path, linear: np.ndarray, spaces: tuple[int, int], rigid: bool
) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, [1, 2, 3]
    names = [nibabel.nifti1.xform_codes.niistring[space] for space in spaces]
    frame = CoordinateFrame(*names, tuple(matrix.ravel().tolist()))
    ball = single_precision(replace(BALL, frame=frame))
    write_surface(ball, path := tmp_path / "x.surf.gii")
    if rigid:
        assert np.array_equal(read_surface(path).points, ball.points) and read_surface(path).frame == frame
    else:
        with pytest.raises(InputError, match="x.surf.gii.*lengths"):
            read_surface(path)


def test_single_precision_changes_nothing_twice() -> None:
    rounded = single_precision(TriSurface([[1 / 3, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]]))
    assert rounded.points[0, 0] == np.float32(1 / 3)
    assert np.array_equal(single_precision(rounded).points, rounded.points)


def test_reading_a_surface_loads_no_numba_and_no_part_of_scipy(tmp_path: Path) -> None:
    """Each job of the workflow reads one; most do nothing else that takes time."""
    path = saved(tmp_path, "x.surf.gii", gifti(points(), triangles()))
    code = f"import sys; from cortet.formats.gifti import read_surface; read_surface({str(path)!r})\n"
    code += "print([name for name in ('numba', 'scipy.sparse', 'scipy.spatial', 'pandas') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- surfaces of other programs


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", FOREIGN)
def test_a_surface_of_another_program_is_closed_and_of_its_size(tmp_path: Path, name: str, packed: bool) -> None:
    content = gzip.compress(FOREIGN[name]) if packed else FOREIGN[name]
    surface = read_surface(saved(tmp_path, f"{name}.gz" if packed else name, content))
    assert (len(surface.points), len(surface.faces)) == (len(BALL.points), len(BALL.faces))
    assert surface_topology(surface.faces).problems() == []
    expected = enclosed_volume(BALL.points, BALL.faces)
    assert enclosed_volume(surface.points, surface.faces) == pytest.approx(expected, rel=1e-5)


def test_an_obj_file_may_say_more_and_is_one_closed_surface(tmp_path: Path) -> None:
    """trimesh 5.2 makes vertices of their own for each material, so that nothing closes."""
    text = b"# colours\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nvn 0 0 1\nf 1/2/1 2//1 3\n"
    surface = read_surface(saved(tmp_path, "q.obj", text))
    assert surface.faces.tolist() == [[0, 1, 2]] and surface.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\ng a\nusemtl x\nf 1/1 3/2 2/3\nf 1/3 2/1 4/2\n"
    surface = read_surface(saved(tmp_path, "m.obj", text + b"g b\nusemtl y\nf 1/2 4/3 3/1\nf 2/2 3/1 4/3\n"))
    assert len(surface.points) == 4 and surface_topology(surface.faces).problems() == []


def test_a_ply_file_of_either_order_and_with_other_properties(tmp_path: Path) -> None:
    head = "ply\nformat binary_{}_endian 1.0\ncomment x\nelement vertex 3\nproperty double x\nproperty double y\n"
    head += "property double z\nproperty uchar red\nelement face 1\n"
    head += "property list uchar uint vertex_index\nend_header\n"
    for name, order in (("little", "<"), ("big", ">")):
        vertices = np.zeros(3, [("p", f"{order}f8", 3), ("red", "u1")])
        vertices["p"] = np.eye(3)
        face = np.array([(3, [0, 1, 2])], [("n", "u1"), ("v", f"{order}u4", 3)])
        surface = read_surface(saved(tmp_path, name, head.format(name).encode() + vertices.tobytes() + face.tobytes()))
        assert np.array_equal(surface.points, np.eye(3)) and surface.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("magic", [b"\xff\xff\xff", b"\xff\xff\xfd"])
def test_a_surface_of_quadrangles_is_read(tmp_path: Path, magic: bytes) -> None:
    """A cube of 20 mm; the first of the two magic numbers is also that of files of values."""
    corners = 20.0 * np.indices((2, 2, 2)).reshape(3, -1).T
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    stored = (100 * corners).astype(">i2") if magic == b"\xff\xff\xff" else corners.astype(">f4")
    indices = b"".join(int(corner).to_bytes(3, "big") for face in faces for corner in face)
    content = magic + (8).to_bytes(3, "big") + (6).to_bytes(3, "big") + stored.tobytes() + indices
    surface = read_surface(saved(tmp_path, "lh.orig", content))
    assert surface_topology(surface.faces).problems() == []
    assert enclosed_volume(surface.points, surface.faces) == pytest.approx(8000)
    with pytest.raises(InputError, match="lh.cut"):
        read_surface(saved(tmp_path, "lh.cut", content[:-5]))
    with pytest.raises(InputError, match="FreeSurfer"):
        read_fields(tmp_path / "lh.orig")


# --- surfaces that are refused


def changed(value: float) -> np.ndarray:
    values = POINTS.copy()
    values[2, 1] = value
    return values


def of_freesurfer(folder: Path) -> bytes:
    freesurfer.write_geometry(str(folder / "lh.white"), BALL.points, BALL.faces)
    return (folder / "lh.white").read_bytes()


LONGER = base64.b64encode(zlib.compress(bytes(60))).decode()
PLY = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
NIFTI = nibabel.Nifti1Image(np.zeros((2, 2, 2), np.uint8), np.eye(4)).to_bytes()
#: contents of a file that is no surface, and a word of why
REFUSED: list[tuple[bytes, str]] = [
    (gifti(), "POINTSET"),
    (gifti(points()), "TRIANGLE"),
    (gifti(points(), points(), triangles()), "POINTSET"),
    (gifti(points(np.zeros((0, 3), np.float32)), triangles()), "shape"),
    (gifti(points(POINTS[:, :2]), triangles()), "shape"),
    (gifti(points(changed(np.nan)), triangles()), "vertex 2"),
    (gifti(points(changed(np.inf)), triangles()), "vertex 2"),
    (gifti(points().replace("-90", "1e999"), triangles()), "finite"),
    (gifti(points(), triangles(FACES + 1)), "triangle 1"),
    (gifti(points(), triangles(FACES - 1)), "triangle 0"),
    (gifti(points(), triangles((FACES.astype(np.int64) + 2**32 - 4).astype(np.uint32))), "4294967292"),
    (gifti(points(), triangles(FACES.astype(np.float32))), "float32"),
    (gifti(points(), triangles(), data_array(np.zeros(3, np.float32), "SHAPE")), "3 values for 4"),
    (gifti(points(Dim0="3"), triangles()), "36 bytes"),
    (gifti(points(Dim0="5"), triangles()), "60 bytes"),
    (gifti(points(encoding="ASCII", Dim0="5"), triangles()), "15 values"),
    (gifti(points(Dim0="99999999999999"), triangles()), "bytes"),
    (gifti(points().replace(points().split("<Data>")[1].split("<")[0], LONGER), triangles()), "holds 60"),
    (gifti(points(Dim0="-4"), triangles()), "-4"),
    (gifti(points(Dim1="many"), triangles()), "many"),
    (gifti(points(DataType="NIFTI_TYPE_RGB24"), triangles()), "RGB24"),
    (gifti(points(Encoding="Base32"), triangles()), "Base32"),
    (gifti(points(Endian="BIG"), triangles()), "BIG"),
    (gifti(points(Encoding="GZipBase64Binary", encoding="Base64Binary"), triangles()), "decompressing"),
    *((gifti(points(), triangles())[:size], "truncated") for size in (10, 100, -5)),
    (PLY.replace(b"3 0 1 2", b"4 0 1 2 0"), "triangles"),
    (PLY.replace(b"3 0 1 2", b"3 0 1 3"), "0 to 2"),
    (PLY.replace(b"1 0 0", b"1 nan 0"), "finite"),
    (PLY.replace(b"vertex 3", b"vertex 300000000000"), "x.surf.gii"),
    (PLY.replace(b"ascii", b"binary_little_endian"), "x.surf.gii"),
    (PLY.replace(b"float x", b"float u"), "x.surf.gii"),
    (PLY.replace(b"vertex 3", b"vertex"), "PLY"),
    (PLY[:80], "PLY"),
    *((FOREIGN[name][:3000], "x.surf.gii") for name in ("binary.ply", "text.ply", "text.stl")),
    (OBJ + b"f -3 -2 -1\n", "0 to 2"),
    (OBJ + b"f 1 2 4\n", "0 to 2"),
    (OBJ + b"v 1 1 0\nf 1 2 4 3\n", "triangles"),
    (OBJ.replace(b"1 0 0", b"1 0 x") + b"f 1 2 1\n", "OBJ"),
    (OBJ, "no triangles"),
    (OFF.replace(b"3 1 0", b"3 2 0"), "OFF"),
    (OFF + b"3 0 2 1\n", "lines"),
    (OFF[:4], "OFF"),
    *((OFF.replace(b"OFF", head), "OFF") for head in (b"4OFF", b"COFF", b"OFF BINARY")),
    (OFF.replace(b"3 0 1 2", b"4 0 1 2"), "OFF"),
    (OFF.replace(b"3 0 1 2", b"3 0 1 3"), "0 to 2"),
    (OFF.replace(b"1 0 0\n", b"1 0 x\n"), "OFF"),
    (b"\xff\xff\xff\x00\x00\x00\x01\x00\x00\x00\x00\x00\x00\x00\x01" + bytes(4), "values of FreeSurfer"),
]
#: contents that are neither a surface nor values, and what they are
NEITHER: list[tuple[bytes, str]] = [
    (b"", "empty"),
    (b"what is this", "GIfTI"),
    (b"<Other></Other>", "<Other>"),
    (gzip.compress(b"what is this", mtime=0), "GIfTI"),
    (b"\x1f\x8b\x08\x00" + bytes(20), "unpacked"),
    (NIFTI, "NIfTI"),
    (gzip.compress(NIFTI, mtime=0), "NIfTI"),
    (b'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0">', "PolyData"),
    (b"<VTKFile type='UnstructuredGrid'></VTKFile>", "UnstructuredGrid"),
    (b"# vtk DataFile Version 3.0\n", "VTK"),
    (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "LFS"),
    (b"<!DOCTYPE html><html><body>404</body>", "web page"),
    (b"P 0.3 0.3 0.4 10 1 4\n 0 0 0\n 1 0 0\n", "MNI"),
]


@pytest.mark.parametrize(("content", "word"), [*REFUSED, *NEITHER])
def test_what_is_no_surface_is_refused_with_the_file_the_reason_and_a_remedy(
    tmp_path: Path, content: bytes, word: str
) -> None:
    path = saved(tmp_path, "x.surf.gii", content)
    with pytest.raises(InputError, match=word) as caught:
        read_surface(path)
    assert str(path) in str(caught.value) and caught.value.remedy


@pytest.mark.parametrize(("content", "word"), [*NEITHER, (FOREIGN["binary.stl"], "surface without values")])
def test_what_holds_no_values_is_refused(tmp_path: Path, content: bytes, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_fields(saved(tmp_path, "x.shape.gii", content))


@pytest.mark.parametrize("kept", [3, 40, 2000])
def test_a_surface_of_freesurfer_that_is_cut_off_packed_or_missing_is_refused(tmp_path: Path, kept: int) -> None:
    whole = of_freesurfer(tmp_path)
    for name, content in (("lh.cut", whole[:kept]), ("lh.white.gz", gzip.compress(whole))):
        with pytest.raises(InputError, match=f"{name}.*FreeSurfer"):
            read_surface(saved(tmp_path, name, content))
    with pytest.raises(InputError, match="No such file"):
        read_surface(tmp_path / "lh.gone")


# --- values


def nibabel_array(name: str, values: object, intent: str = "SHAPE") -> nibabel.gifti.GiftiDataArray:
    meta = nibabel.gifti.GiftiMetaData(Name=name) if name else None
    kind = np.int32 if intent == "NODE_INDEX" else np.float32
    return nibabel.gifti.GiftiDataArray(np.array(values, kind), f"NIFTI_INTENT_{intent}", meta=meta)


def values_file(path: Path, *arrays: nibabel.gifti.GiftiDataArray) -> Path:
    nibabel.save(nibabel.GiftiImage(darrays=list(arrays)), path)
    return path


def test_fields_take_their_names_from_metadata_or_the_file(tmp_path: Path) -> None:
    path = tmp_path / "regions.label.gii"
    fields = read_fields(
        values_file(path, nibabel_array("sulc", [0.5, 1.5, 2.5]), nibabel_array("", [3, 0, 7], "LABEL"))
    )
    assert list(fields) == ["sulc", "regions"]
    assert fields["sulc"].tolist() == [0.5, 1.5, 2.5] and fields["regions"].tolist() == [3, 0, 7]
    assert fields["regions"].dtype == np.int32


def test_values_are_those_of_the_vertices_that_a_file_lists(tmp_path: Path) -> None:
    """AFNI writes values in an order of its own, with an array of the vertices that they belong to."""

    def listed(nodes: list[int]) -> Path:
        arrays = nibabel_array("", nodes, "NODE_INDEX"), nibabel_array("thickness", [2.5, 0.5, 1.5], "NONE")
        return values_file(tmp_path / "afni.func.gii", *arrays)

    fields = read_fields(listed([2, 0, 1]))
    assert list(fields) == ["thickness"] and fields["thickness"].tolist() == [0.5, 1.5, 2.5]
    for nodes in ([2, 0, 4], [2, 0, 0], [-1, 0, 1], [0, 1]):
        with pytest.raises(InputError, match="vertices"):
            read_fields(listed(nodes))


@pytest.mark.parametrize("kind", [np.uint32, np.int64])
def test_labels_of_more_than_32_bits_are_refused_and_never_wrapped(tmp_path: Path, kind: type) -> None:
    values = np.array([1, 2**31 + 5, 3], kind)
    with pytest.raises(InputError, match="2147483653"):
        read_fields(saved(tmp_path, "x.label.gii", gifti(data_array(values, "LABEL"))))
    with pytest.raises(InputError, match="2147483653"):
        write_fields({"label": values}, tmp_path / "again.label.gii")


@pytest.mark.parametrize("value", [2.5, np.nan])
def test_labels_that_are_no_whole_numbers_are_refused(tmp_path: Path, value: float) -> None:
    with pytest.raises(InputError, match=f"parcel.*{value}"):
        read_fields(values_file(tmp_path / "x.label.gii", nibabel_array("parcel", [1, value, 0], "LABEL")))


def test_label_tables_of_earlier_tools_are_read_and_labels_without_a_name_have_none(tmp_path: Path) -> None:
    def table(labels: str) -> Path:
        return saved(tmp_path, "caret.label.gii", f"<GIFTI><LabelTable>{labels}</LabelTable></GIFTI>".encode())

    unnamed = '<Label Key="-2"><![CDATA[]]></Label>'
    assert read_label_names(table(f'<Label Index="1">insula</Label>{unnamed}')) == {1: "insula"}
    for labels in ('<Label Index="1">insula</Label><Label Key="1"></Label>', "<Label>insula</Label>"):
        with pytest.raises(InputError, match=r"caret.label.gii: .* key"):
            read_label_names(table(labels))


def test_plain_numbers_are_fields(tmp_path: Path) -> None:
    """As CIVET writes them: thickness, and numbers of parcels."""
    values = np.linspace(1, 3, 162)
    thick = saved(tmp_path, "thick.txt", "".join(f" {value:.6f}\n" for value in values).encode())
    parcels = saved(tmp_path, "AAL.txt", b"\r\n".join(b"%d" % (place % 3) for place in range(162)))
    both = with_fields(BALL, {"t": thick, "p": parcels}).point_data
    assert both["t"] == pytest.approx(values, abs=1e-6)
    assert both["p"].dtype == np.int32 and both["p"][:4].tolist() == [0, 1, 2, 0]
    assert read_label_names(parcels) == {}
    with pytest.raises(InputError, match="no surface"):
        read_surface(thick)
    with pytest.raises(InputError, match="one number per line"):
        read_fields(saved(tmp_path, "two.txt", b"1.0\n1.0 2.0\n"))


def test_values_and_labels_of_freesurfer_are_fields(tmp_path: Path) -> None:
    values, labels = np.linspace(1, 3, 162), np.arange(162) % 3
    thick, annot = tmp_path / "lh.thickness", tmp_path / "lh.aparc.annot"
    freesurfer.write_morph_data(str(thick), values)
    table = np.array([[25, 5, 25, 0, 0], [220, 20, 20, 0, 0], [20, 30, 140, 0, 0]])
    freesurfer.write_annot(str(annot), labels, table, ["unknown", "a", "b"], fill_ctab=True)
    found = read_fields(thick)
    assert list(found) == ["thickness"] and found["thickness"] == pytest.approx(values, rel=1e-6)
    assert read_label_names(thick) == {} and read_label_names(annot) == {0: "unknown", 1: "a", 2: "b"}
    fields = read_fields(annot)
    assert fields["aparc"].dtype == np.int32 and np.array_equal(fields["aparc"], labels)
    assert with_fields(BALL, {"t": thick, "area": annot}).point_data.keys() == {"t", "area"}
    whole = annot.read_bytes()
    unknown = whole[:8] + (99).to_bytes(4, "big") + whole[12:]  # a colour that the table has not
    assert read_fields(saved(tmp_path, "lh.x.annot", unknown))["x"][:3].tolist() == [-1, 1, 2]
    head = 4 + 8 * 162 + 8
    huge = whole[:head] + whole[head:].replace((3).to_bytes(4, "big"), b"\x7f" + b"\xff" * 3)  # so many labels
    flat = thick.read_bytes()
    for content in (flat[:6], flat[:100], flat[:-3], whole[:-20], whole[:-3], huge):
        with pytest.raises(InputError, match="lh.cut: .*no complete"):
            read_fields(saved(tmp_path, "lh.cut", content))
