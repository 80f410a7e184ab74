"""Banks of a narrow sulcus must not pass through each other while a mesh is optimised."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import horseshoe

from cortet.geometry import topology
from cortet.mesh import IntArray, TetMesh, TriSurface
from cortet.optimise.crossing import crossing_faces, without_crossing
from cortet.stages.clean import clean
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect

GAP = 0.4  # mm, between the banks; the cells are three times as large


@pytest.fixture(scope="module")
def surface() -> TriSurface:
    return horseshoe(GAP)


@pytest.fixture(scope="module")
def mesh(surface: TriSurface) -> TetMesh:
    result, report = generate(
        surface, cell_size=1.2, facet_distance=(0.05, 0.02), backend="cgal", odt=False, lloyd=False
    )
    assert report.topology_ok and len(crossing_faces(result)) == 0
    return result


def test_sliding_and_swapping_next_to_a_narrow_gap_keep_the_banks_apart(mesh: TetMesh, surface: TriSurface) -> None:
    cleaned, report = clean(mesh, surface)
    assert report.q_max < report.q_max_before and len(crossing_faces(cleaned)) == 0
    swapped, report = reconnect(cleaned, surface)
    assert report.q_max < 0.6 and len(crossing_faces(swapped)) == 0
    assert topology.surface_topology(topology.boundary_faces(swapped)).euler_number == 2


def test_vertices_that_cross_are_held_and_the_others_still_move(mesh: TetMesh) -> None:
    """Both banks, and a vertex elsewhere, are pushed by a whole gap's width: only the banks end in each other."""
    nodes = topology.boundary_nodes(mesh)
    across = mesh.points[:, 1]
    banks = nodes[(np.abs(across[nodes]) <= GAP) & (mesh.points[nodes, 0] > 3.5)]
    elsewhere = nodes[np.argmin(mesh.points[nodes, 0])]

    def push(start: TetMesh, held: IntArray) -> tuple[TetMesh, str]:
        shift = np.zeros_like(start.points)
        shift[banks, 1] = -GAP * np.sign(across[banks])
        shift[elsewhere, 0] = 0.01
        shift[held] = 0
        return replace(start, points=start.points + shift), f"{len(held)} held"

    assert len(crossing_faces(push(mesh, np.zeros(0, np.int32))[0])) > 0
    result, report, held = without_crossing(mesh, push)
    assert len(crossing_faces(result)) == 0
    assert report == f"{len(held)} held" and np.isin(held, banks).any() and elsewhere not in held
    assert result.points[elsewhere, 0] == mesh.points[elsewhere, 0] + 0.01
