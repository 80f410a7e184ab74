"""S4+: swaps and moves together reach what moves alone cannot."""

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config.stages import Reconnect
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise import reconnection
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


def test_tetrahedra_that_no_search_mends_do_not_keep_the_next_one_from_the_others(cleaned, monkeypatch):
    """In thin cortex all searches were around the same 55 tetrahedra, and 3,600 others were left."""
    aims = []

    def in_vain(mesh, flaws_of, surface, aim, threshold, boundary):  # type: ignore[no-untyped-def]
        aims.append(aim)
        return mesh, 0

    monkeypatch.setattr(reconnection, "searched", in_vain)
    reconnect(cleaned, SURFACE, Reconnect(threshold=0.15))
    assert len(aims) > 2 and (np.diff(aims) < 0).all()
