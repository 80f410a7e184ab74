"""Columns on shells, whose thickness and depths are known: φ is a + b / r, and columns are radii."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import shell_mesh

from cortet.geometry.columns import Columns, columns, recovered_gradient
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


def test_the_error_falls_with_the_elements() -> None:
    errors = []
    for across in (2, 4):
        _, radius, found = shell(13.0, 10.0, across)
        volume = (13.0**3 - radius**3) / (13.0**3 - 10.0**3)
        errors.append(np.abs(found.depth(equivolumetric=True)[0] - volume).mean())
    assert errors[1] < errors[0] / 1.5


def test_columns_are_radii_and_end_on_the_other_side() -> None:
    mesh, radius, found = shell(23.0, 20.0, 3)
    cosine = np.einsum("nc,nc->n", found.direction, mesh.points / radius[:, None])
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 2.0
    for lines, end in ((found.to_one, 23.0), (found.to_zero, 20.0)):
        reached = np.linalg.norm(lines.ends, axis=1)
        assert np.abs(reached - end).max() < 0.2, "the faces of the spheres lie within them"
        assert (np.einsum("nc,nc->n", lines.ends, mesh.points) > 0.999 * reached * radius).all()


@pytest.mark.parametrize("depth", [0.1, 0.5, 0.8])
def test_points_at_a_depth_lie_on_a_sphere(depth: float) -> None:
    _, radius, found = shell(23.0, 20.0, 3)
    nodes = np.flatnonzero(radius < 21.5).astype(np.int32)
    by_volume, by_length = (np.linalg.norm(found.at(nodes, depth, equivolumetric=one), axis=1) for one in (True, False))
    assert np.abs(by_volume - np.cbrt(23**3 - depth * (23**3 - 20**3))).max() < 0.06
    assert np.abs(by_length - (23 - 3 * depth)).max() < 0.06
    assert found.at(nodes, 1.0) == pytest.approx(found.to_zero.ends[nodes])


def test_the_gradient_of_a_linear_function_is_exact_and_that_of_a_harmonic_polynomial_nearly() -> None:
    mesh = shell_mesh(3.0, 1.0, 4, 2)
    x, y, z = mesh.points.T
    assert np.allclose(recovered_gradient(mesh, 1 + 2 * x - y + 3 * z), [2, -1, 3])
    found = recovered_gradient(mesh, 3 * x * y + z * x + x * x - z * z)
    error = np.abs(found - np.column_stack([3 * y + z + 2 * x, 3 * x, x - 2 * z]))
    assert error.mean() < 0.02 and np.quantile(error, 0.8) < 0.01, "some nodes of the spheres have too few neighbours"


def test_a_node_whose_line_leaves_by_the_side_has_no_column() -> None:
    whole = shell_mesh(23.0, 20.0, 3)
    half = TetMesh(whole.points, whole.cells[whole.points[whole.cells][:, :, 0].mean(axis=1) > 0])
    used = np.unique(half.cells)
    mesh = TetMesh(half.points[used], np.searchsorted(used, half.cells))
    radius = np.linalg.norm(mesh.points, axis=1)
    found = columns(mesh, (radius - 20) / 3 + 0.3 * mesh.points[:, 0])  # lines lean towards the rim
    assert 0 < found.whole.mean() < 1
    assert not found.whole[mesh.points[:, 0] < 0.5].all()
