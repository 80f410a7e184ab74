"""The space around the brain as a region, and regions as holes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.config import load
from cortet.errors import InputError
from cortet.formats import FORMATS, require_holes, vtu
from cortet.formats.gifti import write_surface
from cortet.formats.volumes import write_volume
from cortet.geometry.topology import boundary_faces, face_normals
from cortet.measure.quality import signed_volumes
from cortet.meshes import region_names
from cortet.solver_files.holes import regions_of
from cortet.solver_files.sets import with_regions

H = 2.0
SKULL = ball_surface(4, radius=13.0)


@pytest.fixture(scope="module")
def made() -> cortet.Mesh:
    """A white ball of 7 mm in a pial one of 10 mm, in a skull of 13 mm."""
    pial, white = ball_surface(4, radius=10.0), ball_surface(4, radius=7.0)
    return cortet.mesh(SKULL, H, inner={"cortex": pial, "white": white}, progress=False)


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


def test_the_space_around_the_brain_is_a_certified_region(made):
    assert made.certified
    regions = {one.name: one for one in made.certificate.regions}
    assert list(regions) == ["csf", "cortex", "white"]
    pial, white = (4 / 3 * np.pi * radius**3 / 1000 for radius in (10, 7))
    assert regions["white"].volume_ml == pytest.approx(white, rel=0.08)
    assert regions["cortex"].volume_ml == pytest.approx(pial - white, rel=0.08)
    assert regions["csf"].volume_ml == pytest.approx(4 / 3 * np.pi * 13**3 / 1000 - pial, rel=0.08)
    assert [(one.name, one.around) for one in made.certificate.interfaces] == [("cortex", "csf"), ("white", "cortex")]


def test_a_brain_without_a_white_surface_has_a_cortex_by_depth(tmp_path):
    made = cortet.mesh(SKULL, H, inner={"brain": ball_surface(4, radius=10.0)}, progress=False)
    assert made.certified and [one.name for one in made.certificate.regions] == ["csf", "brain"]
    mesh = vtu.read(made.save(tmp_path / "m.vtu"))
    centre = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    sets = mesh.sets.cells
    assert centre[sets["cortex"]].min() > 8.0 and centre[sets["csf"]].min() > 9.5 and centre[sets["core"]].max() < 8.8
    assert np.array_equal(np.sort(np.concatenate([sets["cortex"], sets["core"]])), sets["brain"])
    assert np.array_equal(
        with_regions(mesh, ["brain"]).cell_data["region"] == 2, np.isin(np.arange(len(centre)), sets["brain"])
    )


def test_a_volume_of_the_brain_alone_is_in_place_within_a_skull(tmp_path):
    inside = np.linalg.norm(np.indices((21, 21, 21)) - 10, axis=0) < 10
    affine = np.eye(4)
    affine[:3, 3] = -10
    write_volume(inside.astype(np.int16), affine, tmp_path / "dseg.nii.gz")
    given = {"inner": {"brain": ball_surface(4, radius=10.0)}, "volumes": {"tissue": tmp_path / "dseg.nii.gz"}}
    made = cortet.mesh(SKULL, H, **given, progress=False)
    rows = made.tissues().set_index("label")
    assert rows.loc[1, "volume_ml"] == pytest.approx(4 / 3 * np.pi, rel=0.1)
    write_volume(inside.astype(np.int16), affine + 6 * np.eye(4, k=3), tmp_path / "dseg.nii.gz")
    with pytest.raises(InputError, match="outside the volume|shifted"):
        cortet.mesh(SKULL, H, **given, progress=False)


def test_a_brain_with_space_around_it_is_not_folded(made):
    with pytest.raises(InputError, match="csf"):
        cortet.fold(made, ga=24, progress=False)


def test_the_command_makes_a_hole_and_records_and_checks_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, radius in (("skull", 13.0), ("pial", 10.0), ("white", 8.5), ("ventricle", 6.0)):
        write_surface(ball_surface(4, radius=radius), tmp_path / f"{name}.surf.gii")
    inner = "--inner cortex=pial.surf.gii --inner white.surf.gii --inner ventricle=ventricle.surf.gii"

    def command(words: str) -> int:
        return main(words.replace("MESH", f"mesh skull.surf.gii {inner} --cell-size 2").split())

    def refused(words: str, word: str) -> bool:
        """Before any work, of which the command would print something."""
        capsys.readouterr()
        code, said = command(words), capsys.readouterr()
        return code == 1 and word in said.err and not said.out

    assert command("MESH -o head.vtu") == command("MESH --hole ventricle -o hollow.vtu") == 0
    assert command("certify head.vtu") == command(f"certify head.vtu skull.surf.gii {inner}") == 0
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
