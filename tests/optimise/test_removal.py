"""Boundary vertices that are in the way are joined to a neighbour on the boundary."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from shapes import ball_mesh

from cortet.geometry import topology
from cortet.geometry.closest_point import forest
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, TetMesh, TriSurface
from cortet.optimise.insertion import insert_vertices
from cortet.optimise.star import mu2_of

#: vertex 0 has four triangles in a plane, all of which see vertex 1 below; vertex 6 is above
PEG = np.array([[0.6, 0, 0], [0, 0, -0.7], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 0.7]])
BELOW = np.array([[0, 2, 1, 3], [0, 3, 1, 4], [0, 4, 1, 5], [0, 5, 1, 2]], np.int32)
ABOVE = np.array([[0, 2, 3, 6], [0, 3, 4, 6], [0, 4, 5, 6], [0, 5, 2, 6]], np.int32)


def plane(height: float, **inner: TriSurface) -> TriSurface:
    return TriSurface([[-9, -9, height], [9, -9, height], [0, 9, height]], [[0, 1, 2]], inner=inner)


def removed(mesh: TetMesh, surface: TriSurface, held=None) -> TetMesh:
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    region = mesh.cell_data.get(REGION, np.ones(len(mesh.cells), np.int32))
    made, _ = insert_vertices(mesh, mu2, region, float(mu2_of(0.5)), tree=forest(surface), held=held)
    assert (signed_volumes(made.points, made.cells) > 0).all()
    fresh = TetMesh(made.points, made.cells.copy())
    assert np.array_equal(topology.neighbours(made), topology.neighbours(fresh)), "neighbours kept up to date"
    return made


def positive(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    turned = signed_volumes(points, cells) < 0
    return np.where(turned[:, None], cells[:, [0, 1, 3, 2]], cells)


def has_peg(mesh: TetMesh) -> bool:
    return bool((mesh.points == PEG[0]).all(axis=1).any())


def test_a_vertex_whose_triangles_all_see_one_vertex_is_removed():
    mesh = TetMesh(PEG[:6], BELOW)
    made = removed(mesh, plane(0.0))
    assert not has_peg(made) and quality(made.points, made.cells).max() < 0.5 < quality(mesh.points, mesh.cells).max()
    assert topology.surface_topology(topology.boundary_faces(made)).is_closed_manifold
    assert signed_volumes(made.points, made.cells).sum() == pytest.approx(signed_volumes(PEG, BELOW).sum())


def test_a_vertex_of_an_inner_surface_is_removed_from_both_regions():
    outward = np.random.default_rng(0).normal(size=(40, 3))
    points = np.concatenate([PEG, 2 * outward / np.linalg.norm(outward, axis=1, keepdims=True)])
    around = Delaunay(points[1:]).simplices + 1
    cells = np.concatenate([BELOW, ABOVE, around[(around > 6).any(axis=1)]]).astype(np.int32)
    cells = positive(points, cells)
    mesh = TetMesh(points, cells, cell_data={REGION: np.where(np.arange(len(cells)) < len(BELOW), 2, 1)})
    made = removed(mesh, plane(4.0, white=plane(0.0)))
    assert not has_peg(made)
    for number in (0, 1):
        assert topology.surface_topology(topology.sheet(made, number)[0].faces).is_closed_manifold
    assert has_peg(removed(mesh, plane(4.0, white=plane(0.5)))), "the new edge would be far from the surface"


def test_a_vertex_stays_where_the_boundary_would_leave_the_surface_or_is_held():
    mesh = TetMesh(PEG[:6], BELOW)
    assert has_peg(removed(mesh, plane(0.5)))
    assert has_peg(removed(mesh, plane(0.0), held=np.arange(6) == 0))
    assert has_peg(removed(mesh, plane(0.0), held=np.arange(6) > 1))


def test_a_vertex_with_a_single_tetrahedron_gets_a_second_one_though_that_is_worse_at_first():
    """As at a sharp tip: three faces of the tetrahedron are on the boundary, so it keeps its shape whatever moves."""
    base = ball_mesh(2, radius=9.0)
    corners = base.points[face := topology.boundary_faces(base)[0]]
    tip = corners.mean(axis=0) * (1 + 0.3 * np.linalg.norm(corners[0] - corners[1]) / 9.0)
    points, alone = np.vstack([base.points, tip]), len(base.points)
    mesh = TetMesh(points, positive(points, np.vstack([base.cells, [*face, alone]]).astype(np.int32)))
    surface = topology.boundary_surface(mesh)[0]
    mu2 = np.asarray(mu2_of(np.where((mesh.cells == alone).any(axis=1), 0.6, 0.1)))

    def faces_at_tip(held: np.ndarray) -> int:
        region = np.ones(len(mesh.cells), np.int32)
        made, _ = insert_vertices(mesh, mu2, region, float(mu2_of(0.5)), tree=forest(surface), held=held)
        assert (signed_volumes(made.points, made.cells) > 0).all()
        faces = topology.boundary_faces(made)
        assert topology.surface_topology(faces).is_closed_manifold
        return int((faces == alone).any(axis=1).sum())

    assert faces_at_tip(np.arange(len(points)) < 0) == 4
    assert faces_at_tip(np.arange(len(points)) == alone) == 3


def shell(random, radius: float, count: int, squeezed: float) -> np.ndarray:
    outward = random.normal(size=(count, 3))
    return radius * outward / np.linalg.norm(outward, axis=1, keepdims=True) * [1, 1, squeezed]


def test_an_inner_surface_that_a_label_meets_stays_a_manifold():
    random = np.random.default_rng(110)  # there, a join along an edge of the label pinched the surface
    squeezed = random.choice([1, 0.3])
    outer = shell(random, 10, int(random.integers(40, 250)), squeezed)
    inner = shell(random, random.uniform(6, 9.5), int(random.integers(30, 200)), squeezed)
    points = np.concatenate([outer, inner, shell(random, 3, int(random.integers(0, 30)), squeezed)])
    cells = positive(points, Delaunay(points).simplices.astype(np.int32))
    region = np.where((cells >= len(outer)).all(axis=1), 2, 1).astype(np.int32)
    mesh = TetMesh(points, cells, cell_data={REGION: region})
    label = np.where((region == 2) & (points[cells].mean(axis=1)[:, 0] > 0), 3, region).astype(np.int32)
    whole, white = topology.boundary_surface(mesh)[0], topology.sheet(mesh, 1)[0]
    surface = TriSurface(whole.points, whole.faces, inner={"white": white})
    mu2 = np.asarray(mu2_of(quality(points, cells)))
    threshold = float(mu2_of(random.choice([0.2, 0.4, 0.6])))
    gain = float(random.choice([0.995, 1.25, 1.6]))
    made, _ = insert_vertices(mesh, mu2, label, threshold, gain=gain, tree=forest(surface))
    assert not np.isin(points, made.points).all(), "vertices are removed"
    assert topology.surface_topology(topology.sheet(made, 1)[0].faces).is_closed_manifold


def test_a_vertex_of_five_hundred_tetrahedra_that_all_have_their_own_label_stays():
    points = np.concatenate([shell(np.random.default_rng(0), 10, 255, 1), np.zeros((1, 3))])
    faces = ConvexHull(points).simplices.astype(np.int32)
    cells = positive(points, np.column_stack([faces, np.full(len(faces), 255, np.int32)]))
    mesh = TetMesh(points, cells)
    mu2 = np.asarray(mu2_of(quality(points, cells)))
    tree = forest(TriSurface(points[:255], topology.boundary_faces(mesh)))
    label = np.arange(len(cells), dtype=np.int32)
    made, _ = insert_vertices(mesh, mu2, label, float(mu2_of(0.2)), tree=tree)
    assert np.array_equal(made.points, points)
