"""What is not a brain in mm and RAS coordinates is not folded; what is doubtful is said."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import fold
from cortet.folding.plausible import check_cells, check_mesh
from cortet.folding.run import prepared
from cortet.meshes import TetMesh
from cortet.phantoms import phantom
from cortet.stages.generate import generate

LEFT, RIGHT = Settings(gestational_age=26.0, hemisphere="L"), Settings(gestational_age=26.0, hemisphere="R")


@pytest.fixture(scope="module")
def left() -> TetMesh:
    """A left hemisphere of 26 weeks in coarse cells."""
    return generate(phantom(26.0, subdivisions=4), cell_size=4.0, mesher="lattice")[0]


def placed(mesh: TetMesh, *axes: int) -> TetMesh:
    """The mesh with its axes in another order, 1 to 3, and turned round where negative."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        matrix[row, abs(axis) - 1] = np.sign(axis)
    cells = mesh.cells if np.linalg.det(matrix) > 0 else mesh.cells[:, [1, 0, 2, 3]]
    return TetMesh(mesh.points @ matrix.T, cells, mesh.point_data)


def scaled(mesh: TetMesh, factor: float) -> TetMesh:
    return replace(mesh, points=factor * mesh.points)


def in_two_pieces(mesh: TetMesh) -> TetMesh:
    aside = mesh.points + np.array([200.0, 0, 0])
    return TetMesh(np.vstack([mesh.points, aside]), np.vstack([mesh.cells, mesh.cells + len(mesh.points)]))


def with_wall(mesh: TetMesh) -> TetMesh:
    return replace(mesh, point_data={"medial_wall": (mesh.points[:, 0] > -3).astype(np.int32)})


@pytest.mark.parametrize(
    ("change", "settings"),
    [
        (lambda left: left, LEFT),
        (lambda left: placed(left, -1, 2, 3), RIGHT),
        (lambda left: left, Settings(gestational_age=26.0)),  # half of a brain, which half is not said
        (with_wall, RIGHT),  # a mesh that marks its medial wall is believed
    ],
)
def test_a_hemisphere_of_the_age_in_its_place_is_not_doubted(left, change, settings):
    assert check_mesh(change(left), settings) == []


@pytest.mark.parametrize(
    ("change", "settings", "word"),
    [
        (lambda left: left, RIGHT, "--hemi L"),
        (lambda left: placed(left, -1, -2, 3), LEFT, "LPS"),
        (lambda left: placed(left, 2, -1, 3), LEFT, "-y .*RAS"),
        (lambda left: placed(left, 3, 2, -1), LEFT, "-z .*RAS"),
        (lambda left: scaled(left, 1e-3), LEFT, " metres"),
        (lambda left: scaled(left, 1e3), LEFT, "micrometres"),
        (lambda left: scaled(left, 0.6), LEFT, " 26 weeks"),
        (in_two_pieces, LEFT.with_keys(force=True), "2 separate pieces"),
    ],
)
def test_what_is_no_hemisphere_of_the_age_in_its_place_is_refused(left, change, settings, word):
    with pytest.raises(InputError, match=word):
        check_mesh(change(left), settings)


def test_a_forced_fold_of_an_unusual_volume_says_so(left):
    (doubt,) = check_mesh(scaled(left, 0.6), LEFT.with_keys(force=True))
    assert "26 weeks usually has" in doubt


def test_cells_as_coarse_as_the_cortex_are_refused_unless_forced(left):
    run = prepared(left, LEFT)
    with pytest.raises(InputError, match="setting folding"):
        check_cells(run, LEFT)
    (doubt,) = check_cells(run, LEFT.with_keys(force=True))
    assert "cells" in doubt
    assert check_cells(prepared(left, LEFT.with_keys(thickness=8.0)), LEFT) == []


def test_a_fold_says_its_doubts_and_begins_none_that_is_refused(left, tmp_path):
    said: list[str] = []
    fold(left, tmp_path, LEFT.with_keys(end=26.001, force=True), say=said.append)
    assert said[-1].startswith("warning: the cells are ")
    assert json.loads((tmp_path / "verdict.json").read_text())["warnings"] == [said[-1].removeprefix("warning: ")]
    with pytest.raises(InputError, match="hemisphere R"):
        fold(left, tmp_path / "none", RIGHT)
    assert not (tmp_path / "none").exists()
