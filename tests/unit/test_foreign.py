"""Files that are not GIfTI: surfaces and values of other programs are read, all else is called by its name."""

from __future__ import annotations

import gzip
from pathlib import Path

import nibabel
import nibabel.freesurfer.io as freesurfer
import numpy as np
import pytest
import trimesh
from shapes import ball_surface

from cortet.errors import InputError
from cortet.formats.gifti import read_fields, read_label_names, read_surface
from cortet.geometry.topology import enclosed_volume, surface_topology
from cortet.solver_files.fields import with_fields

BALL = ball_surface(2, 20.0)
MESH = trimesh.Trimesh(BALL.points, BALL.faces, process=False)
WRITTEN = {
    "binary.stl": lambda: MESH.export(file_type="stl"),
    "text.stl": lambda: MESH.export(file_type="stl_ascii").encode(),
    "binary.ply": lambda: MESH.export(file_type="ply"),
    "text.ply": lambda: MESH.export(file_type="ply", encoding="ascii"),
    "plain.obj": lambda: MESH.export(file_type="obj").encode(),
    "plain.off": lambda: MESH.export(file_type="off").encode(),
}


def saved(folder: Path, name: str, content: bytes) -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("name", WRITTEN)
def test_a_surface_of_another_program_is_closed_and_of_its_size(tmp_path: Path, name: str) -> None:
    surface = read_surface(saved(tmp_path, name, WRITTEN[name]()))
    assert (len(surface.points), len(surface.faces)) == (len(BALL.points), len(BALL.faces))
    assert surface_topology(surface.faces).problems() == []
    expected = enclosed_volume(BALL.points, BALL.faces)
    assert enclosed_volume(surface.points, surface.faces) == pytest.approx(expected, rel=1e-5)


def test_vertices_and_faces_of_an_obj_file_may_say_more(tmp_path: Path) -> None:
    text = b"# colours\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nvn 0 0 1\nf 1/2/1 2//1 3\n"
    surface = read_surface(saved(tmp_path, "q.obj", text))
    assert surface.faces.tolist() == [[0, 1, 2]] and surface.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]


def test_an_obj_file_of_several_materials_and_textures_is_one_closed_surface(tmp_path: Path) -> None:
    """trimesh 5.2 makes vertices of their own for each material, so that nothing closes."""
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\ng a\nusemtl x\nf 1/1 3/2 2/3\nf 1/3 2/1 4/2\n"
    surface = read_surface(saved(tmp_path, "m.obj", text + b"g b\nusemtl y\nf 1/2 4/3 3/1\nf 2/2 3/1 4/3\n"))
    assert len(surface.points) == 4 and surface_topology(surface.faces).problems() == []


OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize("name", WRITTEN)
def test_a_surface_that_is_packed_by_gzip_is_the_same(tmp_path: Path, name: str) -> None:
    plain = read_surface(saved(tmp_path, name, WRITTEN[name]()))
    packed = read_surface(saved(tmp_path, f"{name}.gz", gzip.compress(WRITTEN[name]())))
    assert np.array_equal(plain.points, packed.points) and np.array_equal(plain.faces, packed.faces)


def test_a_surface_of_freesurfer_that_is_packed_by_gzip_is_called_by_its_name(tmp_path: Path) -> None:
    freesurfer.write_geometry(str(tmp_path / "lh.white"), BALL.points, BALL.faces)
    path = saved(tmp_path, "lh.white.gz", gzip.compress((tmp_path / "lh.white").read_bytes()))
    with pytest.raises(InputError, match=r"white\.gz: is a FreeSurfer surface packed by gzip \(gunzip it\)"):
        read_surface(path)


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


PLY = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (PLY.replace(b"3 0 1 2", b"4 0 1 2 0"), "not triangles"),
        (PLY.replace(b"3 0 1 2", b"3 0 1 3"), "vertices run from 0 to 2"),
        (PLY.replace(b"1 0 0", b"1 nan 0"), "not finite"),
        (PLY.replace(b"vertex 3", b"vertex 300000000000"), ""),
        (PLY.replace(b"ascii", b"binary_little_endian"), ""),
        (PLY.replace(b"float x", b"float u"), ""),
        (PLY.replace(b"vertex 3", b"vertex"), "PLY"),
        (PLY[:80], "PLY"),
        (WRITTEN["binary.ply"]()[:3000], ""),
        (WRITTEN["text.ply"]()[:3000], ""),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n", "vertices run from 0 to 2"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "vertices run from 0 to 2"),
        (b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", "not triangles"),
        (b"v 0 0 0\nv 1 0 x\nf 1 2 1\n", "OBJ"),
        (b"v 0 0 0\n", "no vertices or no triangles"),
        (b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "OFF"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 2 1\n", "more or fewer lines"),
        (b"OFF\n", "OFF"),
        (OFF.replace(b"OFF", b"4OFF"), "OFF"),
        (OFF.replace(b"OFF", b"COFF"), "OFF"),
        (OFF.replace(b"OFF", b"OFF BINARY"), "OFF"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "OFF"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "vertices run from 0 to 2"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n", "OFF"),
        (MESH.export(file_type="stl_ascii").encode()[:3000], "not a complete STL"),
    ],
)
def test_a_damaged_surface_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_surface(saved(tmp_path, "x", content))
    assert caught.value.file == tmp_path / "x" and caught.value.remedy


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
    with pytest.raises(InputError, match=r"lh.cut: "):
        read_surface(saved(tmp_path, "lh.cut", content[:-5]))
    with pytest.raises(InputError, match="a FreeSurfer surface"):
        read_fields(tmp_path / "lh.orig")


def test_plain_numbers_are_fields(tmp_path: Path) -> None:
    """As CIVET writes them: thickness, and numbers of parcels."""
    values = np.linspace(1, 3, 162)
    thick = saved(tmp_path, "thick.txt", "".join(f" {value:.6f}\n" for value in values).encode())
    parcels = saved(tmp_path, "AAL.txt", b"\r\n".join(b"%d" % (place % 3) for place in range(162)))
    both = with_fields(BALL, {"t": thick, "p": parcels}).point_data
    assert both["t"] == pytest.approx(values, abs=1e-6)
    assert both["p"].dtype == np.int32 and both["p"][:4].tolist() == [0, 1, 2, 0]
    assert read_label_names(parcels) == {}
    with pytest.raises(InputError, match="plain numbers, no surface"):
        read_surface(thick)
    with pytest.raises(InputError, match="not one number a line"):
        read_fields(saved(tmp_path, "two.txt", b"1.0\n1.0 2.0\n"))


def test_values_and_labels_of_freesurfer_are_fields(tmp_path: Path) -> None:
    values, labels = np.linspace(1, 3, 162), np.arange(162) % 3
    freesurfer.write_morph_data(str(tmp_path / "lh.thickness"), values)
    table = np.array([[25, 5, 25, 0, 0], [220, 20, 20, 0, 0], [20, 30, 140, 0, 0]])
    freesurfer.write_annot(str(tmp_path / "lh.aparc.annot"), labels, table, ["unknown", "a", "b"], fill_ctab=True)
    found = read_fields(tmp_path / "lh.thickness")
    assert list(found) == ["thickness"] and found["thickness"] == pytest.approx(values, rel=1e-6)
    assert read_label_names(tmp_path / "lh.thickness") == {}
    fields = read_fields(tmp_path / "lh.aparc.annot")
    assert fields["aparc"].dtype == np.int32 and np.array_equal(fields["aparc"], labels)
    assert read_label_names(tmp_path / "lh.aparc.annot") == {0: "unknown", 1: "a", 2: "b"}
    with_both = with_fields(BALL, {"t": tmp_path / "lh.thickness", "area": tmp_path / "lh.aparc.annot"})
    assert with_both.point_data.keys() == {"t", "area"}


def test_vertices_of_no_label_are_marked(tmp_path: Path) -> None:
    path = tmp_path / "lh.x.annot"
    freesurfer.write_annot(str(path), np.array([0, 1, 1]), np.array([[1, 2, 3, 0, 0], [4, 5, 6, 0, 0]]), ["a", "b"])
    data = path.read_bytes()
    path.write_bytes(data[:8] + (99).to_bytes(4, "big") + data[12:])  # a colour that the table has not
    assert read_fields(path)["x"].tolist() == [-1, 1, 1]


@pytest.mark.parametrize("name", ["lh.thickness", "lh.aparc.annot"])
def test_a_damaged_file_of_freesurfer_is_refused(tmp_path: Path, name: str) -> None:
    freesurfer.write_morph_data(str(tmp_path / "lh.thickness"), np.ones(162))
    freesurfer.write_annot(str(tmp_path / "lh.aparc.annot"), np.zeros(162, int), np.zeros((1, 5), int), ["a"])
    whole = (tmp_path / name).read_bytes()
    kept = (6, 100, len(whole) - 3) if name == "lh.thickness" else (len(whole) - 20, len(whole) - 3)
    for size in kept:
        with pytest.raises(InputError, match="no complete"):
            read_fields(saved(tmp_path, "lh.cut", whole[:size]))
    if name.endswith("annot"):  # a table that states any number of labels
        huge = whole[: 4 + 8 * 162 + 8] + whole[4 + 8 * 162 + 8 :].replace(
            (1).to_bytes(4, "big"), b"\x7f" + b"\xff" * 3
        )
        with pytest.raises(InputError, match="no complete annotation"):
            read_fields(saved(tmp_path, "lh.huge", huge))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x1f\x8b\x08\x00" + bytes(20), "cannot be unpacked: "),
        (gzip.compress(b"what is this", mtime=0), "truncated or not GIfTI"),
        (gzip.compress(nibabel.Nifti1Image(np.zeros((2, 2, 2)), np.eye(4)).to_bytes(), mtime=0), "but a NIfTI image"),
        (
            b'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0">',
            r"but VTK PolyData \(convert it to GIfTI or PLY",
        ),
        (b"<VTKFile type='UnstructuredGrid'></VTKFile>", r"but VTK UnstructuredGrid \(convert it to GIfTI or PLY"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a pointer of Git LFS, not the file"),
        (b"<!DOCTYPE html><html><body>404</body>", "a web page, not the file"),
        (b"# vtk DataFile Version 3.0\n", "a VTK file"),
        (b"P 0.3 0.3 0.4 10 1 4\n 0 0 0\n 1 0 0\n", "a surface of MNI.*ConvertSurface"),
        (
            b"\xff\xff\xff\x00\x00\x00\x01\x00\x00\x00\x00\x00\x00\x00\x01" + bytes(4),
            "values of FreeSurfer, no surface",
        ),
        (nibabel.Nifti1Image(np.zeros((2, 2, 2), np.uint8), np.eye(4)).to_bytes(), "a NIfTI image"),
        (b"what is this", "truncated or not GIfTI"),
    ],
)
def test_what_is_not_read_is_called_by_its_name(tmp_path: Path, content: bytes, words: str) -> None:
    path = saved(tmp_path, "x.surf.gii", content)
    with pytest.raises(InputError, match=words) as caught:
        read_surface(path)
    assert str(path) in str(caught.value) and caught.value.remedy
    if not content.startswith(b"\xff\xff\xff"):
        with pytest.raises(InputError, match=words):
            read_fields(path)


def test_a_surface_is_no_field(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not GIfTI but a surface without values"):
        read_fields(saved(tmp_path, "x.stl", WRITTEN["binary.stl"]()))
