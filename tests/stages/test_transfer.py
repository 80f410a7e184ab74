"""Fields of the surface reach every node of its mesh."""

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh, ball_surface
from threadpoolctl import threadpool_limits

from cortet.config.stages import Generate, Transfer
from cortet.geometry.topology import boundary_nodes
from cortet.measure.harmonic import harmonic
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.generate import generate
from cortet.stages.transfer import transfer


@pytest.fixture(scope="module")
def ball() -> TriSurface:
    surface = ball_surface(3)
    x, y, z = surface.points.T
    fields = {
        "linear": 2 * x - y + 3 * z + 1,
        "vector": surface.points.astype(np.float32),
        "label": np.where(x > 0, 42, -7).astype(np.int32),
    }
    return TriSurface(surface.points, surface.faces, fields)


@pytest.fixture(scope="module")
def mesh(ball) -> TetMesh:
    return generate(
        ball, Generate(backend="cgal", odt=False, lloyd=False, perturb=False, exude=False), cell_size=1.0, mesher="cgal"
    )[0]


def test_a_linear_field_is_exact_on_the_surface_and_everywhere_with_harmonic_interpolation(ball, mesh):
    """It is linear on each triangle and harmonic inside."""
    carried, report = transfer(mesh, ball)
    nodes = boundary_nodes(mesh)
    x, y, z = mesh.points[nodes].T
    assert np.allclose(carried.point_data["linear"][nodes], 2 * x - y + 3 * z + 1, atol=1e-6)
    assert np.allclose(carried.point_data["vector"][nodes], mesh.points[nodes], atol=1e-6)
    assert report.max_distance_mm < 1e-6  # as near as CGAL puts nodes
    assert report.nodes_further_than_1mm == 0
    carried, report = transfer(mesh, ball, Transfer(interior="harmonic"))
    x, y, z = mesh.points.T
    assert np.allclose(carried.point_data["linear"], 2 * x - y + 3 * z + 1, atol=1e-5)
    assert report.interior == "harmonic"


@pytest.mark.parametrize("interior", ["nearest", "harmonic"])
def test_labels_are_never_mixed(ball, mesh, interior):
    carried, report = transfer(mesh, ball, Transfer(interior=interior))
    label = carried.point_data["label"]
    assert label.dtype == np.int32 and set(label) == {42, -7}
    clear = (np.abs(mesh.points[:, 0]) > 1) & np.isin(np.arange(len(mesh.points)), boundary_nodes(mesh))
    assert np.array_equal(label[clear] == 42, mesh.points[clear, 0] > 0)
    assert report.fields == {"linear": "interpolated", "vector": "interpolated", "label": "label"}
    surface = TriSurface(
        [[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4.0]],
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        {"label": np.array([1, 2, 3, 4])},
    )
    near = TetMesh([[0.5, 0.5, 0], [2.5, 0.5, 0], [0.5, 2.5, 0], [0.4, 0.4, 2.6]], [[0, 1, 2, 3]])
    assert transfer(near, surface)[0].point_data["label"].tolist() == [1, 2, 3, 4], "of the largest weight"


def test_interior_nodes_take_the_value_of_their_nearest_boundary_node(ball, mesh):
    carried, _ = transfer(mesh, ball)
    nodes = boundary_nodes(mesh)
    interior = np.setdiff1d(np.arange(len(mesh.points)), nodes)
    distance = np.linalg.norm(mesh.points[interior, None] - mesh.points[nodes], axis=2)
    nearest = nodes[distance.argmin(axis=1)]
    assert np.array_equal(carried.point_data["linear"][interior], carried.point_data["linear"][nearest])


def test_fields_of_the_mesh_stay_unless_carried_anew(ball, mesh):
    own = {"mine": np.arange(len(mesh.points)), "label": np.zeros(len(mesh.points), np.int32)}
    carried, _ = transfer(TetMesh(mesh.points, mesh.cells, own), ball)
    assert np.array_equal(carried.point_data["mine"], own["mine"])
    assert carried.point_data["label"].any()


def test_a_harmonic_field_has_the_same_bits_on_any_number_of_threads():
    mesh = cube_mesh(24, jitter=0.2)  # more than 10,000 nodes inside: BLAS takes shorter vectors on one thread
    nodes = boundary_nodes(mesh)
    values, start = np.random.default_rng(0).normal(size=(len(nodes), 1)), np.zeros((len(mesh.points), 1))
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            found.append(harmonic(mesh, nodes, values, start).tobytes())
    assert found[0] == found[1]


def test_a_harmonic_field_converges_to_the_harmonic_function():
    errors = []
    for n in (4, 8, 16):
        cube = cube_mesh(n, side=1.0, jitter=0.1)
        x, y, z = cube.points.T
        exact = (x**2 - y**2 + 2 * x * y * z)[:, None]
        nodes = boundary_nodes(cube)
        found = harmonic(cube, nodes, exact[nodes], np.zeros_like(exact))
        errors.append(np.abs(found - exact).max())
    assert errors[2] < errors[1] / 2 < errors[0] / 4


@pytest.mark.parametrize("seed", range(3))
def test_a_harmonic_field_stays_within_the_range_of_the_boundary(seed):
    """Slivers, whose obtuse angles break the discrete maximum principle, and boundary values at random."""
    mesh = squeezed(ball_mesh(3, radius=5.0))
    nodes = boundary_nodes(mesh)
    values = np.random.default_rng(seed).uniform(0.2, 1, (len(nodes), 2))
    found = harmonic(mesh, nodes, values, np.full((len(mesh.points), 2), 0.5))
    assert (found >= values.min(axis=0)).all() and (found <= values.max(axis=0)).all()
    inside = np.setdiff1d(np.arange(len(mesh.points)), nodes)
    assert np.ptp(found[inside]) > 0.01


def squeezed(mesh: TetMesh, share: float = 0.1) -> TetMesh:
    """Flat in one direction, which makes dihedral angles obtuse."""
    return TetMesh(mesh.points * [1, 1, share], mesh.cells)
