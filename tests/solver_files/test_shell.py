"""The space around the brain as a region, and regions as holes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from shapes import ball_surface, horseshoe

import cortet
from cortet.cli import main
from cortet.config import load
from cortet.errors import InputError
from cortet.formats import FORMATS, read_mesh, require_holes, vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.volumes import write_volume
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.envelope import envelope
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_faces, enclosed_volume, face_normals, surface_topology
from cortet.measure.quality import signed_volumes
from cortet.meshes import TriSurface, region_names
from cortet.solver_files.holes import regions_of
from cortet.solver_files.label_surfaces import with_shell
from cortet.solver_files.sets import with_regions

H = 2.0


@pytest.fixture(scope="module")
def made() -> cortet.Mesh:
    """A white ball of 7 mm in a pial one of 10 mm, in a shell of 3 mm."""
    pial, white = ball_surface(4, radius=10.0), ball_surface(4, radius=7.0)
    return cortet.mesh(pial, H, inner={"white": white}, shell=3.0, progress=False)


def test_an_envelope_of_a_ball_is_a_ball():
    around = envelope([ball_surface(4, radius=10.0)], 2.0)
    radius = np.linalg.norm(around.points, axis=1)
    assert radius.min() > 11.95 and radius.max() < 12.4
    assert enclosed_volume(around.points, around.faces) > 0
    assert surface_topology(around.faces).euler_number == 2


def test_an_envelope_spans_a_groove_and_stays_away_from_both_sides():
    bent = horseshoe(2.0)
    around = envelope([bent], 1.0, closing=4.0)
    assert surface_topology(around.faces).euler_number == 2 and not len(self_intersections(around))
    assert closest_points(tree_of(bent), around.points).distances.min() >= 0.998
    assert enclosed_volume(around.points, around.faces) > 1.5 * enclosed_volume(bent.points, bent.faces)


def test_an_envelope_holds_two_bodies_and_refuses_those_too_far_apart():
    left = ball_surface(3, radius=5.0)
    right = TriSurface(left.points + np.array([11.0, 0, 0]), left.faces)
    around = envelope([left, right], 1.0)
    for one in (left, right):
        assert closest_points(tree_of(one), around.points).distances.min() >= 0.998
    far = TriSurface(left.points + np.array([300.0, 0, 0]), left.faces)
    with pytest.raises(InputError, match="cannot enclose the 2 surfaces"):
        envelope([left, far], 1.0)


def test_region_0_is_named_after_what_lies_in_it_and_no_two_share_a_name():
    """Abaqus and others do not tell upper from lower case."""
    for inner, names in (
        (["white"], ["cortex", "white"]),
        (["cortex", "white"], ["csf", "cortex", "white"]),
        (["cortexL", "cortexR"], ["csf", "cortexL", "cortexR"]),
        (["csf", "brain"], ["skull", "csf", "brain"]),
    ):
        assert region_names(inner) == names
    for inner, name in (
        (["csf", "white"], "csf"),
        (["white", "WHITE"], "WHITE"),
        (["Cortex"], "Cortex"),
        (["white", "CSF", "cortexL"], "CSF"),
        (["core", "white"], "core"),
    ):
        with pytest.raises(InputError, match=name):
            region_names(inner)


def test_a_hole_is_the_surface_of_its_name_or_else_the_pieces_of_a_label():
    assert regions_of("deep", ["white", "deep", "deep2"]) == ["deep"]
    assert regions_of("deep", ["white", "deep1", "deep2", "deeper"]) == ["deep1", "deep2"]
    assert regions_of("deep", ["white", "deep2"]) == []


def test_holes_and_formats_that_cannot_tell_them_are_refused_together():
    for name, form in FORMATS.items():
        require_holes([], name)
        if form.names_faces:
            require_holes(["ventricle"], name)
        else:
            with pytest.raises(InputError, match=f"{form.suffix}.*ventricle"):
                require_holes(["ventricle"], name)
    config = load({"export": {"formats": ["vtu", "stl"], "holes": ["ventricle"]}})
    with pytest.raises(InputError, match=r"\.stl.*ventricle"):
        config.require_workflow()


def test_the_shell_is_a_certified_region_around_the_cortex(made):
    assert made.certified
    regions = {one.name: one for one in made.certificate.regions}
    assert list(regions) == ["csf", "cortex", "white"]
    pial, white = (4 / 3 * np.pi * radius**3 / 1000 for radius in (10, 7))
    assert regions["white"].volume_ml == pytest.approx(white, rel=0.08)
    assert regions["cortex"].volume_ml == pytest.approx(pial - white, rel=0.08)
    assert regions["csf"].volume_ml > 4 / 3 * np.pi * 13**3 / 1000 - pial
    assert [(one.name, one.around) for one in made.certificate.interfaces] == [("cortex", "csf"), ("white", "cortex")]


def test_a_brain_without_a_white_surface_has_a_cortex_by_depth(tmp_path):
    made = cortet.mesh(ball_surface(4, radius=10.0), H, shell=3.0, progress=False)
    assert made.certified and [one.name for one in made.certificate.regions] == ["csf", "brain"]
    mesh = vtu.read(made.save(tmp_path / "m.vtu"))
    centre = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    sets = mesh.sets.cells
    assert centre[sets["cortex"]].min() > 8.0 and centre[sets["csf"]].min() > 9.5 and centre[sets["core"]].max() < 8.8
    assert np.array_equal(np.sort(np.concatenate([sets["cortex"], sets["core"]])), sets["brain"])
    assert np.array_equal(
        with_regions(mesh, ["brain"]).cell_data["region"] == 2, np.isin(np.arange(len(centre)), sets["brain"])
    )


def test_fields_of_the_brain_go_with_it_and_its_labels_are_faces_of_it(tmp_path):
    ball = ball_surface(4, radius=10.0)
    upper = (ball.points[:, 2] > 0).astype(np.int32)
    made = cortet.mesh(
        ball, H, inner={"white": ball_surface(4, radius=7.0)}, shell=3.0, fields={"half": upper}, progress=False
    )
    mesh = vtu.read(made.save(tmp_path / "m.vtu"))
    faces = mesh.points[mesh.sets.faces["half_1"]]
    assert np.abs(np.linalg.norm(faces, axis=2) - 10).max() < 0.3 and faces.mean(axis=1)[:, 2].min() > -H
    assert set(mesh.sets.cells["half_1"]) < set(mesh.sets.cells["cortex"])


def test_coordinates_in_metres_get_a_shell_in_mm():
    ball = ball_surface(3, radius=10.0)
    metres = TriSurface(ball.points / 1000, ball.faces)
    to_mm = np.diag([1000.0, 1000, 1000, 1]).tolist()
    outer = with_shell(metres, 3.0, to_mm)
    assert np.linalg.norm(outer.points, axis=1).min() == pytest.approx(0.013, rel=0.08)
    assert outer.inner["brain"].points is not None and list(outer.inner) == ["brain"]


def test_a_volume_of_the_brain_alone_is_in_place_within_a_shell(tmp_path):
    ball = ball_surface(4, radius=10.0)
    inside = np.linalg.norm(np.indices((21, 21, 21)) - 10, axis=0) < 10
    affine = np.eye(4)
    affine[:3, 3] = -10
    write_volume(inside.astype(np.int16), affine, tmp_path / "dseg.nii.gz")
    volumes = {"tissue": tmp_path / "dseg.nii.gz"}
    made = cortet.mesh(ball, H, shell=3.0, volumes=volumes, progress=False)
    rows = made.tissues().set_index("label")
    assert rows.loc[1, "volume_ml"] == pytest.approx(4 / 3 * np.pi, rel=0.1)
    write_volume(inside.astype(np.int16), affine + 6 * np.eye(4, k=3), tmp_path / "dseg.nii.gz")
    with pytest.raises(InputError, match="outside the volume|shifted"):
        cortet.mesh(ball, H, shell=3.0, volumes=volumes, progress=False)


def test_what_a_shell_does_not_go_with_is_said(made):
    with pytest.raises(InputError, match="cortex"):
        with_shell(nested(ball_surface(3, radius=9), {"cortex": ball_surface(3)}), 2.0)
    with pytest.raises(InputError, match="csf"):
        cortet.fold(made, ga=24, progress=False)
    with pytest.raises(InputError, match="0.1"):
        cortet.mesh(ball_surface(3), H, shell=0.1)


def test_the_command_makes_shell_hole_and_records_and_checks_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, radius in (("pial", 10.0), ("white", 8.5), ("ventricle", 6.0)):
        write_surface(ball_surface(4, radius=radius), tmp_path / f"{name}.surf.gii")
    inner = "--inner white.surf.gii --inner ventricle=ventricle.surf.gii"

    def command(words: str) -> int:
        return main(words.replace("MESH", f"mesh pial.surf.gii {inner} --cell-size 2 --shell 3").split())

    def refused(words: str, word: str) -> bool:
        """Before any work, of which the command would print something."""
        capsys.readouterr()
        code, said = command(words), capsys.readouterr()
        return code == 1 and word in said.err and not said.out

    assert command("MESH -o head.vtu") == command("MESH --hole ventricle -o hollow.vtu") == 0
    assert command("certify head.vtu") == command(f"certify head.vtu pial.surf.gii {inner}") == 0
    assert refused("fold head.vtu --ga 24 -o fold", "csf")
    assert refused("MESH --hole tumour -o other.vtu", "tumour")
    assert refused("MESH --hole ventricle -o hollow.stl", ".stl")
    for words in ("certify hollow.vtu", "fold hollow.vtu --ga 24 -o f", "quadratic hollow.vtu -o q.vtu"):
        assert refused(words, "entire mesh")

    whole, hollow = vtu.read(tmp_path / "head.vtu"), vtu.read(tmp_path / "hollow.vtu")
    assert len(whole.cells) - len(hollow.cells) == len(whole.sets.cells["ventricle"])
    lost = signed_volumes(whole.points, whole.cells).sum() - signed_volumes(hollow.points, hollow.cells).sum()
    assert lost == pytest.approx(4 / 3 * np.pi * 6.0**3, rel=0.09)
    assert "ventricle" not in hollow.sets.cells and "ventricle_interface" not in hollow.sets.faces
    wall = hollow.sets.faces["hole_surface"]
    inwards = np.einsum("kj,kj->k", face_normals(hollow.points, wall), hollow.points[wall].mean(axis=1))
    assert (inwards < 0).all()  # outward of the mesh is into the hole
    assert len(wall) + len(hollow.sets.faces["outer_surface"]) == len(boundary_faces(hollow))
    assert json.loads((tmp_path / "hollow.vtu.json").read_text())["made_from"]["holes"] == ["ventricle"]
    for name, form in FORMATS.items():
        done = command(f"convert hollow.vtu other{form.suffix}")
        assert done == (name in ("braingrowth", "stl", "gifti")), name  # which cannot tell a hole from a void


def test_an_envelope_from_the_command_is_the_outer_surface_of_two_halves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for side, x in (("L", -6.0), ("R", 6.0)):
        ball = ball_surface(4, radius=5.0)
        write_surface(TriSurface(ball.points + np.array([x, 0, 0]), ball.faces), tmp_path / f"{side}.surf.gii")
    command = "envelope L.surf.gii R.surf.gii --distance 2 -o skull.surf.gii"
    assert main(command.split()) == 0
    skull = read_surface("skull.surf.gii")
    assert enclosed_volume(skull.points, skull.faces) > 2000
    with pytest.raises(SystemExit):
        main(["envelope", "L.surf.gii", "-o", "skull.vtu"])
    command = "mesh skull.surf.gii --inner cortexL=L.surf.gii --inner cortexR=R.surf.gii --cell-size 1.5 -o head.inp"
    assert main(command.split()) == 0
    sets = read_mesh(tmp_path / "head.inp").sets.cells
    assert {"csf", "cortex", "cortexL", "cortexR"} <= sets.keys()
    assert len(sets["cortexL"]) + len(sets["cortexR"]) == len(sets["cortex"])
    assert main(["convert", "head.inp", "head.vtu"]) == 0, "Abaqus has no sets of faces"
    assert read_mesh(tmp_path / "head.vtu").sets.faces.keys() == {"outer_surface"}
