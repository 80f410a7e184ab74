"""The Python call: surfaces from whatever holds one, meshes, folds and what a notebook shows of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import nibabel as nib
import numpy as np
import pytest
import pyvista
from shapes import ball_mesh, ball_surface

import cortet
from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.certificates import sealed
from cortet.formats.gifti import write_fields, write_surface
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import Certificate
from cortet.meshes import TriSurface
from cortet.solver_files.meshed import cell_size_of
from cortet.solver_files.sidecar import sidecar_path

COARSE = 2.5


@pytest.fixture(scope="module")
def ball() -> TriSurface:
    """A ball of 10 mm."""
    return boundary_surface(ball_mesh(3, radius=10.0))[0]


@pytest.fixture(scope="module")
def made(ball: TriSurface) -> cortet.Mesh:
    return cortet.mesh(ball, cell_size=COARSE, ga=24, fields={"height": ball.points[:, 2]}, progress=False)


def holders(surface: TriSurface, folder: Path) -> dict[str, Any]:
    """The same surface in everything that may hold one."""
    file = folder / "ball.surf.gii"
    write_surface(surface, file)
    return {
        "path": file,
        "text": str(file),
        "nibabel": nib.load(file),
        "pyvista": pyvista.PolyData.from_regular_faces(surface.points, surface.faces),
        "arrays": (surface.points, surface.faces),
        "lists": [surface.points.tolist(), surface.faces.tolist()],
        "trimesh": type("Trimesh", (), {"vertices": surface.points, "faces": surface.faces})(),
        "own": surface,
    }


@pytest.mark.parametrize("size", [0, -1.0, True, "3", [3.0], float("nan"), 21.0])
def test_what_is_no_cell_size_is_refused_for_a_given_mesh_too(made, monkeypatch, size):
    monkeypatch.setattr("cortet.api.files.improved", None)  # before any stage
    with pytest.raises(InputError, match="the cell size in mm is"):
        cortet.improve(made, cell_size=size, progress=False)


def test_certify_takes_the_cell_size_that_a_mesh_was_made_with(tmp_path):
    surface = ball_surface(3, radius=14.0)
    made = cortet.mesh(surface, cell_size=4.0, progress=False)
    made.save(tmp_path / "x.vtu")

    def limits(found: Certificate) -> dict[str, object]:
        return {check.id: check.limit for check in found.checks if check.id == "surface_distance"}

    scaled = limits(cortet.certify(made.mesh, made.surface, cell_size=4.0))
    assert scaled and None not in scaled.values()
    assert limits(cortet.certify(made, made.surface)) == scaled
    assert limits(cortet.certify(tmp_path / "x.vtu", made.surface)) == scaled
    again = sealed(asdict(cortet.certify(tmp_path / "x.vtu")))  # as `cortet certify -o` writes it
    (tmp_path / "x.certificate.json").write_text(json.dumps(again))
    assert limits(cortet.certify(tmp_path / "x.vtu", made.surface)) == scaled, "checked again, it keeps its limits"
    of_workflow = (tmp_path / "x.vtu").rename(tmp_path / "sub-a_desc-latticeOrdered_tetmesh.vtu")
    (tmp_path / "x.certificate.json").rename(tmp_path / "sub-a_desc-latticeSolver_certificate.json")
    assert limits(cortet.certify(of_workflow, made.surface)) == scaled
    assert set(limits(cortet.certify(made.mesh, made.surface)).values()) == {None}


def test_a_surface_may_come_from_anything_that_holds_one(ball, tmp_path):
    for name, held in holders(ball, tmp_path).items():
        found = cortet.surface(held)
        assert np.array_equal(found.faces, ball.faces), name
        assert found.points == pytest.approx(ball.points, abs=1e-5), name


FLAT = (np.zeros((3, 3)), [[0, 1, 7]])
BALL = ball_surface()


def meshed(**more: Any) -> Callable[[cortet.Mesh], Any]:
    return lambda _: cortet.mesh(BALL, 6.0, progress=False, **more)


#: a call with a mesh of a ball, and a keyword of why it is refused
REFUSED: list[tuple[Callable[[cortet.Mesh], Any], str]] = [
    # no surface
    (lambda _: cortet.surface(3.0), "type float"),
    (lambda _: cortet.surface(nib.GiftiImage()), "image"),
    (lambda _: cortet.surface(pyvista.Plane()), "triangulate"),
    (lambda _: cortet.surface(pyvista.PolyData()), "no faces"),
    (lambda _: cortet.surface(FLAT), "from 0 to 2"),
    (lambda _: cortet.surface(np.zeros((4, 3))), "ndarray"),
    # nothing that a mesh can be made with
    (meshed(hemi="X"), "'X' is not a hemisphere"),
    *((meshed(ga=age), "gestational age") for age in ("28", "28 weeks", True)),
    *((meshed(inner={name: BALL}), "inner surface") for name in (1, "a b/c")),
    (meshed(volumes={1: "dseg.nii.gz"}), "a volume"),
    (meshed(volumes={"t": np.zeros((4, 4, 4))}), "the volume t"),
    *((meshed(fields={"a": values}), "the field a: the type") for values in (3.0, np.zeros((642, 2, 2)), ["x"] * 642)),
    (meshed(fields={"a": np.zeros(642, complex)}), "complex128"),
    (meshed(fields={"a": np.full(642, np.nan)}), "642 vertices, the first is vertex 0"),
    (meshed(fields={"a": np.ma.masked_equal(np.arange(642), 7)}), "the field a"),
    (lambda _: cortet.mesh(replace(BALL, point_data={"a": np.full(642, np.nan)}), 6.0), "642 vertices"),
    # the value below a mask may be anything
    (
        lambda _: cortet.surface((np.ma.masked_equal(np.arange(9.0).reshape(3, 3), 4), [[0, 1, 2]])),
        "1 value of points",
    ),
    # nothing that can be done with a mesh
    *(
        (lambda made, size=size: made.plot(size), "pixels")
        for size in ((0, 0), (-3, 5), (3.5, 2), (100_000, 5), (1, 2, 3), 5, "big")
    ),
    (lambda made: cortet.certify(None, made.surface), "NoneType"),  # type: ignore[arg-type]
    (lambda made: cortet.growth(made.surface, made.surface, ages=(24,)), "later age"),  # type: ignore[arg-type]
    # nothing that can be folded, or not at this age
    (lambda made: cortet.fold(made, 30), "24 weeks, not 30"),
    (lambda made: cortet.fold(made, hemi="left"), "'left' is not a hemisphere"),  # type: ignore[arg-type]
    (lambda made: cortet.fold(made, "24"), "'24', not a number"),  # type: ignore[arg-type]
    (lambda made: cortet.fold(made.mesh), "age of the mesh is not known"),
    (lambda made: cortet.fold(made, thickness=-1.0), "fold"),
    (lambda made: cortet.fold(made, folder=__file__), "is a file"),
    (lambda _: cortet.fold("nowhere.vtu"), "nowhere.vtu"),
]


@pytest.mark.parametrize(("call", "keyword"), REFUSED)
def test_a_call_refuses_what_it_cannot_do(made, call, keyword):
    with pytest.raises(InputError, match=keyword):
        call(made)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-3), ("cm", 0.1), ("um", 1e3)])
def test_coordinates_that_are_not_mm_are_refused_at_every_door(unit, factor, tmp_path):
    """Mesh and surface alike in cm were certified: only the lengths of the certificate were wrong."""
    mesh = ball_mesh(2, radius=10.0)
    mesh = replace(mesh, points=mesh.points * factor)
    surface = boundary_surface(mesh)[0]
    vtu.write(mesh, tmp_path / "x.vtu")
    doors: list[Callable[[], Any]] = [
        lambda: cortet.certify(tmp_path / "x.vtu", surface),
        lambda: cortet.read(tmp_path / "x.vtu", surface),
        lambda: cortet.improve(mesh, surface, progress=False),
        lambda: cortet.repair(surface),
        lambda: cortet.growth(surface, surface, (24, 28)),
    ]
    for door in doors:
        with pytest.raises(InputError, match="mm long") as caught:
            door()
        assert f"in {unit}, " in caught.value.remedy


def test_a_surface_in_other_units_than_its_mesh_is_refused_without_advice_on_cells(made, tmp_path):
    made.save(tmp_path / "x.vtu")
    small = replace(made.surface, points=made.surface.points * 0.1)
    with pytest.raises(InputError, match="elsewhere"):
        cortet.certify(tmp_path / "x.vtu", small)


def test_a_mesh_of_a_mouse_is_certified_where_its_unit_is_stated():
    mesh = ball_mesh(2, radius=4.0)
    settings = {"gate": {"unit": "mm"}}
    assert cortet.certify(mesh, boundary_surface(mesh)[0], settings=settings).checks


def test_an_image_in_memory_is_a_volume_as_its_file_is(ball, tmp_path):
    labels = np.full((16, 16, 16), 3, np.int16)
    image = nib.Nifti1Image(labels, np.diag([2.0, 2, 2, 1]) + np.array([[0, 0, 0, -15.0]] * 3 + [[0] * 4]))
    nib.save(image, file := tmp_path / "tissue_dseg.nii.gz")
    (tmp_path / "dseg.tsv").write_text("index\tname\n3\tgrey\n")
    tables = [
        cortet.mesh(ball, 4.0, volumes={"tissue": given}, progress=False).tissues()
        for given in (file, nib.load(file), image)
    ]
    assert tables[0].equals(tables[1]) and list(tables[0]["name"]) == ["grey"]
    assert list(tables[2]["tetrahedra"]) == list(tables[0]["tetrahedra"])  # a file of its own names its labels


def test_arrays_with_a_coordinate_that_is_not_finite_are_repaired_as_their_file_is(ball, caplog):
    points = ball.points.copy()
    points[5, 1] = np.nan
    assert cortet.mesh((points, ball.faces), COARSE, progress=False).certified
    assert "1 vertex without finite coordinates removed" in caplog.text
    with pytest.raises(InputError, match="have coordinates that are not finite"):
        cortet.mesh((points, ball.faces), 6.0, settings={"repair": {"enabled": False}}, progress=False)


def test_a_field_and_a_sphere_may_be_files(ball, tmp_path):
    """The sidecar names the file of the field, as that of the command does; through the sphere vertices correspond."""
    sphere = replace(ball, points=100 * ball.points / np.linalg.norm(ball.points, axis=1, keepdims=True))
    write_surface(sphere, tmp_path / "ball.sphere.gii")
    write_surface(ball_surface(4, radius=100.0), tmp_path / "common_L.sphere.gii")
    write_fields({"height": ball.points[:, 2]}, tmp_path / "height.shape.gii")
    made = cortet.mesh(
        ball,
        COARSE,
        fields={"height": tmp_path / "height.shape.gii"},
        sphere=tmp_path / "ball.sphere.gii",
        hemi="L",
        settings={"resample": {"template": str(tmp_path / "common_{hemi}.sphere.gii")}},
        progress=False,
    )
    assert np.corrcoef(made.mesh.point_data["height"], made.points[:, 2])[0, 1] > 0.95
    assert len(made.surface.points) == len(ball_surface(4).points)
    made.save(tmp_path / "ball.vtu")
    assert "height.shape.gii" in (tmp_path / "ball.vtu.json").read_text()
    assert {file.name for file in made.inputs} == {"height.shape.gii", "ball.sphere.gii"}  # never overwritten


def test_a_mesh_has_its_arrays_its_certificate_and_its_fields(made):
    assert made.certified and made.certificate.quality.q.max == pytest.approx(made.quality.max())
    assert made.cells.shape[1] == 4 and made.points.shape[1] == 3
    assert np.corrcoef(made.mesh.point_data["height"], made.points[:, 2])[0, 1] > 0.95
    checks = made.checks()
    assert checks["passed"].all() and len(checks) == len(made.certificate.checks)
    assert f"{len(made.cells):,} tetrahedra\n worst q 0." in repr(made) and "certified" in repr(made)


def test_a_masked_label_is_nan_on_the_surface_and_no_other_is_averaged(made):
    """An integer array with a mask was "Cannot convert fill_value nan to dtype int64"."""
    labels = np.where(made.points[:, 2] > 0, 7, 3)
    far = made.points[:, 0] > 5
    found = made.to_surface(np.ma.masked_array(labels, far))
    whole = made.to_surface(labels)
    assert np.isnan(found).any() and set(found[np.isfinite(found)]) == {3.0, 7.0}
    assert np.array_equal(found[np.isfinite(found)], whole[np.isfinite(found)])
    assert np.isnan(made.to_surface(np.ma.masked_array(made.points[:, 2] > 0, far))).any()
    assert np.array_equal(made.to_surface(np.ma.masked_array(labels, False)), whole)


def test_a_file_with_its_sidecar_finds_the_way_back_to_its_surface(ball, tmp_path):
    """`to_surface` of a mesh that was read said: there is no surface '' (name one of none)."""
    write_surface(ball, source := tmp_path / "ball.surf.gii")
    made = cortet.mesh(source, COARSE, progress=False)
    read = cortet.read(made.save(tmp_path / "x.vtu"))
    height = made.points[:, 2]
    assert np.allclose(read.to_surface(height), made.to_surface(height), atol=1e-9)
    assert np.allclose(made.to_surface(height), ball.points[:, 2], atol=0.5)
    with pytest.raises(InputError, match="no surface 'white'.*name one of"):
        read.to_surface(height, region="white")
    write_surface(TriSurface(ball.points * 1.1, ball.faces), source)  # not the surface that was meshed
    with pytest.raises(InputError, match="the surface of the mesh is not known"):
        cortet.read(tmp_path / "x.vtu").to_surface(height)


def test_the_same_call_gives_the_same_bits(ball, made):
    again = cortet.mesh((ball.points, ball.faces), COARSE, ga=24, settings={"generate": {"meshers": ["lattice"]}})
    assert again.points.tobytes() == made.points.tobytes() and again.cells.tobytes() == made.cells.tobytes()


def test_no_file_of_others_is_replaced_unless_forced_and_no_input_ever(ball, tmp_path):
    source = tmp_path / "ball.surf.gii"
    write_surface(ball, source)
    made = cortet.mesh(source, COARSE, progress=False)
    theirs = tmp_path / "theirs.vtu"
    theirs.write_text("mine")
    with pytest.raises(InputError, match="is not a file of cortet"):
        made.save(theirs)
    assert theirs.read_text() == "mine"
    made.save(theirs, force=True)
    assert len(vtu.read(theirs).cells) == len(made.cells)


def test_a_mesh_that_is_not_certified_says_so_in_its_name_and_when_it_is_folded(ball, tmp_path, caplog):
    strict = cortet.mesh(ball, COARSE, settings={"certify": {"q_max": 0.01}}, progress=False)
    assert not strict.certified and "NOT certified" in repr(strict)
    for force in (False, True):
        with pytest.raises(InputError, match="not certified.*uncertified=True"):
            strict.save(tmp_path / "x.vtu", force=force)
    saved = strict.save(tmp_path / "x.vtu", uncertified=True)
    assert saved.name == "x_uncertified.vtu" and saved.exists() and not (tmp_path / "x.vtu").exists()
    with pytest.raises(InputError, match="not certified.*x_uncertified.inp"):
        cortet.convert(saved, tmp_path / "x.inp")
    cortet.convert(saved, tmp_path / "x_uncertified.inp")
    for one in (strict, saved):
        with pytest.raises(InputError, match="age of the mesh is not known"):
            cortet.fold(one)
        (warning,) = caplog.messages
        assert warning.startswith("the mesh that is folded is not certified: worst q")
        caplog.clear()
    cortet.mesh(ball, COARSE, progress=False).save(tmp_path / "x.vtu")
    left = {path.name for path in tmp_path.glob("x*")}
    converted = {"x_uncertified.inp", "x_uncertified.inp.json"}
    assert left == {"x.vtu", "x.vtu.json", "x.certificate.json", "x.meshed.surf.gii", *converted}


@pytest.mark.parametrize("edit", [lambda text: text.replace("true", "false", 1), lambda text: text[:500]])
def test_a_mesh_whose_certificate_was_edited_is_not_converted_as_if_it_had_none(made, tmp_path, edit):
    """Whoever cut the failed check out of a certificate, or cut it off, got a mesh whose name says nothing."""
    saved = made.save(tmp_path / "x.vtu")
    file = tmp_path / "x.certificate.json"
    file.write_text(edit(file.read_text()))
    with pytest.raises(InputError, match="damaged or edited.*x2_uncertified.inp"):
        cortet.convert(saved, tmp_path / "x2.inp")


def test_a_mesh_folds_from_the_age_it_was_made_at(made, tmp_path):
    said: list[float] = []
    small = {"thickness": 3.0, "force": True}
    folded = cortet.fold(made, end=24.2, progress=lambda row, part, _: said.append(part), **small)
    assert folded.verdict["outcome"] == "folded" and said[-1] == 1
    assert folded.table["gestational_age"].iloc[[0, -1]].tolist() == pytest.approx([24, 24.2])
    assert folded.at(24.2).points.max() > made.points.max()  # it has grown
    assert "no element inverted" in folded._repr_html_()
    assert ", 0.0% of the tetrahedra distorted" in repr(folded)  # it ended with AttributeError: 'Series' has no 'q_max'
    kept = cortet.fold(made, folder=tmp_path / "run", end=24.1, progress=False, **small)
    assert (kept.folder / "fold.tsv").exists()
    saved = made.save(tmp_path / "made.inp")
    read = cortet.fold(saved, end=24.1, progress=False, **small)
    assert read.table["gestational_age"].iloc[0] == pytest.approx(24) and read.hemi == made.hemi
    with pytest.raises(InputError, match="24 weeks according to its sidecar, not 30"):
        cortet.fold(saved, 30)
    of_another = tmp_path / "of_another.inp"
    of_another.write_text(saved.read_text() + "**\n")
    sidecar_path(of_another).write_text(sidecar_path(saved).read_text())
    with pytest.raises(InputError, match="age of the mesh is not known"):
        cortet.fold(of_another)


def test_a_page_replaces_no_file_of_the_user(ball, tmp_path):
    write_surface(ball, tmp_path / "ball.surf.gii")
    made = cortet.mesh(tmp_path / "ball.surf.gii", cell_size=5.0, progress=False)
    (tmp_path / "mine.html").write_text("mine")
    for name in ("ball.surf.gii", "mine.html", "p.txt"):
        with pytest.raises(InputError):
            made.page(tmp_path / name)
    assert (tmp_path / "mine.html").read_text() == "mine"
    made.page(tmp_path / "p.html")
    made.page(tmp_path / "p.html")
    made.page(tmp_path / "mine.html", force=True)


def test_a_certificate_of_another_mesh_of_the_same_name_gives_no_cell_size(ball, tmp_path):
    write_surface(ball, tmp_path / "ball.surf.gii")
    for size, name in ((3.5, "y.vtu"), (3.0, "y.inp")):
        cortet.mesh(tmp_path / "ball.surf.gii", size, progress=False).save(tmp_path / name, force=True)
    assert cell_size_of(tmp_path / "y.inp") == 3.0 and cell_size_of(tmp_path / "y.vtu") is None
