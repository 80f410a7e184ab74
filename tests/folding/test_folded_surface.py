"""A fold comes home: the folded cortex on the vertices of its own surface, and the stress that its elements feel."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.cli import main
from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.folded_surface import folded_surface, maps_of
from cortet.folding.growth import time_of
from cortet.folding.kernels import elastic_forces, nodal_forces
from cortet.folding.law import growth_share, own_growth
from cortet.folding.measurements import gaussian_curvature, local_gyrification
from cortet.folding.measures import MEASURES, surface_files, weeks_in
from cortet.folding.mechanics import distortion, mechanics
from cortet.folding.run import advance_to, beginning, measured, prepared
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.volumes import matrices
from cortet.geometry.topology import face_areas
from cortet.meshes import TetMesh
from cortet.solver_files.surface_map import map_of_file

RADIUS, START, END = 20.0, 28.0, 28.4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folded ball, and its surface at the start and at the end."""
    folder = tmp_path_factory.mktemp("home")
    write_surface(ball_surface(3, RADIUS), path := folder / "x.surf.gii")
    image = nib.load(path)
    image.meta["AnatomicalStructurePrimary"] = "CortexLeft"
    image.darrays[0].meta["AnatomicalStructureSecondary"] = "GrayWhite"
    path.write_bytes(image.to_xml())
    assert main(["mesh", str(path), "--ga", str(START), "--cell-size", "3.5", "-o", str(folder / "x.vtu")]) == 0
    command = ["fold", str(folder / "x.vtu"), "--end", str(END), "--surfaces", f"{START:g},{END:g}", "--force"]
    assert main([*command, "-o", str(folder / "folded")]) == 0
    return folder


def values(folder: Path, name: str, week: float = END) -> np.ndarray:
    arrays = nib.load(folder / f"folded/x_week-{week:g}_{name.replace('_', '')}.shape.gii").darrays
    return np.column_stack([array.data for array in arrays]).squeeze()


def frame(folder: Path) -> TetMesh:
    return vtu.read(max((folder / "folded/frames").glob("*.vtu")))


def test_the_stress_is_the_one_that_moves_the_nodes():
    """Exactly so where elements are not smoothed."""
    settings = Settings(gestational_age=22.0, force=True, end=23.0, thickness=3.0, model="braingrowth")
    run = prepared(ball_mesh(2, radius=10.0), settings)
    moment = beginning(run)
    advance_to(run, moment, time_of(22.3))
    measured(run, moment, distortion(run, moment))
    felt = mechanics(run, moment)
    x, cells = moment.state.x, run.mesh.cells
    gradients = np.linalg.inv(x[cells[:, 1:]] - x[cells[:, :1]]).transpose(0, 2, 1)
    gradients = np.concatenate([-gradients.sum(axis=1, keepdims=True), gradients], axis=1)
    forces = -np.einsum("e,eij,ekj->eki", moment.work.current, matrices(felt.stress), gradients)
    total = np.stack([np.bincount(cells.ravel(), forces[:, :, axis].ravel()) for axis in range(3)], axis=1)
    course = run.growth.at(np.array([moment.time]), moment.dt)
    elastic_forces(run.material, x, moment.work, course.growth[0], float(course.thickening[0]))
    expected = nodal_forces(moment.work)
    assert np.abs(expected).max() > 0
    assert total == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    assert felt.stretch.max() > 1.001


def test_the_elastic_distortion_is_that_of_what_growth_does_not_explain():
    settings = Settings(gestational_age=22.0, force=True, end=30.0, thickness=3.0, model="braingrowth")
    run = prepared(ball_mesh(2, radius=10.0), settings)
    moment = beginning(run)
    stretched = moment.state.x * [1.0, 1.3, 0.9]
    moment.state = moment.state._replace(x=stretched)
    assert distortion(run, moment) == pytest.approx(1.3 / 0.9)
    moment.state = moment.state._replace(x=stretched * [1.0, 1.0, -1.0])
    assert np.isinf(distortion(run, moment)).all()

    moment = beginning(run)
    advance_to(run, moment, time_of(28.0))
    body, x = moment.body, moment.state.x
    growth = run.growth.at(np.array([moment.time]), moment.dt)
    share = np.vectorize(growth_share)(body.depth, body.thickness + growth.thickening[0], body.mask)
    along, across = own_growth(share, body.amount, *growth.growth[0][body.label].T)
    n = body.normals[:, :, None]
    grown = np.eye(3) * (1 + along)[:, None, None] + (across - along)[:, None, None] * n * n.transpose(0, 2, 1)
    edges = (x[body.cells[:, 1:]] - x[body.cells[:, :1]]).transpose(0, 2, 1)
    whole = edges @ body.gradients  # of x by the positions at the start
    singular = np.linalg.svd(whole @ np.linalg.inv(grown), compute_uv=False)
    expected = singular[:, 0] / singular[:, 2]
    assert expected.max() > 1.1
    assert distortion(run, moment) == pytest.approx(expected, rel=1e-9)


def test_curvature_and_gyrification_of_a_ball():
    ball = ball_surface(4, RADIUS)
    gaussian = gaussian_curvature(ball.points, ball.faces)
    assert np.median(gaussian) == pytest.approx(1 / RADIUS**2, rel=0.02)
    areas = np.bincount(ball.faces.ravel(), np.repeat(face_areas(ball.points, ball.faces) / 3, 3))
    assert gaussian @ areas == pytest.approx(4 * np.pi)  # Gauss and Bonnet
    # the part of a sphere within a ball around one of its points has the area of the ball's great circle
    assert local_gyrification(ball.points, ball.faces) == pytest.approx(1, abs=0.08)


def test_the_folded_surface_is_the_input_moved(folder):
    given, made = (read_surface(folder / name) for name in ("x.surf.gii", f"folded/x_week-{END:g}_white.surf.gii"))
    assert np.array_equal(given.faces, made.faces) and given.frame == made.frame
    start = read_surface(folder / f"folded/x_week-{START:g}_white.surf.gii")
    assert np.abs(start.points - given.points).max() < 0.01  # less its facets
    assert np.linalg.norm(made.points, axis=1).mean() > RADIUS + 0.05
    image = nib.load(folder / f"folded/x_week-{END:g}_white.surf.gii")
    assert image.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    assert image.darrays[0].meta["AnatomicalStructureSecondary"] == "GrayWhite"


def test_every_measure_has_a_file(folder):
    for name in MEASURES:
        found = values(folder, name)
        assert len(found) == len(ball_surface(3, RADIUS).points)
        assert np.isfinite(found).all(), name
    assert values(folder, "area_growth", START) == pytest.approx(1, abs=1e-5)
    assert values(folder, "thickness", START) == pytest.approx(1.25, rel=1e-5)
    assert values(folder, "cortex_stress", START) == pytest.approx(0, abs=1e-6)
    assert values(folder, "depth", START) == pytest.approx(0, abs=1e-4)
    assert np.linalg.norm(values(folder, "cortex_direction"), axis=1) == pytest.approx(1, abs=1e-5)
    assert values(folder, "cortex_pressure").mean() > values(folder, "white_pressure").mean() > 0
    assert values(folder, "area_growth").mean() > 1.01


def test_a_fold_of_another_mesh_is_refused(folder):
    found, _, _ = map_of_file(folder / "x.vtu", vtu.read(folder / "x.vtu"))
    moved = frame(folder)
    with pytest.raises(InputError, match="another mesh"):
        folded_surface(replace(moved, points=moved.points + 1.0), found)
    with pytest.raises(InputError, match=r"no stress.*fold\.surfaces"):
        maps_of(replace(moved, cell_data={}), moved, found)


def test_weeks_that_a_fold_does_not_reach_are_refused(folder, capsys):
    weeks = ["--end", "29", "--surfaces", "28.5,34", "--force"]
    assert main(["fold", str(folder / "x.vtu"), *weeks, "-o", str(folder / "later")]) == 1
    assert "28 to 29 weeks, not to 34" in capsys.readouterr().err
    assert not (folder / "later").exists()


def test_a_new_fold_deletes_what_an_earlier_one_left_in_its_folder(folder, tmp_path, caplog):
    """Maps of other weeks, or of another mesh, would pass for its own. Files of the user stay."""
    shutil.copytree(folder / "folded", tmp_path / "again")
    (tmp_path / "doubtful.yaml").write_text("fold: {force: true}")
    command = [
        "fold",
        str(folder / "x.vtu"),
        "-o",
        str(tmp_path / "again"),
        "--config",
        str(tmp_path / "doubtful.yaml"),
    ]
    command += ["--end"]
    kept = tmp_path / f"again/mine_week-{END:g}_depth.shape.gii"
    kept.write_bytes((tmp_path / f"again/x_week-{END:g}_depth.shape.gii").read_bytes())
    young = tmp_path / "again/young_week-28_white.surf.gii"
    assert main(["phantom", "--ga", "28", "--subdivisions", "2", "-o", str(young)]) == 0
    frame = tmp_path / "again/frames/frame_0077.vtu"
    frame.touch()
    assert main([*command, "28.1"]) == 1
    assert "replaced" not in caplog.text
    frame.unlink()
    assert main([*command, "28.1", "--surfaces", "28.1"]) == 0
    assert (
        f"again: an earlier fold is replaced (frames: 2, surfaces and maps: {2 * (len(MEASURES) + 1)})" in caplog.text
    )
    assert {path.name for files in weeks_in(tmp_path / "again") for path in files} == {
        kept.name,
        young.name,
        *(path.name for path in surface_files(tmp_path, "x", 28.1).values()),
    }
