"""Volumes on tetrahedra, and what is said of volumes that cannot be used."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import cortet
from cortet.cli import main
from cortet.cohort.scan import scan
from cortet.cohort.sheet import read_sheet, write_sheet
from cortet.errors import InputError
from cortet.formats import read_mesh
from cortet.formats.tsv import read_tsv
from cortet.formats.volumes import Volume, label_names, matrices, read_named, read_volume
from cortet.formats.volumes import volume_of as volume_from
from cortet.geometry.icosphere import icosphere
from cortet.geometry.voxels import labels_inside, means_inside
from cortet.geometry.winding import winding_numbers
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.volumes import backgrounds, with_volumes

RADIUS, SIZE = 10.0, 32
#: voxels of 1 mm around a ball of 10 mm about 0
AFFINE = np.array([[-1, 0, 0, 15.5], [0, 1, 0, -15.5], [0, 0, 1, -15.5], [0, 0, 0, 1.0]])
TET = TetMesh([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], [[0, 1, 2, 3]])


def oblique(scale: tuple[float, float, float] = (0.7, 0.9, 1.3)) -> NDArray[np.float64]:
    affine = np.eye(4)
    affine[:3, :3] = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix() * scale
    return affine


@pytest.fixture(scope="module")
def ball() -> TriSurface:
    sphere = icosphere(4)
    return TriSurface(RADIUS * sphere.points, sphere.faces)


@pytest.fixture(scope="module")
def labels() -> NDArray[np.int16]:
    """1 in the ball, 2 in the half of it in front."""
    centres = np.indices((SIZE, SIZE, SIZE)).reshape(3, -1).T @ AFFINE[:3, :3].T + AFFINE[:3, 3]
    inside = np.linalg.norm(centres, axis=1) < RADIUS
    return (inside * np.where(centres[:, 1] > 0, 2, 1)).reshape(SIZE, SIZE, SIZE).astype(np.int16)


def written(path: Path, values: NDArray[np.generic], affine: NDArray[np.float64] = AFFINE, unit: str = "mm") -> Path:
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return path


# --- reading ------------------------------------------------------------------------------------------------------


def test_the_kind_is_told_from_the_file(tmp_path, labels):
    assert read_volume(written(tmp_path / "a.nii.gz", labels)).kind == "labels"
    assert read_volume(written(tmp_path / "x_dseg.nii.gz", labels.astype(np.float32))).kind == "labels"
    fraction = read_volume(written(tmp_path / "fa.nii", (labels / 3).astype(np.float32)))
    assert fraction.kind == "numbers"
    assert fraction.values.max() == pytest.approx(2 / 3)
    whole = written(tmp_path / "whole.nii", labels.astype(np.float32))
    assert read_named(f"{whole}:labels").kind == "labels"
    assert read_named(f"{whole}:numbers").kind == "numbers"
    with pytest.raises(InputError, match="tissue"):
        read_named(f"{whole}:tissue")


def test_freesurfers_volumes_are_read(tmp_path, labels):
    image = nibabel.MGHImage(labels.astype(np.int32), AFFINE)
    nibabel.save(image, file := tmp_path / "aseg.mgz")
    volume = read_volume(file)
    assert volume.kind == "labels"
    np.testing.assert_array_equal(volume.values, labels)
    np.testing.assert_allclose(volume.affine, AFFINE, atol=1e-5)


@pytest.mark.parametrize("suffix", ["mgh", "mgz"])
def test_an_mgh_file_without_valid_geometry_is_refused(tmp_path, labels, suffix):
    """NiBabel would place it around 0, with voxels of 1 mm."""
    raw = nibabel.MGHImage(labels.astype(np.int32), AFFINE).to_bytes()
    raw = raw[:28] + bytes(2) + raw[30:]
    path = tmp_path / f"aseg.{suffix}"
    path.write_bytes(gzip.compress(raw) if suffix == "mgz" else raw)
    for read in (read_volume, lambda path: volume_from(nibabel.load(path))):
        with pytest.raises(InputError, match=rf"aseg.{suffix}: does not state the location of its voxels: .*invalid"):
            read(path)


def test_labels_that_a_file_rounds_are_labels(tmp_path, labels, caplog):
    for slope, whole in ((0.1, 1), (701.49995, 7015)):
        image = nibabel.Nifti1Image(10 * (labels > 0).astype(np.uint8), AFFINE)
        file = tmp_path / "x_dseg.nii"
        nibabel.save(image, file)
        _damaged(file, lambda raw, slope=slope: raw[:112] + np.float32(slope).tobytes() + bytes(4) + raw[120:])
        caplog.clear()
        assert set(np.unique(read_volume(file).values)) == {0, whole}
        assert "rounds" in caplog.text
    assert read_volume(written(tmp_path / "md.nii", 0.0008 * labels)).kind == "numbers"


def test_labels_have_names(tmp_path, labels):
    file = written(tmp_path / "sub-1_desc-drawem9_dseg.nii.gz", labels)
    own = tmp_path / "sub-1_desc-drawem9_dseg.tsv"
    assert label_names(file) == {}
    (tmp_path / "dseg.tsv").write_text("index\tname\n1\tback\n2\tfront\n")
    assert read_volume(file).names == {1: "back", 2: "front"}
    own.write_text("index\tname\tcolor\n1\tCSF\t#fff\n")
    assert read_volume(file).names == {1: "CSF"}
    for text in ("index\tname\nx\tCSF\n", "index\tname\n1\ta\n1\tb\n", "key\tname\n1\ta\n"):
        own.write_text(text)
        with pytest.raises(InputError, match="drawem9_dseg.tsv"):
            read_volume(file)


METRES = np.diag([0.001, 0.001, 0.001, 1.0]) @ AFFINE


def _cut(labels: NDArray[np.int16], path: Path, change: Callable[[bytes], bytes]) -> Path:
    return _damaged(written(path, labels), change)


#: volumes that are refused, and a word of why
BAD: dict[str, tuple[Callable[[Path, NDArray[np.int16]], Path], str]] = {
    "empty": (lambda path, labels: written(path, 0 * labels), "empty"),
    "no numbers": (lambda path, labels: written(path, np.full(labels.shape, np.nan, np.float32)), "empty"),
    "metres by the header": (lambda path, labels: written(path, labels, METRES, "meter"), "in mm"),
    "metres": (lambda path, labels: written(path, labels, METRES), "in mm"),
    "4-D": (lambda path, labels: written(path, np.stack([labels] * 4, axis=-1)), "tensor"),
    "2-D": (lambda path, labels: written(path, labels[0]), "shape"),
    "whole numbers as float": (lambda path, labels: written(path, labels.astype(np.float32)), "labels or"),
    "the same beside NaN": (
        lambda path, labels: written(path, np.where(labels == 0, np.nan, labels).astype(np.float32)),
        "labels or",
    ),
    "fractions": (
        lambda path, labels: written(path.with_name("x_dseg.nii"), (labels / 3).astype(np.float32)),
        "0.3333333",
    ),
    "nearly whole": (
        lambda path, labels: written(path.with_name("x_dseg.nii"), labels + 7014.9 * (labels > 0)),
        "7015.9",
    ),
    "an image": (
        lambda path, labels: written(path, np.arange(labels.size, dtype=np.int32).reshape(labels.shape)),
        "2,000",
    ),
    "tensors in the order of MRtrix": (
        lambda path, _: written(path, np.broadcast_to(np.float32([1, 1, 1, 0.1, 0, 0]), (4, 4, 4, 6))),
        "FILE:mrtrix",
    ),
    "flat": (lambda path, labels: _cut(labels, path, lambda raw: raw[:280] + bytes(48) + raw[328:]), "singular"),
    "cut off": (lambda path, labels: _cut(labels, path, lambda raw: raw[: len(raw) // 2]), "cannot be read"),
    "no type": (lambda path, labels: _cut(labels, path, lambda raw: raw[:70] + b"\x0f\x04" + raw[72:]), "1039"),
    "no place": (lambda path, labels: _without_place(written(path, labels)), "location of its voxels"),
    "CIFTI": (lambda path, _: _cifti(path), "is a CIFTI file"),
    "a text": (lambda path, _: _damaged(path, lambda _: b"index\tname\n"), "cannot be read"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_volume_is_refused(case, tmp_path, labels):
    make, word = BAD[case]
    file = make(tmp_path / "x.nii", labels)
    with pytest.raises(InputError, match=word) as caught:
        read_volume(file)
    assert str(file) in str(caught.value)


def _damaged(path: Path, change: Callable[[bytes], bytes]) -> Path:
    path.write_bytes(change(path.read_bytes() if path.exists() else b""))
    return path


def _cifti(path: Path) -> Path:
    values = nibabel.cifti2.SeriesAxis(0.0, 1.0, 1)
    vertices = nibabel.cifti2.BrainModelAxis.from_surface(np.arange(3), 3, "CIFTI_STRUCTURE_CORTEX_LEFT")
    nibabel.save(nibabel.Cifti2Image(np.ones((1, 3), np.float32), (values, vertices)), path)
    return path


def _without_place(path: Path) -> Path:
    image = nibabel.load(path, mmap=False)
    image.header["sform_code"] = image.header["qform_code"] = 0
    nibabel.save(nibabel.Nifti1Image(np.asarray(image.dataobj), None, image.header), path)
    return path


def volume_of(values: NDArray[np.generic], affine: NDArray[np.float64] = AFFINE) -> dict[str, Volume]:
    return {"tissue": Volume(values, affine, "labels", file="x.nii")}


def test_labels_beside_the_surface_are_refused(ball, labels, caplog):
    """Far away; moved; in a corner; in LPS; flipped. A smaller shift is warned of."""
    backgrounds(volume_of(labels), ball)
    corner = np.zeros_like(labels)
    corner[:3, :3, :3] = 1
    aside, there = half_ball(ball, [3, 6, 0])
    backgrounds(volume_of(there), aside)
    for volume, surface, word in (
        (volume_of(labels, AFFINE + _shift(100)), ball, "100.0%"),
        (volume_of(labels, AFFINE + _shift(12)), ball, "by up to 6.0 mm"),
        (volume_of(labels, AFFINE + _shift(10)), replace(ball, points=0.5 * ball.points), "41%.*100%.*shifted"),
        (volume_of(corner), ball, "cover 0%"),
        (volume_of(there), replace(aside, points=aside.points * [-1, -1, 1]), r"\(the surface is in LPS"),
        (volume_of(np.flip(there)), aside, "flipped"),
    ):
        with pytest.raises(InputError, match=word):
            backgrounds(volume, surface)
    assert not caplog.text
    backgrounds(volume_of(labels, AFFINE + _shift(4)), ball)
    assert "no label" in caplog.text


@pytest.mark.parametrize("kind", ["labels", "numbers", "tensors"])
def test_the_share_of_a_brain_without_a_number_is_measured(ball, labels, kind, caplog):
    """A ball of values around a ball; then both lie aside, opposite each other: nothing of the brain has any."""
    values = np.where(labels > 0, 0.5, 0.0)
    values[:16][labels[:16] == 0] = np.nan

    def empty(values: NDArray[Any], surface: TriSurface) -> float:
        held = values[..., None] * [1.0, 0, 0, 1, 0, 1] if kind == "tensors" else values
        held = np.nan_to_num(2 * values).astype(np.int16) if kind == "labels" else held
        (background,) = backgrounds({"fa": Volume(held, AFFINE, kind, file="fa.nii")}, surface)
        assert background.large == (background.fraction > 0.05)
        return background.fraction

    assert empty(values, replace(ball, points=0.9 * ball.points)) == pytest.approx(0, abs=1e-3) and not caplog.text
    if kind == "labels":
        return  # labels that lie aside are refused
    aside, there = half_ball(ball, [6, 0, 0])
    assert empty(there[::-1] * 0.5, aside) == pytest.approx(1, abs=1e-3)
    assert "fa.nii" in caplog.text and "100.0%" in caplog.text


def _shift(mm: float) -> NDArray[np.float64]:
    shift = np.zeros((4, 4))
    shift[0, 3] = mm
    return shift


def half_ball(ball: TriSurface, centre: list[float]) -> tuple[TriSurface, NDArray[np.int16]]:
    """A ball of half the size around a centre, and its labels."""
    aside = TriSurface(ball.points * 0.5 + centre, ball.faces)
    centres = np.indices((SIZE, SIZE, SIZE)).reshape(3, -1).T @ AFFINE[:3, :3].T + AFFINE[:3, 3]
    return aside, (winding_numbers(aside, centres) > 0.5).reshape(SIZE, SIZE, SIZE).astype(np.int16)


def test_a_lesion_inside_and_labels_all_around_are_no_shift(ball, labels):
    lesion = np.zeros_like(labels)
    lesion[18:22, 14:18, 14:18] = 1
    backgrounds(volume_of(lesion), ball)
    backgrounds(volume_of(np.ones_like(labels)), ball)


# --- on tetrahedra ------------------------------------------------------------------------------------------------


def test_shares_are_those_of_the_volume_inside():
    """A plane at a height z of a corner tetrahedron of size 4 leaves ((4 - z) / 4)^3 above it."""
    plane = np.zeros((8, 8, 50), np.int32)
    plane[:, :, 10:] = 7  # voxels of 0.1 mm along z, from 1.0 mm on
    affine = np.diag([1, 1, 0.1, 1.0])
    affine[:3, 3] = [0.5, 0.5, 0.05]
    found = labels_inside(TET.points, TET.cells, plane, affine)
    assert (found.label[0], found.other[0]) == (0, 7)
    assert found.other_share[0] == pytest.approx(0.75**3, abs=0.02)
    assert found.share[0] == found.zero[0] == pytest.approx(1 - 0.75**3, abs=0.02)


def test_0_is_what_lies_outside_where_labels_cover_the_mesh():
    """The boundary of voxels is not a surface: a tetrahedron that is mostly beyond it still belongs to the tissue."""
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4], [0, 0, -9.0]])
    mesh = TetMesh(points, [[0, 1, 2, 3], [0, 2, 1, 4]])
    values = np.zeros((8, 8, 40), np.int32)
    values[:, :, :30] = 1
    affine = np.diag([1, 1, 0.5, 1.0])
    affine[:3, 3] = [-1, -1, -14.75]  # labels reach to z = 0.5
    found = labels_inside(mesh.points, mesh.cells, np.where(values == 1, 0, 1), affine)
    assert found.label.tolist() == [1, 0]
    labels = {"tissue": Volume(values, affine, "labels", file=__file__)}
    assert with_volumes(mesh, labels)[0].cell_data["tissue"].tolist() == [0, 1]  # a fifth of the mesh has no label
    affine[2, 3] = -13.25  # to z = 2: 4 %
    assert with_volumes(mesh, labels)[0].cell_data["tissue"].tolist() == [1, 1]
    lesion = {"lesion": Volume(np.where(values == 1, 0, 1), affine, "labels", file=__file__)}
    assert with_volumes(mesh, lesion)[0].cell_data["lesion"].tolist() == [0, 0]


def test_numbers_are_means_of_what_has_a_value():
    """The mean of a linear function inside a tetrahedron is its value at the centroid."""
    grid = np.indices((60, 60, 60)) * 0.1 - 0.5
    values = 2 * grid[0] - grid[1] + 3 * grid[2]
    affine = np.diag([0.1, 0.1, 0.1, 1.0])
    affine[:3, 3] = -0.5
    means, empty = means_inside(TET.points, TET.cells, values, affine)
    assert means[0] == pytest.approx(2 - 1 + 3, abs=0.02)
    assert not empty.any()
    values[:] = np.nan
    values[30, 30, 30] = 5.0
    means, empty = means_inside(TET.points + np.array([0, 0, 30]), TET.cells, values, affine)
    assert means.tolist() == [5.0]
    assert empty.tolist() == [True]


@pytest.mark.parametrize("mirrored", [False, True])
def test_tensors_of_fsl_and_mrtrix_are_the_same(mirrored, tmp_path):
    """FSL writes along voxels, x turned round in right-handed ones; MRtrix and we along x, y and z."""
    affine = oblique((1.0, 1.0, 1.0)) @ np.diag([-1.0 if mirrored else 1.0, 1, 1, 1])
    first = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    world = 1e-3 * (0.3 * np.eye(3) + 1.4 * np.outer(first, first))
    axes = affine[:3, :3] @ np.diag([1.0 if mirrored else -1.0, 1, 1])
    along = axes.T @ world @ axes
    shape = (12, 12, 12)
    fsl = np.broadcast_to(along[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], (*shape, 6)).astype(np.float32)
    mrtrix = np.broadcast_to(world[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], (*shape, 6)).astype(np.float32)
    affine[:3, 3] = -affine[:3, :3] @ [6, 6, 6]
    volumes = {
        "fsl": read_volume(written(tmp_path / "fsl.nii", fsl, affine)),
        "mrtrix": read_volume(written(tmp_path / "mrtrix.nii", mrtrix, affine), "mrtrix"),
    }
    mesh, rows = with_volumes(TET, volumes)
    for name in volumes:
        np.testing.assert_allclose(matrices(mesh.cell_data[name])[0], world, atol=1e-8)
    np.testing.assert_allclose(mesh.cell_data["fibre"], [first], atol=1e-5)
    assert [row["kind"] for row in rows] == ["tensors", "tensors"]


def test_the_mean_of_tensors_is_log_euclidean(tmp_path):
    """Of two that differ in scale by 100, the mean of the logarithms is the geometric mean: no swelling."""
    values = np.zeros((2, 1, 1, 6), np.float32)
    values[0, 0, 0, :3], values[1, 0, 0, :3] = 1e-4, 1e-2
    affine = np.diag([100, 100, 100, 1.0])
    affine[0, 3] = -50
    mesh = TetMesh([[-4, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], [[0, 1, 2, 3]])
    volume = Volume(values, affine, "tensors", file=str(written(tmp_path / "t.nii", values, affine)))
    found, _ = with_volumes(mesh, {"tensor": volume})
    share = labels_inside(mesh.points, mesh.cells, np.int32([[[0]], [[1]]]), affine).other_share[0]
    assert 0.3 < share < 0.5
    geometric = 1e-4 * 100**share  # the mean of the tensors themselves would be five times as much
    np.testing.assert_allclose(found.cell_data["tensor"][0], [geometric] * 3 + [0] * 3, rtol=1e-4, atol=1e-9)


# --- in a sheet, and in a mesh ------------------------------------------------------------------------------------


def test_a_sheet_names_volumes_and_a_scan_finds_them(tmp_path, labels):
    anat = tmp_path / "dhcp" / "sub-CC1" / "ses-1" / "anat"
    anat.mkdir(parents=True)
    (anat / "sub-CC1_ses-1_hemi-left_wm.surf.gii").touch()
    written(anat / "sub-CC1_ses-1_desc-drawem9_dseg.nii.gz", labels)
    (case,) = scan(tmp_path / "dhcp")
    assert case.volumes == {"tissue": str(anat / "sub-CC1_ses-1_desc-drawem9_dseg.nii.gz")}
    (tmp_path / "a").mkdir()
    write_sheet([replace(case, volumes={**case.volumes, "fa": f"{tmp_path}/fa.nii:numbers"})], tmp_path / "a" / "x.tsv")
    (again,) = read_sheet(tmp_path / "a" / "x.tsv")
    assert again.volumes == {**case.volumes, "fa": f"{tmp_path}/fa.nii:numbers"}
    table = read_tsv(tmp_path / "a" / "x.tsv").rename(columns={"volume_fa": "volume_f-a"})
    table.to_csv(tmp_path / "a" / "y.tsv", sep="\t", index=False)
    with pytest.raises(InputError, match="volume_f-a"):
        read_sheet(tmp_path / "a" / "y.tsv")


def test_volumes_from_python(ball, labels, tmp_path):
    file = written(tmp_path / "x_dseg.nii.gz", labels)
    along_y = np.broadcast_to(np.float32([1, 0, 0, 3, 0, 1]) / 1000, (*labels.shape, 6))
    tensors = written(tmp_path / "tensors.nii.gz", along_y)
    made = cortet.mesh(ball, 2.0, volumes={"tissue": file, "tensor": tensors}, progress=False)
    table = made.tissues().query("volume == 'tissue'").set_index("label")
    half = 4 / 3 * np.pi * RADIUS**3 / 2000
    assert table.loc[2, "volume_ml"] == pytest.approx(half, rel=0.03)
    assert table["tetrahedra"].sum() == len(made.cells)
    read = read_mesh(made.save(tmp_path / "x.inp"))
    assert len(read.sets.cells["tissue_2"]) == table.loc[2, "tetrahedra"]
    centre = made.points[made.cells].mean(axis=1)
    clear = (np.abs(centre[:, 1]) > 1) & (np.linalg.norm(centre, axis=1) < RADIUS - 1)
    assert (made.mesh.cell_data["tissue"] == np.where(centre[:, 1] > 0, 2, 1))[clear].all()
    assert main(["convert", str(made.save(tmp_path / "x.vtu")), str(tmp_path / "x.pts")]) == 0
    fibres = np.loadtxt(tmp_path / "x.lon", skiprows=1)
    np.testing.assert_allclose(np.abs(fibres), np.tile([0, 1, 0], (len(made.cells), 1)), atol=1e-6)
    with pytest.raises(InputError, match="region"):
        cortet.mesh(ball, 2.0, volumes={"region": file}, progress=False)
