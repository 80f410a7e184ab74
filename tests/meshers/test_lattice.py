"""A body-centred cubic lattice fills what given triangles enclose, and these triangles stay."""

import os
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from shapes import ball_surface, real_surface

from cortet.config.stages import Generate
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.orientation import random_rotation
from cortet.geometry.topology import boundary_faces, enclosed_volume, surface_topology
from cortet.measure.quality import oriented, signed_volumes
from cortet.meshers import _lattice as lattice
from cortet.meshers._lattice import graded_nodes, lattice_cells, tetrahedralised
from cortet.meshers._nested import remesh_apart, wanted
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.generate import generate

#: no tetrahedra
NONE = np.zeros((0, 4), np.int32)


def box(size: float) -> TriSurface:
    cube = trimesh.creation.box(extents=[size] * 3).subdivide().subdivide()
    return TriSurface(cube.vertices, cube.faces)


def nodes_in(surface: TriSurface, cell_size: float = 1.0) -> np.ndarray:
    return graded_nodes(surface, np.full(len(surface.points), 1.25), edge_length=1.25, cell_size=cell_size)


def test_lines_through_edges_and_corners_cross_the_boundary_once(monkeypatch):
    monkeypatch.setattr(lattice, "_ORIGIN", np.zeros(3))  # puts nodes on corners, edges and diagonals of the box
    monkeypatch.setattr(lattice, "GAP", 1e-3)
    nodes = nodes_in(box(4 * lattice.CONSTANT))
    assert (np.abs(nodes) < 2 * lattice.CONSTANT).all() and len(nodes) == 3**3 + 4**3


def test_the_given_triangles_are_the_boundary():
    ball = ball_surface(3, radius=4.0)
    points, cells = tetrahedralised(ball, nodes_in(ball, cell_size=0.7), NONE)
    assert np.array_equal(points[: len(ball.points)], ball.points)
    mesh = TetMesh(points, oriented(points, cells)[0])
    as_sets = [np.unique(np.sort(faces, axis=1), axis=0) for faces in (boundary_faces(mesh), ball.faces)]
    assert np.array_equal(*as_sets)
    assert signed_volumes(mesh.points, mesh.cells).sum() == pytest.approx(enclosed_volume(ball.points, ball.faces))


@pytest.mark.parametrize("core_ratio", [1.0, 2.0])
def test_tetrahedra_known_in_advance_are_those_that_tetgen_would_make(core_ratio):
    """Next to a node that is not of the lattice, in a core, and in two parts that touch nowhere."""
    ball = ball_surface(4, radius=14.0)
    size = np.full(len(ball.points), 1.25)
    nodes = graded_nodes(ball, size, edge_length=1.25, cell_size=1.0, core_ratio=core_ratio, core_depth=1.0)
    nodes = nodes[np.abs(nodes[:, 0]) > 1.0]
    nodes = np.concatenate([[[4.0, 0.3, 0.2]], nodes])
    known = lattice_cells(ball, nodes, core_ratio * lattice.CONSTANT)
    assert len(known) > 400 and not (known == 0).any() and {-1, 1} == set(np.sign(nodes[known][..., 0]).ravel())
    points, cells = tetrahedralised(ball, nodes, known)
    same, every = tetrahedralised(ball, nodes, NONE)
    assert np.array_equal(points, same)
    assert np.array_equal(*(np.unique(np.sort(made, axis=1), axis=0) for made in (cells, every)))


def test_near_smaller_triangles_the_lattice_is_finer():
    ball = ball_surface(4, radius=8.0)
    size = np.minimum(1.25, 0.5 + 0.3 * np.linalg.norm(ball.points - [8, 0, 0], axis=1))
    nodes = graded_nodes(ball, size, edge_length=1.25, cell_size=1.0)
    apart = KDTree(nodes).query(nodes, k=2)[0][:, 1]
    near = np.linalg.norm(nodes - [8, 0, 0], axis=1) < 1.5
    far = np.linalg.norm(nodes - [8, 0, 0], axis=1) > 4
    assert apart[near].max() < 1.0 and np.median(apart[far]) == pytest.approx(lattice.CONSTANT * np.sqrt(3) / 2)
    tree = surface_tree(ball.points, ball.faces)
    assert np.linalg.norm(nodes, axis=1).max() < 8 and closest_points(tree, nodes).distances.min() > 0.2 * lattice.GAP


def test_towards_a_core_spacing_grows_step_by_step_and_no_two_lattices_meet_too_closely():
    ball = ball_surface(5, radius=24.0)
    size, usual = np.full(len(ball.points), 1.25), lattice.CONSTANT * np.sqrt(3) / 2
    nodes = graded_nodes(ball, size, edge_length=1.25, cell_size=1.0, core_ratio=3.0, core_depth=2.0)
    depth, apart = 24 - np.linalg.norm(nodes, axis=1), KDTree(nodes).query(nodes, k=2)[0][:, 1]
    spacings = [np.median(apart[(depth >= start) & (depth < start + 1.5)]) for start in np.arange(0.5, 18, 1.5)]
    assert spacings[0] == pytest.approx(usual) and spacings[-1] == pytest.approx(3 * usual)
    assert all(inner < 1.6 * outer for outer, inner in pairwise(spacings)), "one jump by 3 makes bad tetrahedra"
    assert apart.min() > 0.75 * lattice.APART * 1.2, "nodes of two lattices keep apart"


def test_blades_too_thin_for_the_lattice_get_nodes_half_way_between_their_banks():
    thickness = 1.1  # the lattice keeps half of a cell size from both banks
    grid = trimesh.creation.box(extents=[16, 16, 16]).subdivide().subdivide().subdivide().subdivide()
    slab = TriSurface(grid.vertices * [1, 1, thickness / 16], grid.faces)
    nodes = graded_nodes(slab, np.full(len(slab.points), 1.0), edge_length=1.0, cell_size=0.8)
    within = np.abs(nodes[:, :2]).max(axis=1) < 3
    assert np.abs(nodes[within, 2]).max() < 0.1 * thickness, "half-way"
    middle = np.stack(np.meshgrid(*2 * [np.linspace(-3, 3, 20)]), axis=-1).reshape(-1, 2)
    assert KDTree(nodes[:, :2]).query(middle)[0].max() < 1.5, "everywhere"
    assert np.abs(nodes[:, :2]).max() < 6, "but not beside the rim, which is thinner"


@pytest.mark.parametrize(("thickness", "has_nodes"), [(0.9, False), (1.6, True)])
def test_a_layer_gets_nodes_half_way_where_two_tetrahedra_fit(thickness, has_nodes):
    grid = trimesh.creation.box(extents=[16, 16, 16]).subdivide().subdivide().subdivide().subdivide()
    slab = TriSurface(grid.vertices * [1, 1, thickness / 16], grid.faces)
    size = np.full(len(slab.points), 1.0)
    nodes = graded_nodes(slab, size, edge_length=1.0, cell_size=0.8, layer=True)
    half_way = nodes[(np.abs(nodes[:, :2]).max(axis=1) < 3) & (np.abs(nodes[:, 2]) < 1e-6)]
    assert (len(half_way) > 25) == has_nodes
    if has_nodes:
        apart = KDTree(half_way).query(half_way, k=2)[0][:, 1]
        assert apart.min() >= 0.7 and apart.max() < 1.3, "one node for each vertex of a side"


def test_a_core_that_is_hardly_coarser_leaves_no_hole():
    ball = ball_surface(4, radius=8.0)
    size = np.full(len(ball.points), 1.25)
    nodes = graded_nodes(ball, size, edge_length=1.25, cell_size=1.0, core_ratio=1.05, core_depth=2.0)
    assert KDTree(nodes).query(np.zeros(3))[0] < lattice.CONSTANT


def test_a_seed_turns_the_lattice_and_another_one_otherwise():
    ball = ball_surface(3)
    usual, turned, other = (
        generate(ball, Generate(seed=seed), cell_size=0.8, mesher="lattice")[0] for seed in (0, 1, 2)
    )
    assert np.array_equal(usual.points, generate(ball, cell_size=0.8, mesher="lattice")[0].points)

    def along_axes(mesh: TetMesh) -> float:
        """Share of the edges from corner 0 that lie along an axis, as those of cubes do."""
        edges = mesh.points[mesh.cells[:, 1]] - mesh.points[mesh.cells[:, 0]]
        return float((np.abs(edges).max(axis=1) > 0.999 * np.linalg.norm(edges, axis=1)).mean())

    assert along_axes(usual) > 10 * max(along_axes(turned), along_axes(other), 1e-3)
    assert len(turned.points) != len(other.points) or not np.allclose(turned.points, other.points)
    assert np.linalg.norm(turned.points, axis=1).max() == pytest.approx(5.0, rel=1e-3)  # where the surface is
    turn = random_rotation(3)
    assert turn @ turn.T == pytest.approx(np.eye(3)) and np.linalg.det(turn) == pytest.approx(1)


def test_a_real_cortex_is_remeshed_and_filled():
    surface = real_surface("fetal/fetomorph_GW25_left")
    boundary = remesh_apart(surface, wanted(surface, 2.5, 0.8))[0].surface
    points, cells = tetrahedralised(boundary, nodes_in(boundary, cell_size=2.0), NONE)
    made = boundary_faces(TetMesh(points, oriented(points, cells)[0]))
    assert len(made) == len(boundary.faces) and surface_topology(made).problems() == []


def test_triangles_that_cross_leave_no_files_and_no_other_folder(tmp_path, monkeypatch):
    """TetGen wrote into the working folder, so cortet changed it, under the files of other threads."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "chdir", None)
    ball = ball_surface(2, 5.0)
    crossing = replace(ball, points=np.r_[[-9.0 * ball.points[0] / 5], ball.points[1:]])
    with pytest.raises(RuntimeError):
        tetrahedralised(crossing, np.zeros((0, 3)), NONE)
    assert list(tmp_path.iterdir()) == []
