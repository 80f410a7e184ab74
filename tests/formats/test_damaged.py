"""A file is sound or refused: damaged files, files of another kind, and surfaces that cannot lie where they say."""

from __future__ import annotations

import base64
import gzip
import json
import os
import random
import zlib
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
from damages import Seeds, outcome, place_damaged, seeds
from exported import full_mesh
from shapes import ball_surface
from surface_files import FACES, FOREIGN, POINTS, data_array, gifti, points, saved, triangles

from cortet.cohort import user_files
from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.certificates import SCHEMA, sealed
from cortet.formats.gifti import read_fields, read_surface, write_surface
from cortet.formats.hashing import sha256
from cortet.formats.untrusted import safely_named
from cortet.solver_files.export import convert, export
from cortet.solver_files.meshed import cell_size_of, certificate_path
from cortet.solver_files.sidecar import read_sidecar, sidecar_path

#: of the files that `damages` makes
KINDS = [
    *(name for name in FORMATS if name not in ("braingrowth", "febio")),
    *("xdmf_of_meshio", "gate", "repair", "fields", "text_stl", "ply", "text_ply", "obj", "off"),
    *("white", "thickness", "annot", "dseg", "aseg", "fa", "dti", "sheet", "config", "release"),
]


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Seeds:
    return seeds(tmp_path_factory.mktemp("valid"))


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_refused_or_give_a_sound_result(kind, valid, tmp_path):
    assert set(KINDS) == set(valid)
    file, read = valid[kind]
    assert outcome(read, file) == "sound"
    for number in range(4 if kind == "vtu" else 20):  # VTU files other than whole ones begin PyVista
        damaged = place_damaged(file, random.Random(number), tmp_path / str(number))
        assert outcome(read, damaged) in ("sound", "refused"), f"{kind} {number}"


def with_value(value: float) -> np.ndarray:
    values = POINTS.copy()
    values[2, 1] = value
    return values


LONGER = base64.b64encode(zlib.compress(bytes(60))).decode()
PLY = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
OBJ, OFF = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
NIFTI = nibabel.Nifti1Image(np.zeros((2, 2, 2), np.uint8), np.eye(4)).to_bytes()
#: contents of a file that is no surface
REFUSED: list[bytes] = [
    *(gifti(), gifti(points()), gifti(points(), points(), triangles())),
    gifti(points(np.zeros((0, 3), np.float32)), triangles()),
    gifti(points(POINTS[:, :2]), triangles()),
    *(gifti(points(with_value(value)), triangles()) for value in (np.nan, np.inf)),
    gifti(points().replace("-90", "1e999"), triangles()),
    *(gifti(points(), triangles(FACES + shift)) for shift in (1, -1)),
    gifti(points(), triangles((FACES.astype(np.int64) + 2**32 - 4).astype(np.uint32))),
    gifti(points(), triangles(FACES.astype(np.float32))),
    gifti(points(), triangles(), data_array(np.zeros(3, np.float32), "SHAPE")),
    *(gifti(points(Dim0=count), triangles()) for count in ("3", "5", "99999999999999")),
    gifti(points(encoding="ASCII", Dim0="5"), triangles()),
    gifti(points(encoding="ASCII", order="F"), triangles()),  # which NiBabel 5.4 misreads
    gifti(points().replace(points().split("<Data>")[1].split("<")[0], LONGER), triangles()),
    *(gifti(points(**{key: "BIG"}), triangles()) for key in ("Dim1", "DataType", "Encoding", "Endian")),
    gifti(points(Encoding="GZipBase64Binary", encoding="Base64Binary"), triangles()),
    *(gifti(points(), triangles())[:size] for size in (10, 100, -5)),
    PLY.replace(b"3 0 1 2", b"4 0 1 2 0"),
    PLY.replace(b"3 0 1 2", b"3 0 1 3"),
    PLY.replace(b"1 0 0", b"1 nan 0"),
    PLY.replace(b"vertex 3", b"vertex 300000000000"),
    PLY.replace(b"ascii", b"binary_little_endian"),
    PLY.replace(b"float x", b"float u"),
    *(PLY.replace(b"vertex 3", b"vertex"), PLY[:80]),
    *(FOREIGN[name][:3000] for name in ("binary.ply", "text.ply", "text.stl")),
    *(OBJ, OBJ + b"f -3 -2 -1\n", OBJ + b"f 1 2 4\n", OBJ + b"v 1 1 0\nf 1 2 4 3\n"),
    OBJ.replace(b"1 0 0", b"1 0 x") + b"f 1 2 1\n",
    *(OFF.replace(b"3 1 0", b"3 2 0"), OFF[:4]),
    *(OFF.replace(b"OFF", head) for head in (b"4OFF", b"OFF BINARY")),
    *(OFF.replace(b"3 0 1 2", b"4 0 1 2"), OFF.replace(b"3 0 1 2", b"3 0 1 3"), OFF.replace(b"1 0 0\n", b"1 0 x\n")),
    b"\xff\xff\xff\x00\x00\x00\x01\x00\x00\x00\x00\x00\x00\x00\x01" + bytes(4),
]
#: contents that are neither a surface nor values, and what they are
NEITHER: list[tuple[bytes, str]] = [
    *((b"", "GIfTI"), (b"what is this", "GIfTI"), (b"<Other></Other>", "GIFTI")),
    *((gzip.compress(b"what is this", mtime=0), "GIfTI"), (b"\x1f\x8b\x08\x00" + bytes(20), "decompressed")),
    *((NIFTI, "NIfTI"), (gzip.compress(NIFTI, mtime=0), "NIfTI")),
    (b'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0">', "VTK"),
    (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "LFS"),
    (b"<!DOCTYPE html><html><body>404</body>", "web page"),
    (b"P 0.3 0.3 0.4 10 1 4\n 0 0 0\n 1 0 0\n", "MNI"),
    (b'<?xml version="1.0" encoding="none"?><GIFTI></GIFTI>', "GIfTI"),
]


@pytest.mark.parametrize(("content", "word"), [*((content, "") for content in REFUSED), *NEITHER])
def test_what_is_no_surface_is_refused_with_file_and_remedy(tmp_path, content, word):
    path = saved(tmp_path, "x.surf.gii", content)
    with pytest.raises(InputError, match=word or None) as caught:
        read_surface(path)
    assert str(path) in str(caught.value) and caught.value.remedy
    if word:
        with pytest.raises(InputError, match=word):
            read_fields(path)


def test_a_field_named_as_a_path_writes_nothing_elsewhere(tmp_path):
    name, mesh, ball = "../../evil", full_mesh(), ball_surface(1)
    write_surface(replace(ball, point_data={name: np.ones(len(ball.points), np.float32)}), tmp_path / "s.surf.gii")
    assert list(read_surface(tmp_path / "s.surf.gii").point_data) == ["____evil"]
    source = tmp_path / "deep" / "er" / "m.vtu"
    FORMATS["vtu"].write(replace(mesh, point_data={name: mesh.point_data["thickness"]}), source)
    convert(source, source.with_name("out.pts"), source_unit="mm")
    outside = [path for path in tmp_path.rglob("*") if path.is_file() and path.parent != source.parent]
    assert outside == [tmp_path / "s.surf.gii"]
    names = [("a", 1), ("a", 2), ("a_2", 3), ("x/../y\n", 4), ("", 5)]
    assert list(safely_named(names)) == ["a", "a_2", "a_2_2", "x___y_", "unnamed"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("files", {"../../x": ""}),
        ("files", {"": ""}),
        ("files", []),
        ("units", {"coordinates": "parsec"}),
        ("made_from", {"given": {"cortex": {"sha256": ""}}}),
        ("made_from", []),
        ("fields", {"thickness": []}),
        ("coordinate_system", {"matrix": [1]}),
    ],
)
def test_a_sidecar_edited_to_another_form_is_named(tmp_path, key, value):
    path = tmp_path / "m.vtu"
    export(full_mesh(), path, solver="vtu")
    record = json.loads(sidecar_path(path).read_text())
    sidecar_path(path).write_text(json.dumps({**record, key: value}))
    with pytest.raises(InputError, match=rf"m\.vtu\.json: cannot be read as a sidecar: {key}"):
        convert(path, tmp_path / "n.inp")


def test_json_nested_deeper_than_python_reads_is_no_sidecar_and_no_certificate(tmp_path):
    path = tmp_path / "m.vtu"
    export(full_mesh(), path, solver="vtu")
    certificate_path(path).write_text("[" * 100_000)
    assert cell_size_of(path) is None
    sidecar_path(path).write_text("[" * 100_000)
    with pytest.raises(InputError, match="cannot be read as a sidecar"):
        read_sidecar(path)


@pytest.mark.parametrize("parameters", [[1], {"generate": []}, {"generate": {"cell_size": "0.6"}}])
def test_a_certificate_of_another_version_and_form_is_named(tmp_path, parameters):
    certificate_path(tmp_path / "m.vtu").write_text(json.dumps({"schema": 2, "parameters": parameters}))
    with pytest.raises(InputError, match="certificate"):
        cell_size_of(tmp_path / "m.vtu")


def test_an_edited_certificate_gives_no_cell_size(tmp_path):
    """It was believed, sealed or not."""
    whole = sealed({"schema": SCHEMA, "parameters": {"generate": {"cell_size": 0.6}}})
    for content, size in ((whole, 0.6), ({**whole, "parameters": {"generate": {"cell_size": 0.7}}}, None)):
        certificate_path(tmp_path / "m.vtu").write_text(json.dumps(content))
        assert cell_size_of(tmp_path / "m.vtu") == size


@pytest.mark.parametrize("attributes", [{"Dimensionality": "999999999"}, {"Dim0": "-5"}])
def test_a_gifti_array_of_a_shape_that_none_has_is_refused_at_once(tmp_path, attributes):
    """NiBabel counts to the first, and takes the second for any number of rows."""
    path = saved(tmp_path, "x.surf.gii", gifti(points(**attributes), triangles()))
    with pytest.raises(InputError, match=r"x\.surf\.gii: cannot be read as GIfTI: an array has"):
        read_surface(path)


def test_pipes_and_devices_are_refused_before_they_are_opened(tmp_path):
    """Nobody writes to the pipe, and the device never ends: opening one or reading the other waits for ever."""
    os.mkfifo(pipe := tmp_path / "x.surf.gii")
    os.mkfifo(sidecar_path(tmp_path / "m.vtu"))
    for path in (pipe, Path("/dev/zero")):
        assert user_files.content({"surface": path}) == {"surface": None}
        for read in (read_surface, sha256):
            with pytest.raises(InputError, match="file"):
                read(path)
    with pytest.raises(InputError, match="is not a file"):
        read_sidecar(tmp_path / "m.vtu")


def test_a_json_file_of_another_kind_is_no_sidecar(tmp_path):
    path, other = tmp_path / "m.vtu", tmp_path / "precious.gii"
    other.touch()
    export(full_mesh(), path, solver="vtu")
    text = sidecar_path(path).read_text()
    for strange in ("{}", "[]", '{"units": 3}'):
        sidecar_path(path).write_text(strange)
        assert read_sidecar(path) == {}
    sidecar_path(path).write_text(text[:-9])
    with pytest.raises(InputError, match=r"m\.vtu\.json"):
        convert(path, tmp_path / "n.mesh", source_unit="mm")
    record = json.loads(text)
    sidecar_path(path).write_text(json.dumps({**record, "files": {**record["files"], "precious.gii": ""}}))
    export(full_mesh(), path, solver="vtu")
    assert other.exists()
