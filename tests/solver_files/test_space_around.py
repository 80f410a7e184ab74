"""The space around the brain as a region."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.meshes import region_names
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


def test_the_command_records_and_checks_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, radius in (("skull", 13.0), ("pial", 10.0), ("white", 8.5), ("ventricle", 6.0)):
        write_surface(ball_surface(4, radius=radius), tmp_path / f"{name}.surf.gii")
    inner = "--inner cortex=pial.surf.gii --inner white.surf.gii --inner ventricle=ventricle.surf.gii"
    assert main(f"mesh skull.surf.gii {inner} --cell-size 2 -o head.vtu".split()) == 0
    assert main(["certify", "head.vtu"]) == main(f"certify head.vtu skull.surf.gii {inner}".split()) == 0
    capsys.readouterr()
    assert main(["fold", "head.vtu", "--ga", "24", "-o", "fold"]) == 1
    said = capsys.readouterr()
    assert "csf" in said.err and not said.out
