"""Resampling onto a common mesh: a map that is known, Connectome Workbench as the yardstick, and what is refused."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from shutil import which

import numpy as np
import pytest

from cortet.config import load
from cortet.config.stages import Resample
from cortet.errors import InputError
from cortet.formats.gifti import read_fields, read_surface, write_fields, write_surface
from cortet.geometry.icosphere import icosphere
from cortet.meshes import FloatArray, TriSurface
from cortet.stages import STAGES
from cortet.stages.resample import resample
from cortet.stages.stage import About, State

SIZE = 30.0


def egg(directions: FloatArray) -> FloatArray:
    """Where a smooth, bumpy egg has the places (n, 3) of the unit sphere, mm."""
    x, y, z = directions.T
    length = SIZE * (1 + 0.1 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.1 * z**2)
    return directions * length[:, None] * [0.8, 1.2, 1.0]


def shifted_sphere(subdivisions: int) -> TriSurface:
    """An icosphere whose vertices slid along it, unevenly: none of them is where those of another one are."""
    sphere = icosphere(subdivisions)
    moved = sphere.points + 0.1 * np.sin(4 * np.roll(sphere.points, 1, axis=1) + 0.3)
    return replace(sphere, points=moved / np.linalg.norm(moved, axis=1, keepdims=True))


def native(subdivisions: int) -> tuple[TriSurface, TriSurface]:
    """An egg with a field and labels, and its sphere."""
    sphere = shifted_sphere(subdivisions)
    fields = {
        "height": sphere.points[:, 2],
        "lobe": (1 + 2 * (sphere.points[:, 0] > 0.1) + (sphere.points[:, 1] > 0)).astype(np.int32),
        "pair": sphere.points[:, :2].copy(),
    }
    return TriSurface(egg(sphere.points), sphere.faces, fields), replace(sphere, points=7 * sphere.points)


def test_the_vertices_of_the_common_mesh_lie_where_the_map_puts_them():
    wanted, errors = egg(icosphere(4).points), []
    for subdivisions in (4, 5):
        made, report = resample(*native(subdivisions), Resample(subdivisions=4))
        errors.append(np.linalg.norm(made.points - wanted, axis=1).max())
        assert np.abs(made.point_data["height"] - icosphere(4).points[:, 2]).max() < 0.05
        assert (made.faces == icosphere(4).faces).all() and report.vertices == 2562
        assert 0 < report.resampled_to_native_mm.max < 0.15
    assert errors[0] < 0.1, "mm, of an egg of 60 mm with edges of 2 mm"
    assert errors[1] < errors[0] / 3, "linear interpolation: a quarter with edges of half the length"


def test_a_template_takes_the_place_of_the_icosphere(tmp_path):
    write_surface(shifted_sphere(3), tmp_path / "L.sphere.surf.gii")
    config = load({"resample": {"template": str(tmp_path / "{hemi}.sphere.surf.gii")}})
    state = State(*native(4))
    made, _ = STAGES["resample"].run(state, config, About(hemi="L"))
    assert len(made.surface.points) == 642 and np.abs(made.surface.points - egg(shifted_sphere(3).points)).max() < 0.4
    with pytest.raises(InputError, match="hemisphere, which is unknown"):
        STAGES["resample"].run(state, config, About())


def test_an_inner_surface_of_other_triangles_stays_as_it_is():
    (surface, sphere), inner = native(4), TriSurface(5 * icosphere(3).points, icosphere(3).faces)
    same, report = resample(inner, sphere, Resample(subdivisions=4), inside=True)
    assert same is inner and not report.resampled and report.native_to_resampled_mm.max == 0
    assert resample(surface, sphere, Resample(subdivisions=3), inside=True)[1].resampled


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda surface, sphere: (surface, replace(sphere, faces=np.roll(sphere.faces, 5, axis=0))), "this surface"),
        (lambda surface, sphere: (surface, replace(sphere, points=sphere.points * [1, 1, 2])), "7 to 14"),
        (lambda surface, sphere: (surface, replace(sphere, points=np.maximum(np.abs(sphere.points), 0.1))), "times"),
        (
            lambda surface, sphere: (
                replace(surface, faces=surface.faces[1:]),
                replace(sphere, faces=sphere.faces[1:]),
            ),
            "3 open edges",
        ),
        (lambda surface, sphere: (replace(surface, points=surface.points * np.nan), sphere), "not all finite"),
    ],
    ids=["of another surface", "not round", "half of it", "open", "without coordinates"],
)
def test_what_is_no_sphere_of_the_surface_is_refused(change, word, tmp_path):
    with pytest.raises(InputError, match=word):
        resample(*change(*native(3)), Resample(subdivisions=3), sphere_file="lh.sphere")
    write_surface(native(3)[0], tmp_path / "egg.surf.gii")
    with pytest.raises(InputError, match=r"egg.surf.gii"):
        resample(*native(3), Resample(template=str(tmp_path / "egg.surf.gii")))


@pytest.mark.skipif(not which("wb_command"), reason="Connectome Workbench is not installed")
@pytest.mark.parametrize("subdivisions", [3, 5])
def test_workbench_finds_the_same(subdivisions, tmp_path):
    """Onto fewer vertices than the surface has, and onto more."""
    surface, sphere = native(4)
    made, _ = resample(surface, sphere, Resample(subdivisions=subdivisions))
    names = {name: str(tmp_path / f"{name}.surf.gii") for name in ("surface", "sphere", "common", "made", "theirs")}
    common = icosphere(subdivisions)
    for name, one in {"surface": surface, "sphere": sphere, "common": common, "made": made}.items():
        write_surface(TriSurface(one.points, one.faces), names[name])
    wb = ["wb_command", "-logging", "SEVERE"]
    spheres = [names["sphere"], names["common"]]
    subprocess.run([*wb, "-surface-resample", names["surface"], *spheres, "BARYCENTRIC", names["theirs"]], check=True)
    assert np.abs(read_surface(names["theirs"]).points - made.points).max() < 1e-4
    for field, kind, end in (("height", "metric", "func"), ("lobe", "label", "label")):
        source, target = (str(tmp_path / f"{name}{field}.{end}.gii") for name in ("", "theirs_"))
        write_fields({field: surface.point_data[field]}, source)
        areas = ["-area-surfs", names["surface"], names["made"]]
        command = [*wb, f"-{kind}-resample", source, *spheres, "ADAP_BARY_AREA", target, *areas]
        subprocess.run(command, check=True)
        (theirs,) = read_fields(target).values()
        if kind == "label":
            assert (theirs == made.point_data[field]).all()
        else:
            assert theirs == pytest.approx(made.point_data[field], abs=1e-5)
