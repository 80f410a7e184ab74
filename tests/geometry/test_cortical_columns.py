"""Columns on shells, whose thickness and depths are known: φ is a + b / r, and columns are radii."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import shell_mesh

from cortet.geometry.columns import Columns, columns
from cortet.measure.harmonic import harmonic
from cortet.meshes import FloatArray, TetMesh

#: outer and inner radius, mm
SHELLS = [(23.0, 20.0), (13.0, 10.0), (53.0, 50.0)]


def shell(outer: float, inner: float, across: int, *, sulcus: bool = False) -> tuple[TetMesh, FloatArray, Columns]:
    """A shell, the radius of each node, and its columns; those of a sulcus begin at the inner sphere."""
    mesh = shell_mesh(outer, inner, across)
    radius = np.linalg.norm(mesh.points, axis=1)
    ends = np.flatnonzero((radius < inner + 1e-6) | (radius > outer - 1e-6)).astype(np.int32)
    values = ((radius[ends] > (inner + outer) / 2) ^ sulcus).astype(float)[:, None]
    phi = harmonic(mesh, ends, values, np.full((len(mesh.points), 1), 0.5))
    return mesh, radius, columns(mesh, phi[:, 0])


@pytest.mark.parametrize("sulcus", [False, True], ids=["gyrus", "sulcus"])
@pytest.mark.parametrize(("outer", "inner"), SHELLS)
def test_thickness_and_depths_of_a_shell_are_exact_to_a_hundredth(outer: float, inner: float, sulcus: bool) -> None:
    _, radius, found = shell(outer, inner, 3, sulcus=sulcus)
    depth = (outer - radius) / (outer - inner)
    volume = (outer**3 - radius**3) / (outer**3 - inner**3)
    if sulcus:
        depth, volume = 1 - depth, 1 - volume
    inside = (depth > 1e-6) & (depth < 1 - 1e-6)
    assert found.whole.all()
    assert np.abs(found.thickness / (outer - inner) - 1).max() < 0.01
    by_length, by_volume = (found.depth(equivolumetric=which)[0] for which in (False, True))
    assert np.abs(by_length - depth).max() < 0.01
    assert np.abs(by_volume - volume)[inside].mean() < 0.01
    assert np.abs(volume - depth)[inside].mean() > 2 * np.abs(by_volume - volume)[inside].mean()


def test_the_column_of_a_sharp_crest_begins_at_its_crest() -> None:
    """Where the gradient of the fit leads out of the wall, as at crowns of fsaverage5, the steepest edge leads in."""
    whole = shell_mesh(23.0, 20.0, 3)
    radius = np.linalg.norm(whole.points, axis=1)
    crest = np.argmax(whole.points[:, 2])
    points = whole.points.copy()
    points[crest] += [2.0, 1.0, 3.0]
    ends = np.flatnonzero((radius < 20 + 1e-6) | (radius > 23 - 1e-6)).astype(np.int32)
    mesh = TetMesh(points, whole.cells)
    phi = harmonic(mesh, ends, (radius[ends] > 21.5).astype(float)[:, None], np.full((len(points), 1), 0.5))
    assert columns(mesh, phi[:, 0]).whole[crest]


def test_a_node_whose_line_leaves_by_the_side_has_no_column() -> None:
    whole = shell_mesh(23.0, 20.0, 3)
    half = TetMesh(whole.points, whole.cells[whole.points[whole.cells][:, :, 0].mean(axis=1) > 0])
    used = np.unique(half.cells)
    mesh = TetMesh(half.points[used], np.searchsorted(used, half.cells))
    radius = np.linalg.norm(mesh.points, axis=1)
    found = columns(mesh, (radius - 20) / 3 + 0.3 * mesh.points[:, 0])  # lines lean towards the rim
    assert 0 < found.whole.mean() < 1
    assert not found.whole[mesh.points[:, 0] < 0.5].all()
