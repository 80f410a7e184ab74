"""S1 fills a closed surface, reproducibly, and never hides a wrong topology."""

import dataclasses

import numpy as np
import pytest
from shapes import ball_surface, horseshoe, torus

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import boundary_faces, boundary_nodes, enclosed_volume, surface_topology
from cortet.measure.quality import circumradii, quality, signed_volumes
from cortet.meshers._cgal import PASSES
from cortet.meshers.cgal import installed_backend
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.generate import generate

pygalmesh = pytest.param(
    "pygalmesh",
    marks=pytest.mark.skipif(installed_backend() != "pygalmesh", reason="pygalmesh could not be built here"),
)


each_backend = pytest.mark.parametrize("backend", [pygalmesh, "cgal"])
REFINEMENT_ONLY = {"odt": False, "lloyd": False, "perturb": False, "exude": False}


def is_sound(mesh: TetMesh) -> bool:
    """Positive volumes that add up to what the boundary encloses, and every node used."""
    volumes = signed_volumes(mesh.points, mesh.cells)
    enclosed = enclosed_volume(mesh.points, boundary_faces(mesh))
    return (
        volumes.min() > 0
        and np.isclose(volumes.sum(), enclosed, rtol=1e-9)
        and len(np.unique(mesh.cells)) == len(mesh.points)
    )


@each_backend
def test_a_ball_is_filled_with_good_tetrahedra(backend):
    mesh, report = generate(ball_surface(), Generate(backend=backend), cell_size=1.0, mesher="cgal")
    assert is_sound(mesh)
    assert surface_topology(boundary_faces(mesh)).problems() == []
    assert np.isclose(signed_volumes(mesh.points, mesh.cells).sum(), 4 / 3 * np.pi * 5**3, rtol=0.05)
    on_boundary = np.linalg.norm(mesh.points[boundary_faces(mesh)], axis=2)
    assert on_boundary.min() > 4.9 and on_boundary.max() <= 5.0 + 1e-9
    q = quality(mesh.points, mesh.cells)
    assert q.mean() < 0.2 and q.max() < 0.85
    assert report.topology_ok and report.reason == "" and report.passes == PASSES
    assert (report.nodes, report.tetrahedra, report.backend) == (len(mesh.points), len(mesh.cells), backend)
    assert report.facet_distance_mm == 0.5 * report.cell_size_mm and report.seed == 0


@each_backend
def test_a_pinched_slit_is_opened_by_a_tighter_facet_distance(backend):
    mesh, report = generate(
        horseshoe(gap=0.4), Generate(backend=backend, **REFINEMENT_ONLY), cell_size=1.5, mesher="cgal"
    )
    assert [bool(attempt.problems) for attempt in report.attempts] == [True, True, True, False]
    assert report.topology_ok and report.facet_distance_mm == pytest.approx(0.05 * 1.5)
    assert surface_topology(boundary_faces(mesh)).problems() == [] and is_sound(mesh)


@each_backend
def test_the_published_setting_does_not_retry_and_says_that_it_failed(backend):
    mesh, report = generate(
        horseshoe(gap=0.4), Generate(backend=backend, facet_distance=[0.5], fallback=None), cell_size=1.5, mesher="cgal"
    )
    assert len(report.attempts) == 1 and report.attempts[0].passes == PASSES
    assert not report.topology_ok
    assert report.reason == "; ".join(surface_topology(boundary_faces(mesh)).problems()) != ""


def test_where_no_facet_distance_helps_a_lattice_fills_the_surface():
    surface = horseshoe(gap=0.4)
    mesh, report = generate(surface, Generate(backend="cgal", facet_distance=[0.5, 0.4]), cell_size=1.5, mesher="cgal")
    assert (report.mesher, report.backend, report.passes) == ("cgal", "tetgen", ())
    assert report.facet_distance_mm is None and report.edge_length_mm is not None
    assert [attempt.edge_length_mm is None for attempt in report.attempts[:3]] == [True, True, False]
    assert report.topology_ok and is_sound(mesh)


def test_a_lattice_fills_a_ball_with_better_tetrahedra_and_keeps_its_boundary_on_it():
    ball = ball_surface(4)
    mesh, report = generate(ball, cell_size=0.8, mesher="lattice")
    assert is_sound(mesh) and report.topology_ok and report.seed == 0
    assert surface_topology(boundary_faces(mesh)).problems() == []
    q = quality(mesh.points, mesh.cells)
    assert q.mean() < 0.13 and q.max() < 0.45
    tree = surface_tree(ball.points, ball.faces)
    assert closest_points(tree, mesh.points[np.unique(boundary_faces(mesh))]).distances.max() < 1e-12
    radii = circumradii(mesh.points, mesh.cells) / 0.8
    assert 0.8 < np.median(radii) < 0.9 and np.quantile(radii, 0.98) < 1.02 and radii.max() < 1.3, "cell size"


def test_a_coarser_core_leaves_the_cortex_as_fine():
    def cells_per_mm3(mesh: TetMesh, inner: float, outer: float) -> float:
        radii = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
        return np.sum((radii >= inner) & (radii < outer)) / (4 / 3 * np.pi * (outer**3 - inner**3))

    ball = ball_surface(4)
    even, _ = generate(ball, cell_size=0.5, mesher="lattice")
    graded, _ = generate(ball, Generate(core_ratio=2.0, core_depth=2.0), cell_size=0.5, mesher="lattice")
    assert is_sound(graded) and quality(graded.points, graded.cells).max() < 0.5
    assert cells_per_mm3(graded, 3.6, 5.0) == pytest.approx(cells_per_mm3(even, 3.6, 5.0), rel=0.1)
    assert cells_per_mm3(graded, 0.0, 2.0) < cells_per_mm3(even, 0.0, 2.0) / 5


def test_a_field_of_sizes_makes_cells_smaller_there():
    ball = ball_surface(4)
    size = np.where(ball.points[:, 2] > 3, 0.4, 5.0)
    fine, _ = generate(
        dataclasses.replace(ball, point_data={"size": size}),
        Generate(size_field="size"),
        cell_size=0.8,
        mesher="lattice",
    )
    even, _ = generate(ball, cell_size=0.8, mesher="lattice")

    def radius(mesh: TetMesh, top: bool) -> float:
        height = mesh.points[mesh.cells].mean(axis=1)[:, 2]
        return float(np.median(circumradii(mesh.points, mesh.cells)[height > 4 if top else height < 0]))

    assert is_sound(fine) and quality(fine.points, fine.cells).max() < 0.45
    assert radius(fine, top=True) == pytest.approx(radius(even, top=True) / 2, rel=0.3)
    assert radius(fine, top=False) == pytest.approx(radius(even, top=False), rel=0.02)


def test_a_closed_surface_is_meshed_whichever_way_it_is_turned_and_keeps_its_handles():
    plain = Generate(backend="cgal", **REFINEMENT_ONLY)
    ring, ball = torus(5, 2), ball_surface()
    mesh, report = generate(ring, plain, cell_size=1.0, mesher="cgal")
    assert report.topology_ok and surface_topology(boundary_faces(mesh)).genus == 1
    inward = TriSurface(np.concatenate([ball.points, [[99, 99, 99]]]), ball.faces[:, ::-1])
    mesh, _ = generate(inward, plain, cell_size=1.5, mesher="cgal")
    assert is_sound(mesh) and np.abs(mesh.points).max() < 5.01


def test_a_seed_makes_another_mesh_of_the_same_surface_with_cgal_too():
    ball = ball_surface(3)
    usual, turned = (
        generate(ball, Generate(backend="cgal", seed=seed, **REFINEMENT_ONLY), cell_size=1.5, mesher="cgal")[0]
        for seed in (0, 1)
    )
    assert len(usual.points) != len(turned.points) or not np.allclose(usual.points, turned.points)
    nodes = turned.points[boundary_nodes(turned)]
    assert closest_points(surface_tree(ball.points, ball.faces), nodes).distances.max() < 1e-3


OPENED = TriSurface(ball_surface(2).points, ball_surface(2).faces[1:])


@pytest.mark.parametrize(
    ("surface", "facts", "word"),
    [
        *((ball_surface(2), {"cell_size": size}, "cell size") for size in (0.0, 0.001, 300.0, np.nan)),
        (ball_surface(2), {"cell_size": 1.0, "mesher": "hexes"}, "'hexes'"),
        (OPENED, {"cell_size": 1.0}, "3 open edges"),
    ],
)
def test_what_cannot_be_meshed_is_refused(surface, facts, word):
    with pytest.raises(InputError, match=word):
        generate(surface, **facts)


@pytest.mark.parametrize(
    ("name", "values", "mesher", "word"),
    [
        ("a", np.ones(162), "lattice", "no field size"),
        ("size", np.r_[np.ones(161), 0.1], "lattice", "0.1 at vertex 161"),
        ("size", np.r_[np.nan, np.ones(161)], "lattice", "vertex 0"),
        ("size", np.ones((162, 3)), "lattice", "per vertex"),
        ("size", np.ones(162), "cgal", "mesher cgal"),
    ],
)
def test_fields_that_are_no_sizes_are_refused(name, values, mesher, word):
    surface = dataclasses.replace(ball_surface(2), point_data={name: values})
    with pytest.raises(InputError, match=word):
        generate(surface, Generate(size_field="size"), cell_size=0.8, mesher=mesher)
