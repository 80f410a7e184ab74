"""Places are cut out, worked on and put back; nothing else of the mesh changes."""

from dataclasses import replace

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.geometry import topology
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.insertion import insert_vertices
from cortet.optimise.pockets import (
    better_of_each,
    cut_out,
    mixed,
    only,
    pockets_at,
    promising,
    put_back,
    rim_of,
)


@pytest.fixture
def mesh() -> TetMesh:
    cube = cube_mesh(14, jitter=0.05)
    nodes, cells = np.arange(len(cube.points)), np.arange(len(cube.cells), dtype=np.int32)
    return replace(cube, point_data={"x": cube.points[:, 0], "number": nodes}, cell_data={"region": cells % 1})


@pytest.fixture
def seeds(mesh: TetMesh) -> np.ndarray:
    """A tetrahedron at each of two corners of the cube that are opposite to each other."""
    middles = mesh.points[mesh.cells].mean(axis=1)
    chosen = np.zeros(len(mesh.cells), np.bool_)
    chosen[[np.argmin(middles.sum(axis=1)), np.argmax(middles.sum(axis=1))]] = True
    return chosen


def moved(part: TetMesh, by: float, where: int) -> TetMesh:
    points = part.points.copy()
    points[where] += by
    return replace(part, points=points)


def test_two_pockets_far_apart_share_nothing_and_their_rim_is_all_that_the_rest_uses(mesh, seeds):
    part = cut_out(mesh, seeds)
    assert part.taken[seeds].all() and topology.components(part.mesh.cells) == 2
    numbers = part.mesh.point_data["number"]
    outside = np.unique(mesh.cells[~part.taken])
    assert set(numbers[part.rim]) == set(numbers) & set(outside)
    assert np.array_equal(part.mesh.points, mesh.points[numbers]) and np.array_equal(rim_of(part, part.mesh), part.rim)


def flattened(*heights: float) -> TetMesh:
    """One pocket of tetrahedra that share no vertex, regular but for their heights."""
    regular = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.75**0.5, 0], [0.5, 0.75**0.5 / 3, (2 / 3) ** 0.5]])
    points = np.concatenate([regular * [1, 1, height] + [3 * i, 0, 0] for i, height in enumerate(heights)])
    cells = np.arange(len(points), dtype=np.int32).reshape(-1, 4)
    node, pocket = np.arange(len(points)), np.zeros(len(cells), np.int32)
    return TetMesh(points, cells, {"node of the whole": node}, {"pocket": pocket})


def test_a_better_worst_tetrahedron_is_not_bought_with_many_that_are_hardly_better():
    once, often, better = flattened(0.1, 1.0, 1.0), flattened(0.12, 0.12, 0.12), flattened(0.12, 0.3, 1.0)
    assert quality(once.points, once.cells).max() > quality(often.points, often.cells).max()
    assert better_of_each(once, often, 0.3) is once
    assert np.array_equal(better_of_each(once, better, 0.3).points, better.points)
    fewer = flattened(0.12, 1.0, 1.0)
    assert np.array_equal(better_of_each(often, fewer, 0.3).points, fewer.points), "with the same worst one"
    fine, finer = flattened(0.5, 1.0), flattened(0.6, 0.6)
    assert better_of_each(fine, finer, 0.9) is fine, "none is above the threshold"


def test_each_pocket_keeps_the_try_that_was_better_there(mesh, seeds):
    part = cut_out(mesh, seeds)
    middle = part.mesh.points.mean(axis=1) < 0.5
    inner = np.setdiff1d(np.arange(len(part.mesh.points)), part.rim)
    low, high = (inner[middle[inner] == side] for side in (True, False))
    worse_low, worse_high = (moved(part.mesh, 0.05, nodes[len(nodes) // 2]) for nodes in (low, high))
    assert quality(worse_low.points, worse_low.cells).max() > quality(part.mesh.points, part.mesh.cells).max()
    best = better_of_each(worse_low, worse_high, 0.0)
    assert quality(best.points, best.cells).max() == quality(part.mesh.points, part.mesh.cells).max()
    whole = put_back(mesh, part, best)
    assert sorted(map(tuple, whole.points.tolist())) == sorted(map(tuple, mesh.points.tolist()))
    assert better_of_each(part.mesh, worse_low, 0.0) is part.mesh


def test_pockets_can_be_left_out_of_a_try_and_keep_what_they_had(mesh, seeds):
    part = cut_out(mesh, seeds)
    corner = mesh.points[mesh.cells[np.flatnonzero(seeds)]].mean(axis=1)
    first = pockets_at(part.mesh, corner[:1])
    assert first.sum() == 1 and pockets_at(part.mesh, corner).sum() == 2
    one = only(part.mesh, first)
    assert 0 < len(one.cells) < len(part.mesh.cells) and topology.components(one.cells) == 1
    inside = np.setdiff1d(np.arange(len(one.points)), rim_of(part, one))[0]
    changed = moved(one, 0.02, inside)
    both = mixed(part.mesh, changed, first)
    assert len(both.cells) == len(part.mesh.cells)
    high = 0.9 * quality(part.mesh.points, part.mesh.cells).max()
    assert better_of_each(part.mesh, changed, high) is part.mesh, "worse, or not there"
    assert len(better_of_each(changed, one, high).cells) == len(one.cells)
    whole = put_back(mesh, part, both)
    assert np.count_nonzero((whole.points != mesh.points).any(axis=1)) == 1


def test_a_pocket_is_promising_while_few_of_its_tetrahedra_are_bad(mesh, seeds):
    part = cut_out(mesh, seeds)
    q = quality(part.mesh.points, part.mesh.cells)
    assert len(promising(part.mesh, q.max(), 10).cells) == 0, "nothing is left to do"
    assert promising(part.mesh, 0.0, len(q)) is part.mesh
    assert len(promising(part.mesh, 0.0, 3).cells) == 0, "no hope"
    worst = promising(part.mesh, np.sort(q)[-2], 10)
    assert topology.components(worst.cells) == 1 and quality(worst.points, worst.cells).max() == q.max()


def test_vertices_that_were_inserted_come_last_and_carry_values_of_a_neighbour(mesh, seeds):
    part = cut_out(mesh, seeds)
    mu2 = np.full(len(part.mesh.cells), 9.0)  # all are said to be bad: whatever is tried seems better
    made, count = insert_vertices(part.mesh, mu2, np.zeros(len(mu2), np.int32), 4.0, held=np.ones(len(mu2), np.bool_))
    assert count > 0
    whole = put_back(mesh, part, made)
    assert (signed_volumes(whole.points, whole.cells) > 0).all()
    assert signed_volumes(whole.points, whole.cells).sum() == pytest.approx(1.0)
    assert topology.surface_topology(topology.boundary_faces(whole)).is_closed_manifold
    rest = np.unique(mesh.cells[~part.taken])
    where = {number: k for k, number in reversed(list(enumerate(whole.point_data["number"].tolist())))}
    assert all(np.array_equal(whole.points[where[number]], mesh.points[number]) for number in rest.tolist())
    assert len(whole.cell_data["region"]) == len(whole.cells) and len(whole.point_data["x"]) == len(whole.points)
