"""A surface lies where its file says, whichever tool wrote it, and volumes are sampled there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import nibabel
import nibabel.freesurfer.io as freesurfer
import numpy as np
import pytest
from nibabel.freesurfer.mghformat import MGHHeader
from numpy.typing import NDArray
from shapes import ball_mesh, ball_surface
from surface_files import gifti as file_of
from surface_files import metadata, points, system, triangles

from cortet.errors import InputError
from cortet.formats.gifti import read_surface, surface_of
from cortet.formats.volumes import Volume, read_volume, six
from cortet.geometry.nesting import nested
from cortet.meshes import CoordinateFrame, TetMesh
from cortet.solver_files.volumes import backgrounds, with_volumes

UNKNOWN, SCANNER, TALAIRACH = (f"NIFTI_XFORM_{name}" for name in ("UNKNOWN", "SCANNER_ANAT", "TALAIRACH"))
BALL = ball_surface(2, 15.0)
#: where the ball lies in the scanner, mm
CENTRE = np.array([-31.0, 12.0, 47.0])
#: shape and voxel width of the phantom's volumes
SHAPE, WIDTH = (44, 50, 46), np.array([1.0, 0.9, 1.1])
#: the fibres' direction in the scanner
ALONG = np.array([0.6, 0.0, 0.8])
#: 12 parameters, as of talairach.xfm
TO_TALAIRACH = np.array([[1.05, 0.02, -0.01, 2], [0.01, 1.12, 0.1, -15], [0.02, -0.12, 1.18, 20], [0, 0, 0, 1.0]])


def turned(degrees: float, axis: int) -> NDArray[np.float64]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.roll(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), (axis, axis), (0, 1))


def scan(degrees: float = 20.0) -> MGHHeader:
    """The header of a volume around the ball, in FreeSurfer's order of axes and oblique."""
    header = MGHHeader()
    header.set_data_shape(SHAPE)
    header["delta"], header["goodRASFlag"] = WIDTH, 1
    axes = turned(degrees, 0) @ turned(degrees / 2, 2) @ np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    header["Mdc"], header["Pxyz_c"] = axes.T, np.add(CENTRE, [1.0, -2.0, 1.5])
    return header


SCAN = scan()
#: from FreeSurfer's surface RAS to the scanner, by the way that its wiki describes
TO_SCANNER = SCAN.get_vox2ras() @ np.linalg.inv(SCAN.get_vox2ras_tkr())
IN_SCANNER = BALL.points + CENTRE


def mapped(matrix: NDArray[Any], points: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


IN_FREESURFER = mapped(np.linalg.inv(TO_SCANNER), IN_SCANNER)


def volume_geometry() -> dict[str, str]:
    """The metadata of FreeSurfer about its volume."""
    known = dict(zip(("VolGeomWidth", "VolGeomHeight", "VolGeomDepth"), map(str, SHAPE), strict=True))
    for axis, width, direction in zip("XYZ", WIDTH, SCAN["Mdc"], strict=True):
        known[f"VolGeom{axis}size"] = f"{width:f}"
        known |= {f"VolGeom{axis}_{to}": f"{value:f}" for to, value in zip("RAS", direction, strict=True)}
    return known | {f"VolGeomC_{to}": f"{value:f}" for to, value in zip("RAS", SCAN["Pxyz_c"], strict=True)}


def gifti(
    path: Path,
    at: NDArray[Any],
    *systems: tuple[str, str, NDArray[Any]],
    about: Mapping[str, str] | None = None,
    program: str = "",
) -> Path:
    """A GIfTI of the ball at these points, with coordinate systems and metadata of the pointset and of the file."""
    stated = "".join(system(*spaces, " ".join(f"{x:f}" for x in np.ravel(matrix))) for *spaces, matrix in systems)
    arrays = points(at.astype("<f4"), inside=metadata(dict(about or {})) + stated), triangles(BALL.faces)
    path.write_bytes(file_of(metadata({"Provenance": program}), *arrays))
    return path


def own(path: Path, header: MGHHeader = SCAN, valid: str = "1  # volume info valid") -> Path:
    footer = {"head": np.array([2, 0, 20], np.int32), "valid": valid, "filename": "x.mgz"}
    footer |= {"volume": np.array(SHAPE), "voxelsize": WIDTH, "cras": np.array(header["Pxyz_c"])}
    footer |= dict(zip(("xras", "yras", "zras"), np.array(header["Mdc"]), strict=True))
    freesurfer.write_geometry(str(path), IN_FREESURFER, BALL.faces, volume_info=footer)
    return path


FORMS: dict[str, Callable[[Path], Path]] = {
    "own": lambda folder: own(folder / "lh.white"),
    "7.2 with Talairach": lambda folder: gifti(
        folder / "x.surf.gii", IN_FREESURFER, (UNKNOWN, TALAIRACH, TO_TALAIRACH), about=volume_geometry()
    ),
    "7.2 without": lambda folder: gifti(folder / "x.surf.gii", IN_FREESURFER, about=volume_geometry()),
    "7.4": lambda folder: gifti(
        folder / "x.surf.gii", IN_FREESURFER, (UNKNOWN, SCANNER, TO_SCANNER), about=volume_geometry()
    ),
    "to-scanner": lambda folder: gifti(
        folder / "x.surf.gii", IN_SCANNER, (SCANNER, UNKNOWN, np.linalg.inv(TO_SCANNER)), about=volume_geometry()
    ),
}


def phantom() -> dict[str, Volume]:
    """Labels by the octant around the centre, FA that rises along x, and tensors along `ALONG`."""
    affine = SCAN.get_vox2ras()
    where = mapped(affine, np.indices(SHAPE).reshape(3, -1).T) - CENTRE
    labels = 1 + (where > 0) @ [1, 2, 4]
    anisotropy = 0.5 + where[:, 0] / 100
    tensor = six((0.2 * np.eye(3) + 1.5 * np.outer(ALONG, ALONG))[None])
    return {
        "tissue": Volume(labels.reshape(SHAPE).astype(np.int32), affine, "labels"),
        "fa": Volume(anisotropy.reshape(SHAPE), affine, "numbers"),
        "tensor": Volume(np.broadcast_to(tensor[0], (*SHAPE, 6)), affine, "tensors"),
    }


@pytest.mark.parametrize("form", FORMS)
def test_a_subject_of_freesurfer_lies_at_the_same_place_in_every_form(tmp_path, form):
    """The same tetrahedra get the labels, FA and fibres that are known, from an oblique volume."""
    surface = read_surface(FORMS[form](tmp_path))
    to_scanner = surface.frame.to_scanner
    np.testing.assert_allclose(mapped(to_scanner, surface.points), IN_SCANNER, atol=1e-3)
    inside = ball_mesh(2, 14.0)
    placed = TetMesh(mapped(np.linalg.inv(to_scanner), inside.points + CENTRE), inside.cells)
    volumes = phantom()
    backgrounds(volumes, surface)
    fields = with_volumes(placed, volumes, frame=surface.frame)[0].cell_data
    middle = inside.points[inside.cells].mean(axis=1)
    one_octant = (np.sign(inside.points[inside.cells]) == np.sign(inside.points[inside.cells])[:, :1]).all(axis=(1, 2))
    assert one_octant.sum() > 100
    assert np.array_equal(fields["tissue"][one_octant], 1 + (middle[one_octant] > 0) @ [1, 2, 4])
    np.testing.assert_allclose(fields["fa"], 0.5 + middle[:, 0] / 100, atol=3e-3)
    np.testing.assert_allclose(np.abs(fields["fibre"] @ to_scanner[:3, :3].T @ ALONG), 1, atol=1e-5)


def centred(place: list[float], stretch: float = 1.0) -> MGHHeader:
    """The header of a volume elsewhere, or with longer axes."""
    header = scan()
    header["Pxyz_c"], header["Mdc"] = place, header["Mdc"] * stretch
    return header


def stated(*systems: tuple[str, str, Any], **known: Any) -> Callable[[Path], Path]:
    """Makes a GIfTI with some coordinate systems, metadata and provenance."""
    return lambda folder: gifti(folder / "x.surf.gii", IN_FREESURFER, *systems, **known)


def geometry(**changed: str | None) -> Callable[[Path], Path]:
    """Makes a GIfTI whose metadata about the volume differ, or lack something."""
    about = {f"VolGeom{key}": value for key, value in changed.items()}
    known = {key: value for key, value in (volume_geometry() | about).items() if value is not None}
    return stated(about=known)


def with_row(number: int, row: list[float]) -> NDArray[np.float64]:
    """The matrix to the scanner with another row."""
    matrix = TO_SCANNER.copy()
    matrix[number] = row
    return matrix


def shortened(change: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    """Makes a surface of FreeSurfer whose footer is damaged."""

    def made(folder: Path) -> Path:
        path = own(folder / "lh.white")
        path.write_bytes(change(path.read_bytes()))
        return path

    return made


#: a file that says nothing of a place in the scanner, or nothing that can be; cortet warns but of the first three
UNPLACED: dict[str, Callable[[Path], Path]] = {
    "Talairach alone": stated((UNKNOWN, TALAIRACH, TO_TALAIRACH)),
    "a template as a number": stated(("4", "4", np.eye(4))),
    "nothing": stated(),
    "a footer that is not valid": lambda folder: own(folder / "lh.white", valid="0  # volume info invalid"),
    "a footer far away": lambda folder: own(folder / "lh.white", centred([0, 2e4, 0])),
    "moved by Workbench": stated(
        about=volume_geometry(), program="wb_command -surface-apply-affine in.surf.gii c_ras.mat out.surf.gii"
    ),
    # Workbench writes Talairach where a file states no space
    "in a template": stated((TALAIRACH, TALAIRACH, np.eye(4)), about=volume_geometry()),
    "in the scanner": stated((UNKNOWN, UNKNOWN, np.eye(4)), (SCANNER, SCANNER, np.eye(4)), about=volume_geometry()),
    "a matrix of zeros": stated((UNKNOWN, SCANNER, np.zeros((4, 4)))),
    "spaces without names": stated(("", "", TO_SCANNER)),
    "spaces as numbers, a bad last row": stated(("0", "1", with_row(3, [0, 0, 1, 1]))),
    "from the scanner to itself": stated((SCANNER, SCANNER, TO_SCANNER)),
    "no centre": geometry(C_S=None),
    "a comma in a number": geometry(C_R="8,0"),
    "axes of zeros": stated(about=dict.fromkeys(volume_geometry(), "0.0")),
    "a centre far away": geometry(C_A="-10001"),
    "an axis that is no number": geometry(X_R="nan"),
}


@pytest.mark.parametrize("case", UNPLACED)
def test_what_gives_no_place_leaves_the_coordinates_and_is_said(tmp_path, caplog, case):
    path = UNPLACED[case](tmp_path)
    surface = read_surface(path)
    assert np.array_equal(surface.frame.to_scanner, np.eye(4))
    np.testing.assert_allclose(surface.points, IN_FREESURFER, atol=1e-4)
    assert (path.name in caplog.text) == (case not in [*UNPLACED][:3])
    space = {"a template as a number": "NIFTI_XFORM_MNI_152", "in the scanner": SCANNER}.get(case)
    assert surface.frame.dataspace == space or not space, "a space that is not followed is kept"


#: a file whose place cannot be
WRONG: dict[str, Callable[[Path], Path]] = {
    "a last row": stated((UNKNOWN, SCANNER, with_row(3, [0, 0, 1, 1]))),
    "a space of its own": stated(("MY_SPACE", SCANNER, np.eye(4))),
    "far from the scanner": stated((UNKNOWN, SCANNER, with_row(1, [*TO_SCANNER[1, :3], 2e4]))),
    "axes that are no rotation": lambda folder: own(folder / "lh.white", centred([0, 0, 0], 1.1)),
    "mirrored axes": geometry(**{f"X_{to}": str(-float(volume_geometry()[f"VolGeomX_{to}"])) for to in "RAS"}),
    "there and back": stated((SCANNER, UNKNOWN, np.linalg.inv(TO_SCANNER)), (UNKNOWN, SCANNER, TO_SCANNER)),
    "two ways": stated((UNKNOWN, SCANNER, TO_SCANNER), (TALAIRACH, SCANNER, SCAN.get_vox2ras_tkr())),
    "a footer cut short": shortened(lambda data: data[:-30]),
    "a centre of two numbers": shortened(lambda data: data[: data.index(b"cras")] + b"cras   = 1.0 2.0\n"),
    "half as large": stated((UNKNOWN, SCANNER, np.diag([0.5, 0.5, 0.5, 1]))),
    "half as large as a template": stated((UNKNOWN, TALAIRACH, np.diag([0.5, 0.5, 0.8, 1]))),
    "mirrored": stated((UNKNOWN, SCANNER, np.diag([-1.0, 1, 1, 1]))),
    "sheared": stated((SCANNER, "NIFTI_XFORM_ALIGNED_ANAT", [[1, 0.3, 0, 0], *np.eye(4)[1:].tolist()])),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_place_that_cannot_be_is_refused(tmp_path, case):
    path = WRONG[case](tmp_path)
    with pytest.raises(InputError, match=path.name):
        read_surface(path)


@pytest.mark.parametrize("form", ["7.2 without", "7.4", "to-scanner"])
def test_an_image_of_nibabel_lies_where_its_file_does(tmp_path, form):
    path = FORMS[form](tmp_path)
    assert surface_of(nibabel.load(path)).frame == read_surface(path).frame


@pytest.mark.parametrize(("shift", "said"), [(0.3, False), (4.0, True)])
def test_an_image_that_is_placed_in_two_ways_says_which_is_taken(tmp_path, caplog, shift, said):
    image = nibabel.Nifti1Image(np.ones((4, 5, 6), np.float32) / 3, np.eye(4))
    elsewhere = np.eye(4)
    elsewhere[0, 3] = shift
    image.set_sform(elsewhere, 2)
    image.set_qform(np.eye(4), 1)
    nibabel.save(image, tmp_path / "x.nii")
    assert read_volume(tmp_path / "x.nii").affine[0, 3] == pytest.approx(shift)
    assert ("sform" in caplog.text) == said


@pytest.mark.parametrize("form", FORMS)
def test_surfaces_in_different_spaces_are_not_nested(tmp_path, form):
    """A pial surface in the scanner and a white one in FreeSurfer's axes would be off by the place of the volume."""
    surface = read_surface(FORMS["to-scanner"](tmp_path))
    (tmp_path / "inner").mkdir()
    inner = read_surface(FORMS[form](tmp_path / "inner"))
    if form == "to-scanner":
        assert list(nested(surface, {"white": inner}).inner) == ["white"]
        return
    with pytest.raises(InputError, match=r"white .*space.* \d+\.\d mm"):
        nested(surface, {"white": inner})
    unplaced = replace(surface, frame=CoordinateFrame())  # they are taken as they stand
    assert list(nested(unplaced, {"white": inner}).inner) == ["white"]
