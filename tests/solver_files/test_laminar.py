"""Depths of a cortex between two spheres, whose columns are radii: points, values and surfaces."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.gifti import read_fields, read_surface, write_surface
from cortet.meshes import REGION

PIAL, WHITE = 12.0, 8.0
#: mm, a twentieth of the thickness: two to three elements are across
NEAR = 0.2
MIDDLE = np.cbrt((PIAL**3 + WHITE**3) / 2)  # of equal volumes
AS_GIVEN = {"smooth_surface": {"enabled": False}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with both surfaces and their mesh in two layers."""
    made = tmp_path_factory.mktemp("layers")
    for name, radius in (("pial", PIAL), ("white", WHITE)):
        write_surface(ball_surface(3, radius), made / f"{name}.surf.gii")
    settings = {**AS_GIVEN, "export": {"layers": 2}}
    mesh = cortet.mesh(
        made / "pial.surf.gii",
        inner={"white": made / "white.surf.gii"},
        cell_size=1.3,
        settings=settings,
        progress=False,
    )
    mesh.save(made / "x.vtu")
    return made


@pytest.fixture(scope="module")
def head(folder):
    inner = {"white": folder / "white.surf.gii"}
    return cortet.mesh(folder / "pial.surf.gii", inner=inner, cell_size=1.3, settings=AS_GIVEN, progress=False)


@pytest.mark.parametrize("region", ["white", None], ids=["white", "pial"])
def test_values_at_depths_are_those_at_radii(head, region):
    depths = [0.0, 0.25, 0.5, 1.0]
    radius = np.linalg.norm(head.points, axis=1)
    by_volume = head.laminar_profile(radius, depths, region=region)
    by_length = head.laminar_profile(radius, depths, region=region, equivolumetric=False)
    exact = np.cbrt(PIAL**3 - np.array(depths) * (PIAL**3 - WHITE**3))
    assert by_volume.shape == (len(ball_surface(3, 1.0).points), 4)
    assert np.abs(by_volume - exact).max() < NEAR
    assert np.abs(by_length - (PIAL - np.array(depths) * (PIAL - WHITE))).max() < NEAR
    assert np.abs(by_volume - by_length)[:, 2].mean() > 0.15, "the two differ in a shell as thick"


def test_values_of_the_white_matter_do_not_reach_the_cortex_and_labels_stay_labels(head):
    cortex = head.mesh.cell_data[REGION] == 1
    numbers = head.laminar_profile(np.where(cortex, 100.0, -100.0), [0.0, 0.5, 1.0])
    labels = head.laminar_profile(np.where(cortex, 3, 7), [0.0, 0.5, 1.0])
    assert numbers == pytest.approx(100) and set(np.unique(labels)) == {3}


def test_a_surface_at_a_depth_has_the_vertices_of_that_given_and_can_bound_a_region(head):
    white = head.native["white"]
    (middle,) = head.laminar_surfaces([0.5])
    assert np.array_equal(middle.faces, white.faces)
    assert np.abs(np.linalg.norm(middle.points, axis=1) - MIDDLE).max() < NEAR
    radius = np.linalg.norm(middle.points, axis=1)
    cosine = np.einsum("vc,vc->v", middle.points, white.points) / radius / WHITE
    assert cosine.min() > 0.999, "each vertex has moved along its radius"
    inner = {"deep": middle, "white": white}
    nested = cortet.mesh(head.native["cortex"], inner=inner, cell_size=1.3, settings=AS_GIVEN, progress=False)
    volumes = {region.name: region.volume_ml for region in nested.certificate.regions}
    assert nested.certified and volumes["cortex"] == pytest.approx(volumes["deep"], rel=0.15)


def test_depths_outside_the_cortex_and_meshes_without_a_white_surface_are_refused(head):
    for depths in ([0.5, 1.1], [[0.5]], ["half"], 0.5, None):
        for call in (partial(head.laminar_profile, head.points), head.laminar_surfaces):
            with pytest.raises(InputError, match=f"{re.escape(repr(depths))} are not depths"):
                call(depths)
    single = cortet.mesh(ball_surface(2, PIAL), cell_size=4.0, progress=False)
    with pytest.raises(InputError, match="white"):
        single.laminar_profile(single.points, [0.5])


def projected(folder: Path, tmp_path: Path, *options: str, mesh: str = "x.vtu"):
    """The radius of nodes, as `cortet project` brings it to the pial surface."""
    result = vtu.read(folder / mesh)
    result.point_data.clear()
    result.point_data["radius"] = np.linalg.norm(result.points, axis=1)
    vtu.write(result, tmp_path / "result.vtu")
    command = ["project", str(tmp_path / "result.vtu"), "--mesh", str(folder / mesh)]
    output = tmp_path / "x.func.gii"
    assert main([*command, "-o", str(output), *options]) == 0
    return read_fields(output)["radius"]


def test_project_takes_depths_in_percent_and_layers_along_columns(folder, tmp_path):
    assert np.abs(projected(folder, tmp_path, "--depth", "50%") - MIDDLE).max() < NEAR
    assert np.abs(projected(folder, tmp_path, "--depth", "50%", "--equidistant") - 10).max() < NEAR
    same = [projected(folder, tmp_path, "--depth", depth) for depth in ("25:75%", "25%:75%")]
    assert np.array_equal(*same)
    outer = projected(folder, tmp_path, "--layer", "1")
    volume = np.linspace(PIAL**3, MIDDLE**3, 1000)
    assert np.abs(outer - np.cbrt(volume).mean()).max() < NEAR


def test_the_command_layers_writes_a_surface_for_each_bound(folder, tmp_path, capsys):
    given = [str(folder / "pial.surf.gii"), str(folder / "white.surf.gii")]  # cortet tells which one is inside
    command = ["layers", *given, "--layers", "1,1,2", "--cell-size", "1.3", "-o", str(tmp_path / "lh.surf.gii")]
    assert main(command) == 0
    assert sorted(file.name for file in tmp_path.glob("lh*")) == ["lh1.surf.gii", "lh2.surf.gii"]
    radii = [np.linalg.norm(read_surface(tmp_path / f"lh{number}.surf.gii").points, axis=1) for number in (1, 2)]
    for radius, depth in zip(radii, (0.25, 0.5), strict=True):
        assert np.abs(radius - np.cbrt(PIAL**3 - depth * (PIAL**3 - WHITE**3))).max() < NEAR
