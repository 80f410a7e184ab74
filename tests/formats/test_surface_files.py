"""Every valid form of a surface, and of its values, is read; what cortet writes is what NiBabel reads."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import nibabel
import nibabel.freesurfer.io as freesurfer
import numpy as np
import pytest
from shapes import ball_surface
from surface_files import (
    BALL,
    FACES,
    FOREIGN,
    MATRIX,
    POINTS,
    data_array,
    gifti,
    metadata,
    points,
    saved,
    triangles,
)

import cortet
from cortet.cohort import user_files
from cortet.config import load
from cortet.errors import InputError, StageError
from cortet.formats.gifti import (
    hemisphere_of,
    kind_of,
    read_fields,
    read_label_names,
    read_surface,
    require_anatomical,
    write_fields,
    write_surface,
)
from cortet.formats.hashing import input_sha256, sha256
from cortet.formats.placement import placed
from cortet.geometry.topology import enclosed_volume, surface_topology
from cortet.meshes import CoordinateFrame, TriSurface, single_precision
from cortet.solver_files.fields import with_fields

# --- GIfTI


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("ASCII", "C"), *((encoding, order) for encoding in ("Base64Binary", "GZipBase64Binary") for order in "CF")],
)
@pytest.mark.parametrize(("endian", "name"), [("<", "GIFTI_ENDIAN_LITTLE"), (">", "GIFTI_ENDIAN_BIG"), (">", "")])
@pytest.mark.parametrize("index", [np.int32, np.uint32, np.int64])
def test_every_valid_form_is_read(tmp_path, encoding, order, endian, name, index):
    """Those names of endianness NiBabel wrote once."""
    how = {"encoding": encoding, "order": order, "endian": endian} | ({"Endian": name} if name else {})
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH", tuple(map(float, MATRIX.split())))
    for arrays in ([points(**how), triangles(FACES.astype(index), **how)], [triangles(**how), points(**how)]):
        surface = read_surface(saved(tmp_path, "x.surf.gii", gifti(*arrays)))
        assert np.array_equal(surface.points, POINTS) and np.array_equal(surface.faces, FACES)
        assert surface.frame == frame


def test_what_is_written_is_read_back_and_is_what_nibabel_reads(tmp_path):
    matrix = (*np.add(np.eye(4), 0.1).ravel()[:12].tolist(), 0, 0, 0, 1)
    frame = CoordinateFrame("NIFTI_XFORM_ALIGNED_ANAT", "NIFTI_XFORM_MNI_152", matrix)
    fields = {"thickness": np.linspace(1, 2, len(BALL.points)), "region": np.arange(len(BALL.points)) % 3}
    surface = single_precision(replace(BALL, point_data=fields, frame=frame))
    path = tmp_path / "new" / "x.surf.gii"
    write_surface(surface, path)
    again, image = read_surface(path), nibabel.load(path)
    assert again.frame == frame and image.darrays[0].coordsys.dataspace == 2
    assert again.point_data["region"].dtype == np.int32
    assert np.array_equal(again.point_data["region"], fields["region"])
    assert np.allclose(again.point_data["thickness"], fields["thickness"], atol=1e-6)
    for found in ((again.points, again.faces), image.agg_data(("pointset", "triangle"))):
        assert np.array_equal(found[0], surface.points) and np.array_equal(found[1], surface.faces)
    written = path.read_bytes()
    write_surface(again, path)
    assert path.read_bytes() == written


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("sub-01_hemi-L_wm.surf.gii", "white"), ("sub-01_hemi-L_desc-x_smoothwm.surf.gii", "white")),
        *(("lh.white", "white"), ("lh.pial.T1", "pial"), ("whitehead_surface.gii", None), ("sub-wm01.surf.gii", None)),
    ],
)
def test_a_file_names_its_surface_and_its_hemisphere(tmp_path, name, kind):
    path = saved(tmp_path, name, gifti(points(), triangles()))
    assert kind_of(path) == kind and hemisphere_of(path) is None
    for structure, hemisphere in (("CortexLeft", "L"), ("CortexRight", "R"), ("Cerebellum", None)):
        known = {"AnatomicalStructurePrimary": structure, "AnatomicalStructureSecondary": "Pial"}
        path = saved(tmp_path, name, gifti(metadata(known), points(), triangles()))
        assert kind_of(path) == "pial" and hemisphere_of(path) == hemisphere


def test_a_file_that_is_packed_as_a_whole_is_read(tmp_path):
    whole = gifti(points(), triangles())
    for packed in (gzip.compress(whole), gzip.compress(whole[:99]) + gzip.compress(whole[99:])):  # as bgzip does
        path = saved(tmp_path, "x.surf.gii.gz", packed)
        assert np.array_equal(read_surface(path).points, POINTS)
    with pytest.raises(InputError, match="x.surf.gii.gz"):
        read_surface(saved(tmp_path, "x.surf.gii.gz", packed[:-20]))


def test_data_in_an_external_file_are_part_of_the_input(tmp_path):
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
    saved(tmp_path.parent, "x.dat", b"head" + POINTS.tobytes())
    wrong = [{"ExternalFileOffset": offset} for offset in ("8", "-1", "4.5", "x")] + [{"ExternalFileName": "../x.dat"}]
    for one in wrong:
        with pytest.raises(InputError, match="x.surf.gii"):
            read_surface(saved(tmp_path, "x.surf.gii", gifti(points(**how | one), triangles())))


# --- surfaces of other programs


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", FOREIGN)
def test_a_surface_of_another_program_is_closed_and_of_its_size(tmp_path, name, packed):
    content = gzip.compress(FOREIGN[name]) if packed else FOREIGN[name]
    surface = read_surface(saved(tmp_path, f"{name}.gz" if packed else name, content))
    assert (len(surface.points), len(surface.faces)) == (len(BALL.points), len(BALL.faces))
    assert surface_topology(surface.faces).problems() == []
    expected = enclosed_volume(BALL.points, BALL.faces)
    assert enclosed_volume(surface.points, surface.faces) == pytest.approx(expected, rel=1e-5)


def test_an_obj_file_may_say_more_and_is_one_closed_surface(tmp_path):
    """trimesh 5.2 makes vertices of their own for each material, so that nothing closes."""
    text = b"# colours\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nv 0 0 1 1 1 1\nvn 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    text += b"g a\nusemtl x\nf 1/1/1 3//1 2\nf 1/3 2/1 4/2\ng b\nusemtl y\nf 1/2 4/3 3/1\nf 2/2 3/1 4/3\n"
    surface = read_surface(saved(tmp_path, "m.obj", text))
    assert surface.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert surface_topology(surface.faces).problems() == []


def test_an_off_file_of_meshlab_has_normals_and_colours(tmp_path):
    text = b"NCOFF\n4 4 0\n0 0 0 255 255 255 255 0 0 1\n1 0 0 0 0 0 255 0 0 1 # comment\n\n0 1 0 9 9 9 255 0 0 1\n"
    text += b"0 0 1 9 9 9 255 0 0 1\n3 0 2 1 255 0 0\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    surface = read_surface(saved(tmp_path, "m.off", text))
    assert surface.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert surface.faces.tolist() == [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


def test_a_ply_file_of_either_order_and_with_other_properties(tmp_path):
    head = "ply\nformat binary_{}_endian 1.0\ncomment x\nelement vertex 3\nproperty double x\nproperty double y\n"
    head += "property double z\nproperty uchar red\nelement face 1\n"
    head += "property list uchar uint vertex_index\nend_header\n"
    for name, order in (("little", "<"), ("big", ">")):
        vertices = np.zeros(3, [("p", f"{order}f8", 3), ("red", "u1")])
        vertices["p"] = np.eye(3)
        face = np.array([(3, [0, 1, 2])], [("n", "u1"), ("v", f"{order}u4", 3)])
        surface = read_surface(saved(tmp_path, name, head.format(name).encode() + vertices.tobytes() + face.tobytes()))
        assert np.array_equal(surface.points, np.eye(3)) and surface.faces.tolist() == [[0, 1, 2]]


def test_a_surface_of_quadrangles_is_read(tmp_path):
    """A cube of 20 mm."""
    corners = 20.0 * np.indices((2, 2, 2)).reshape(3, -1).T
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    indices = b"".join(int(corner).to_bytes(3, "big") for face in faces for corner in face)
    counts = (8).to_bytes(3, "big") + (6).to_bytes(3, "big")
    content = b"\xff\xff\xfd" + counts + corners.astype(">f4").tobytes() + indices
    surface = read_surface(saved(tmp_path, "lh.orig", content))
    assert surface_topology(surface.faces).problems() == []
    assert enclosed_volume(surface.points, surface.faces) == pytest.approx(8000)
    for read, name, kept in ((read_surface, "lh.cut", content[:-5]), (read_fields, "lh.orig", content)):
        with pytest.raises(InputError, match=name):
            read(saved(tmp_path, name, kept))


# --- values


def shape_file(path: Path, *arrays: tuple[str, object, str]) -> Path:
    made = [
        nibabel.gifti.GiftiDataArray(
            np.array(values, np.int32 if intent == "NODE_INDEX" else np.float32),
            f"NIFTI_INTENT_{intent}",
            meta=nibabel.gifti.GiftiMetaData(Name=name) if name else None,
        )
        for name, values, intent in arrays
    ]
    nibabel.save(nibabel.GiftiImage(darrays=made), path)
    return path


def test_fields_take_their_names_from_metadata_or_the_file(tmp_path):
    arrays = ("sulc", [0.5, 1.5, 2.5], "SHAPE"), ("", [3, 0, 7], "LABEL")
    fields = read_fields(shape_file(tmp_path / "regions.label.gii", *arrays))
    assert list(fields) == ["sulc", "regions"]
    assert fields["sulc"].tolist() == [0.5, 1.5, 2.5] and fields["regions"].tolist() == [3, 0, 7]
    assert fields["regions"].dtype == np.int32


def test_values_are_those_of_the_vertices_that_a_file_lists(tmp_path):
    """AFNI writes values in an order of its own, with an array of the vertices that they belong to."""

    def listed(nodes: list[int]) -> Path:
        arrays = ("", nodes, "NODE_INDEX"), ("thickness", [2.5, 0.5, 1.5], "NONE")
        return shape_file(tmp_path / "afni.func.gii", *arrays)

    assert read_fields(listed([2, 0, 1]))["thickness"].tolist() == [0.5, 1.5, 2.5]
    for nodes in ([2, 0, 4], [2, 0, 0], [-1, 0, 1], [0, 1]):
        with pytest.raises(InputError, match="vertex"):
            read_fields(listed(nodes))


@pytest.mark.parametrize("kind", [np.uint32, np.int64])
def test_labels_are_whole_numbers_of_32_bits_and_never_wrapped(tmp_path, kind):
    values = np.array([1, 2**31 + 5, 3], kind)
    with pytest.raises(InputError, match="2147483653"):
        read_fields(saved(tmp_path, "x.label.gii", gifti(data_array(values, "LABEL"))))
    with pytest.raises(InputError, match="2147483653"):
        write_fields({"label": values}, tmp_path / "again.label.gii")
    for value in (2.5, np.nan):
        with pytest.raises(InputError, match=f"parcel.*{value}"):
            read_fields(shape_file(tmp_path / "x.label.gii", ("parcel", [1, value, 0], "LABEL")))


def test_label_tables_of_earlier_tools_are_read_and_labels_without_a_name_have_none(tmp_path):
    def table(labels: str) -> Path:
        return saved(tmp_path, "caret.label.gii", f"<GIFTI><LabelTable>{labels}</LabelTable></GIFTI>".encode())

    unnamed = '<Label Key="-2"><![CDATA[]]></Label>'
    assert read_label_names(table(f'<Label Index="1">insula</Label>{unnamed}')) == {1: "insula"}
    with pytest.raises(InputError, match=r"caret.label.gii: .* key"):
        read_label_names(table('<Label Index="1">insula</Label><Label Key="1"></Label>'))


def test_plain_numbers_are_fields(tmp_path):
    """As CIVET writes them: thickness, and numbers of parcels."""
    values = np.linspace(1, 3, 162)
    thick = saved(tmp_path, "thick.txt", "".join(f" {value:.6f}\n" for value in values).encode())
    parcels = saved(tmp_path, "AAL.txt", b"\r\n".join(b"%d" % (place % 3) for place in range(162)))
    both = with_fields(BALL, {"t": thick, "p": parcels}).point_data
    assert both["t"] == pytest.approx(values, abs=1e-6)
    assert both["p"].dtype == np.int32 and both["p"][:4].tolist() == [0, 1, 2, 0]
    assert read_label_names(parcels) == {}
    with pytest.raises(InputError, match="without a surface"):
        read_surface(thick)
    with pytest.raises(InputError, match="one number per line"):
        read_fields(saved(tmp_path, "two.txt", b"1.0\n1.0 2.0\n"))


def test_values_and_labels_of_freesurfer_are_fields(tmp_path):
    values, labels = np.linspace(1, 3, 162), np.arange(162) % 3
    thick, annot = tmp_path / "lh.thickness", tmp_path / "lh.aparc.annot"
    freesurfer.write_morph_data(str(thick), values)
    table = np.array([[25, 5, 25, 0, 0], [0, 0, 0, 0, 0], [20, 30, 140, 0, 0]])
    freesurfer.write_annot(str(annot), labels, table, ["unknown", "a", "b"], fill_ctab=True)
    found = read_fields(thick)
    assert list(found) == ["thickness"] and found["thickness"] == pytest.approx(values, rel=1e-6)
    with pytest.raises(InputError, match="without a surface"):
        read_surface(thick)
    assert read_label_names(thick) == {} and read_label_names(annot) == {0: "unknown", 1: "a", 2: "b"}
    assert read_fields(annot)["aparc"].dtype == np.int32 and np.array_equal(read_fields(annot)["aparc"], labels)
    whole = annot.read_bytes()
    unknown = whole[:8] + (99).to_bytes(4, "big") + whole[12:]  # a colour that the table has not
    assert read_fields(saved(tmp_path, "lh.x.annot", unknown))["x"][:3].tolist() == [-1, 1, 2]


def test_a_field_takes_the_name_that_it_is_given_and_has_a_value_for_each_vertex(tmp_path):
    ball, file = ball_surface(1), tmp_path / "a.shape.gii"
    holes = np.where(np.isin(np.arange(42), [5, 7]), np.nan, 1.0)
    shape_file(file, ("anything", np.arange(42), "SHAPE"))
    assert np.array_equal(with_fields(ball, {"thickness": file}).point_data["thickness"], np.arange(42))
    shape_file(file, ("mean", np.ones(42), "SHAPE"), ("sd", np.ones(42), "SHAPE"))
    assert with_fields(ball, {"growth": file}).point_data.keys() == {"growth_mean", "growth_sd"}
    for name, values, word in (
        *(("thickness", np.ones(7), "7 values for 42"), ("thickness", holes, "thickness.* 2 vertices.*vertex 5")),
        ("thickness", None, "No such file"),
    ):
        shape_file(file, ("anything", values, "SHAPE")) if values is not None else file.unlink()
        with pytest.raises(InputError, match=f"a.shape.gii.*{word}"):
            with_fields(ball, {name: file})


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000.0), ("um", 0.001)])
def test_units(unit, factor):
    ball, frame = ball_surface(), CoordinateFrame("NIFTI_XFORM_TALAIRACH")
    surface = TriSurface(ball.points / factor, ball.faces, frame=frame)
    made = placed(surface, load({"gate": {"unit": unit}}).placement())
    assert made.points == pytest.approx(ball.points) and np.array_equal(made.faces, surface.faces)
    assert made.frame == CoordinateFrame()
    assert load({}).placement() is None and placed(surface, None) is surface


@pytest.mark.parametrize("shape", ["Inflated", "VeryInflated", "Spherical", "Flat", "Hull"])
def test_a_surface_that_says_it_is_inflated_is_not_meshed(tmp_path, shape):
    """Its mesh was certified: an inflated surface is as sound as any."""
    image = nibabel.gifti.GiftiImage()
    image.add_gifti_data_array(nibabel.gifti.GiftiDataArray(BALL.points.astype("f4"), "NIFTI_INTENT_POINTSET"))
    image.add_gifti_data_array(nibabel.gifti.GiftiDataArray(BALL.faces, "NIFTI_INTENT_TRIANGLE"))
    image.darrays[0].meta = nibabel.gifti.GiftiMetaData({"GeometricType": shape})
    nibabel.save(image, tmp_path / "x.surf.gii")
    assert len(cortet.surface(tmp_path / "x.surf.gii").faces) == len(BALL.faces), "it can still be looked at"
    for given in (tmp_path / "x.surf.gii", image):
        with pytest.raises(InputError, match=shape):
            cortet.mesh(given, 5.0)
    image.darrays[0].meta = nibabel.gifti.GiftiMetaData({"GeometricType": "Anatomical"})
    nibabel.save(image, tmp_path / "x.surf.gii")
    require_anatomical(tmp_path / "x.surf.gii")


@pytest.mark.parametrize("name", ["lh.inflated", "rh.sphere.reg"])
def test_inflated_surfaces_of_freesurfer_are_known_by_their_names(tmp_path, name):
    freesurfer.write_geometry(tmp_path / name, BALL.points, BALL.faces)
    with pytest.raises(InputError, match="not that of a brain"):
        require_anatomical(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("lh.cortex.label", b"#!ascii label  , from subject s\n1\n0 1.0 2.0 3.0 0.0\n", "a FreeSurfer label"),
        ("x.dscalar.nii", b"\x1c\x02\x00\x00" + bytes(600), "a CIFTI file"),
        ("T1.mgz", gzip.compress(b"\x00\x00\x00\x01" + bytes(400), mtime=0), "an image"),
        ("lh.pial", b"XSym\n0010\n" + b"0" * 32 + b"\nlh.pial.T1\n", "a link that a file system of Windows stores"),
    ],
    ids=("label", "CIFTI", "MGZ", "XSym"),
)
def test_files_of_other_kinds_are_named_as_what_they_are(tmp_path, name, content, kind):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"is {kind}"):
        read_surface(tmp_path / name)


def test_values_without_a_surface_are_named(tmp_path):
    shape_file(tmp_path / "t.shape.gii", ("t", np.ones(9, np.float32), "SHAPE"))
    with pytest.raises(InputError, match=r"holds values \(NIFTI_INTENT_SHAPE\) without a surface"):
        read_surface(tmp_path / "t.shape.gii")


def test_a_broken_link_says_where_it_leads(tmp_path):
    (tmp_path / "lh.pial").symlink_to("lh.pial.T1")
    with pytest.raises(InputError, match=r"is a link to lh\.pial\.T1, which is missing"):
        read_surface(tmp_path / "lh.pial")


def test_freesurfers_oldest_surfaces_are_named_as_such(tmp_path):
    """Magic 16777215 begins surfaces of quadrangles and files of values alike: the former were called the latter."""
    corners = np.array([[0, 1, 2, 3], [3, 2, 1, 0]])
    head = b"\xff\xff\xff" + (4).to_bytes(3, "big") + (2).to_bytes(3, "big")
    threes = b"".join(int(one).to_bytes(3, "big") for one in corners.ravel())
    (tmp_path / "lh.white").write_bytes(head + np.zeros((4, 3), ">i2").tobytes() + threes)
    for read in (read_surface, read_fields):
        with pytest.raises(InputError, match="lh.white: is a FreeSurfer surface of quadrangles.*mris_convert"):
            read(tmp_path / "lh.white")
    freesurfer.write_morph_data(tmp_path / "lh.thickness", np.ones(4))
    with pytest.raises(InputError, match="values without a surface"):
        read_surface(tmp_path / "lh.thickness")
