"""Quality measures against tetrahedra whose values are known in closed form."""

import numpy as np
import pytest

from cortet.measure import quality
from cortet.meshes import TetMesh

CELL = np.array([[0, 1, 2, 3]], np.int32)
REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])[[0, 2, 1, 3]]
#: body-centred cubic lattice: two neighbouring corners' edge and two cell centres
BCC = np.array([[0, 0, 0], [2, 0, 0], [1, 1, 1], [1, -1, 1.0]])
FLAT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
MEASURES = [
    quality.quality,
    lambda points, cells: quality.measures(points, cells).radius_ratio,
    lambda points, cells: quality.measures(points, cells).radius_edge,
]


@pytest.mark.parametrize("measure", MEASURES)
def test_regular_is_zero_and_flat_or_inverted_is_one(measure):
    assert measure(REGULAR, CELL) == pytest.approx([0], abs=1e-12)
    assert measure(FLAT, CELL) == [1]
    assert measure(REGULAR, CELL[:, [1, 0, 2, 3]]) == [1]


@pytest.mark.parametrize("measure", MEASURES)
def test_measures_ignore_size_place_and_rotation(measure):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(4, 3))
    cell = CELL if quality.signed_volumes(points, CELL)[0] > 0 else CELL[:, [1, 0, 2, 3]]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert measure(7 * points @ turn.T + 100, cell) == pytest.approx(measure(points, cell), abs=1e-9)


def test_the_regular_the_corner_and_the_bcc_tetrahedron_have_the_values_of_the_books():
    assert quality.quality(BCC, CELL)[0] == pytest.approx(0.0705, abs=5e-5)
    assert quality.dihedral_angles(REGULAR, CELL)[0] == pytest.approx([np.degrees(np.arccos(1 / 3))] * 6)
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert sorted(quality.dihedral_angles(corner, CELL)[0])[3:] == pytest.approx([90] * 3)
    # inradius 1 / (3 + sqrt 3), circumradius sqrt 3 / 2
    assert quality.measures(corner, CELL).radius_ratio == pytest.approx([1 - 6 / (3 + 3**0.5) / 3**0.5])
    cells, flat = quality.oriented(np.vstack([corner, [1, 1, 0]]), np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 1, 2, 4]]))
    assert flat == 1 and len(cells) == 2 and (quality.signed_volumes(corner, cells) > 0).all()


def test_q_is_a_power_of_the_mean_ratio():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(400, 3))
    cells = np.arange(400, dtype=np.int32).reshape(-1, 4)
    volumes, squares = quality.signed_volumes(points, cells), (quality.edge_lengths(points, cells) ** 2).sum(axis=1)
    eta = np.where(volumes > 0, 12 * np.cbrt(3 * volumes) ** 2 / squares, 0)
    assert quality.quality(points, cells) == pytest.approx(1 - eta**1.5)


def test_one_pass_finds_what_the_single_measures_do():
    rng = np.random.default_rng(3)
    points, cells = rng.normal(size=(400, 3)), np.arange(400, dtype=np.int32).reshape(-1, 4)
    found = quality.measures(points, cells)
    volumes, lengths = quality.signed_volumes(points, cells), quality.edge_lengths(points, cells)
    angles, radii = quality.dihedral_angles(points, cells), quality.circumradii(points, cells)
    assert found.volume == pytest.approx(volumes)
    assert found.shortest_edge == pytest.approx(lengths.min(axis=1))
    assert found.longest_edge == pytest.approx(lengths.max(axis=1))
    assert found.smallest_angle == pytest.approx(angles.min(axis=1))
    assert found.largest_angle == pytest.approx(angles.max(axis=1))
    assert found.radius_edge == pytest.approx(
        np.where(volumes > 0, 1 - np.sqrt(6) / 4 * lengths.min(axis=1) / radii, 1)
    )


@pytest.mark.parametrize(
    ("angle", "bound"), [(120, 0.300), (90, 0.057), (36, 0.241), (180, 1.0), (160, 0.754), (130, 0.405)]
)
def test_bound_by_the_angle_at_an_edge_of_a_valence_or_on_the_boundary(angle, bound):
    assert quality.opening_bound(angle) == pytest.approx(bound, abs=1e-3)


def test_histogram_counts_every_element_and_refuses_values_outside_the_range():
    assert quality.histogram(np.array([0, 0.0049, 0.005, 0.9999, 1.0])).tolist()[:2] == [2, 1]
    assert quality.histogram(np.array([0, 0.0049, 0.005, 0.9999, 1.0])).tolist()[-1] == 2
    with pytest.raises(ValueError, match="mixed orientation"):
        quality.histogram(np.array([0.1, 2.0]))


def test_summary_of_two_tetrahedra():
    mesh = TetMesh(np.vstack([REGULAR, BCC + 9]), np.vstack([CELL, CELL + 4]))
    found = quality.summarise(mesh)
    assert (found.nodes, found.tets, sum(found.histogram)) == (8, 2, 2)
    assert found.q.max == pytest.approx(0.0705, abs=5e-5)
    assert found.count_above == dict.fromkeys(("0.3", "0.4", "0.5", "0.6"), 0)
    assert (found.shortest_edge_mm, found.longest_edge_mm) == pytest.approx((3**0.5, 8**0.5))
