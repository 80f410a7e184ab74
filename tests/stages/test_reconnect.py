"""S4+: swaps and moves together reach what moves alone cannot."""

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh, ball_surface

from cortet.config.stages import Reconnect
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.crossing import Flaws
from cortet.optimise.reconnection import searched
from cortet.stages.clean import clean
from cortet.stages.reconnect import reconnect

SURFACE = ball_surface(2, 1.0)


@pytest.fixture(scope="module")
def cleaned() -> TetMesh:
    return clean(ball_mesh(), SURFACE)[0]


@pytest.mark.parametrize("insert", [False, True])
def test_worst_element_falls_and_everything_else_holds(cleaned, insert):
    result, report = reconnect(cleaned, SURFACE, Reconnect(insert=insert))
    q = quality(result.points, result.cells)
    assert report.q_max == q.max() < quality(cleaned.points, cleaned.cells).max()
    assert report.q_mean <= report.q_mean_before
    assert (signed_volumes(result.points, result.cells) > 0).all()
    faces = topology.boundary_faces(result)
    found = topology.surface_topology(faces)
    assert found.is_closed_manifold and found.genus == 0
    assert np.array_equal(np.unique(result.cells), np.arange(len(result.points)))
    assert (report.inserted > 0) == insert and (insert or len(result.points) == len(cleaned.points))
    nodes = topology.boundary_nodes(result)
    tree = surface_tree(SURFACE.points, SURFACE.faces)
    assert closest_points(tree, result.points[nodes]).distances.max() < 1e-12


def test_fixed_boundary_keeps_its_triangles(cleaned):
    result, report = reconnect(cleaned, SURFACE, Reconnect(boundary="fixed"))
    before, after = ({tuple(sorted(face)) for face in topology.boundary_faces(m).tolist()} for m in (cleaned, result))
    assert before == after and report.boundary_flips == report.peeled == 0
    assert report.edge_removals > 0


def test_labels_keep_their_interface_and_values_follow(cleaned):
    above = cleaned.points[cleaned.cells].mean(axis=1)[:, 2] > 0
    mesh = TetMesh(cleaned.points, cleaned.cells, cell_data={"region": 1 + above.astype(np.int32)})

    def interface(m: TetMesh) -> set:
        halves = [
            np.sort(m.cells[m.cell_data["region"] == k][:, topology.TET_FACES].reshape(-1, 3)).tolist() for k in (1, 2)
        ]
        return set(map(tuple, halves[0])) & set(map(tuple, halves[1]))

    result, report = reconnect(mesh, SURFACE, Reconnect(insert=False))
    assert report.edge_removals > 0
    assert len(result.cell_data["region"]) == len(result.cells)
    assert interface(result) == interface(mesh)
    more, _ = reconnect(mesh, SURFACE)
    assert len(more.cell_data["region"]) == len(more.cells) and len(interface(more)) == len(interface(mesh))
    for k in (1, 2):
        before, after = (m.cells[m.cell_data["region"] == k] for m in (mesh, result))
        assert set(np.unique(after)) == set(np.unique(before))


def test_a_place_whose_boundary_a_search_spoils_stays_as_it_was():
    cube = cube_mesh(20, jitter=0.05)
    low, high = (int(np.argmin(np.linalg.norm(cube.points - place, axis=1))) for place in (0.2, 0.8))
    points = cube.points.copy()
    points[[low, high]] += 0.03
    mesh = TetMesh(points, cube.cells)
    before, tries = worst_beside(mesh, 0.5), []

    def flaws(tried: TetMesh) -> Flaws:
        """Any gain at the low corner makes the boundary cross itself there."""
        tries.append(worst_beside(tried, 0.5)[0] < before[0])
        there = int(np.argmin(np.linalg.norm(tried.points - points[low], axis=1)))
        crossed = np.full((int(tries[-1]), 3), there, np.int32)
        return Flaws(crossed, np.zeros((0, 3), np.int32))

    result, _ = searched(mesh, flaws, topology.boundary_surface(mesh)[0], 0.5, "fixed", most=200)
    after = worst_beside(result, 0.5)
    assert any(tries) and after[0] == before[0] and after[1] < before[1]


def worst_beside(mesh: TetMesh, x: float) -> tuple[float, float]:
    """The worst q on either side of a plane."""
    q, beyond = quality(mesh.points, mesh.cells), mesh.points[mesh.cells].mean(axis=1)[:, 0] > x
    return q[~beyond].max(), q[beyond].max()
