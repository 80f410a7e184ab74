"""Remeshing leaves no part of a surface behind: narrow sulci stay open and thin blades stay."""

import numpy as np
import pytest
import trimesh
from shapes import ball_surface, bowl, can, horseshoe, real_surface, torus

from cortet.errors import StageError
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_nodes, edges, enclosed_volume, face_areas, surface_topology
from cortet.measure.quality import quality
from cortet.meshers import _remesh
from cortet.meshers._nested import remesh_apart, wanted
from cortet.meshers._remesh import Remeshed, Wanted, coarsened, remesh, unsound
from cortet.meshes import FloatArray, TriSurface
from cortet.stages.generate import generate


def remeshed(surface: TriSurface, edge_length: float, distance: float = 0.4) -> Remeshed:
    return remesh(surface, wanted(surface, edge_length, distance)[0])


def edge_lengths(surface: TriSurface) -> FloatArray:
    start, end = edges(surface.faces).T
    return np.linalg.norm(surface.points[start] - surface.points[end], axis=1)


def left_behind(surface: TriSurface, made: TriSurface) -> float:
    """Largest distance of the surface's vertices and face centres to the triangles."""
    samples = np.concatenate([surface.points, surface.points[surface.faces].mean(axis=1)])
    return closest_points(surface_tree(made.points, made.faces), samples).distances.max()


def test_triangles_have_the_edge_length_and_stay_on_the_surface():
    ball = ball_surface(5, radius=10.0)
    made = remeshed(ball, 1.0).surface
    lengths = edge_lengths(made)
    assert lengths.mean() == pytest.approx(1.0, rel=0.1) and lengths.min() > 0.5 and lengths.max() < 1.75
    assert closest_points(surface_tree(ball.points, ball.faces), made.points).distances.max() < 1e-12
    assert surface_topology(made.faces).problems() == []
    assert enclosed_volume(made.points, made.faces) == pytest.approx(enclosed_volume(ball.points, ball.faces), rel=0.01)


def test_handles_are_kept_and_unused_vertices_ignored():
    torus = trimesh.creation.torus(major_radius=5, minor_radius=2)
    with_unused = TriSurface(np.concatenate([torus.vertices, [[99.0, 0, 0]]]), torus.faces)
    made = remeshed(with_unused, 1.0).surface
    assert surface_topology(made.faces).genus == 1 and np.abs(made.points).max() < 8


@pytest.mark.parametrize("surface", [can(200), can(200, rings=30, hub=24.9)])
def test_fans_of_long_thin_triangles_become_triangles_of_one_size(surface):
    made = remeshed(surface, 4.0, distance=0.4).surface
    area = face_areas(made.points, made.faces).sum()
    assert area == pytest.approx(2 * np.pi * 25 * (25 + 60), rel=0.01)
    assert len(made.faces) < 2 * area / (np.sqrt(3) / 4 * 4.0**2)
    assert not len(unsound(made)) and surface_topology(made.faces).problems() == []
    assert left_behind(surface, made) <= 0.4


def test_remeshing_that_needs_far_too_many_points_is_given_up(monkeypatch):
    monkeypatch.setattr(_remesh, "MOST_POINTS", (1, 1))
    with pytest.raises(StageError, match="points"):
        remeshed(can(200), 4.0)


def test_edges_are_no_longer_than_asked_for_at_each_vertex():
    ball = ball_surface(4)
    longest = np.where(ball.points[:, 2] > 4, 0.6, np.inf)
    (want,) = wanted(ball, 1.25, 0.4, longest=[longest])
    assert (want.size[ball.points[:, 2] > 4] == 0.6).all() and want.size.max() == 1.25
    made = remesh(ball, want)
    start = edges(made.surface.faces)[:, 0]
    top = made.surface.points[start, 2] > 4.3
    lengths = edge_lengths(made.surface)
    assert (
        lengths[top].mean() == pytest.approx(0.6, rel=0.15) and lengths[made.surface.points[start, 2] < 0].mean() > 1.1
    )


def test_a_coarse_surface_is_split():
    ball = ball_surface(2, radius=10.0)
    made = remeshed(ball, 0.8).surface
    assert edge_lengths(made).max() < 1.5 and left_behind(ball, made) < 0.01 * 10


@pytest.mark.parametrize(("surface", "edge_length"), [(can(6), 1.0), (can(250, hub=24.95), 4.0)])
def test_a_surface_of_splinters_without_end_is_split_all_the_same(surface, edge_length):
    made = remeshed(surface, edge_length).surface
    assert not len(unsound(made)) and surface_topology(made.faces).problems() == []


SLIT, BLADE = horseshoe(gap=0.3), bowl(thickness=0.5)


@pytest.mark.parametrize("surface", [SLIT, BLADE], ids=["a narrow slit", "a thin blade"])
def test_what_is_thin_stays_with_smaller_triangles_around_it(surface):
    (want,) = wanted(surface, 1.25, 0.4)
    made = remesh_apart(surface, [want])[0].surface
    assert not len(self_intersections(made)) and left_behind(surface, made) <= 0.4
    assert surface_topology(made.faces).problems() == []
    assert want.distance.min() < 0.4 and (want.size.min() < 1.0) == (surface is BLADE)
    (want,) = wanted(ball_surface(4), 1.25, 0.4)
    assert (want.size == 1.25).all() and (want.distance == 0.4).all()


def test_the_sulci_and_blades_of_a_real_brain_are_kept():
    surface = real_surface("folded/macaque_lh.YRK.wm")
    made = remesh_apart(surface, wanted(surface, 1.25, 0.4))[0].surface
    assert not len(self_intersections(made)) and left_behind(surface, made) <= 0.4
    assert len(made.points) < 9000


def test_a_surface_much_denser_than_its_cells_is_coarsened_first_and_stays_where_it_was():
    dense = ball_surface(6, radius=5.0)
    dense = TriSurface(dense.points, dense.faces, {"height": dense.points[:, 2]})
    coarse = coarsened(dense, 1.0, 0.3)
    assert len(coarse.points) < len(dense.points) / 4
    assert surface_topology(coarse.faces).problems() == [] and not len(unsound(coarse))
    tree = surface_tree(coarse.points, coarse.faces)
    assert closest_points(tree, dense.points).distances.max() <= 0.03
    assert np.abs(coarse.point_data["height"] - coarse.points[:, 2]).max() < 0.1
    assert coarsened(dense, 0.2, 0.06) is dense, "triangles of about this size stay"


def test_where_a_coarse_surface_would_cross_itself_the_given_triangles_stay(monkeypatch):
    dense = ball_surface(6, radius=5.0)
    everywhere = Wanted(np.full(len(dense.points), 0.25), np.full(len(dense.points), 0.03))
    crossing = iter([np.array([0]), np.array([], np.int64)])
    monkeypatch.setattr(_remesh, "self_intersections", lambda _: next(crossing))
    free, kept = len(_remesh._collapsed(dense, everywhere).points), coarsened(dense, 1.0, 0.3)
    assert free < len(kept.points) < len(dense.points) / 4


def test_a_dense_surface_gives_the_mesh_of_a_coarser_one_of_its_shape_with_its_boundary_on_the_surface():
    dense, usual = (ball_surface(level, radius=5.0) for level in (6, 4))
    meshes = [generate(one, cell_size=0.8)[0] for one in (dense, usual)]
    q = [quality(one.points, one.cells) for one in meshes]
    assert q[0].mean() == pytest.approx(q[1].mean(), abs=0.005) and len(q[0]) == pytest.approx(len(q[1]), rel=0.05)
    on = meshes[0].points[boundary_nodes(meshes[0])]
    assert closest_points(surface_tree(dense.points, dense.faces), on).distances.max() < 1e-9


def test_edges_on_both_sides_of_a_layer_follow_its_thickness_where_another_layer_is_near():
    for want in wanted(nested(torus(2.2, 1.5), {"white": torus(2.2, 1.0)}), 1.0, 0.3):
        assert want.size.max() < 0.65, "the layer is 0.5 thick around the hole, too"


def test_a_layer_too_thin_for_two_tetrahedra_gets_edges_for_one_and_no_length_between():
    thin = nested(torus(2.2, 1.5), {"white": torus(2.2, 1.0)})
    for edge_length, across, fits in ((1.0, 2, 1), (1.0, 1, 1), (0.8, 2, 2), (0.8, 3, 2)):
        for want in wanted(thin, edge_length, 0.3, across=across):
            assert want.size.max() == pytest.approx(1.25 * 0.5 / fits, rel=0.05), (edge_length, across)
