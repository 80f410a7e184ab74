"""Banks of a narrow sulcus must not pass through each other while a mesh is optimised."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import horseshoe

from cortet.config.stages import Generate
from cortet.geometry import topology
from cortet.geometry.banks import banks as smallest
from cortet.geometry.limits import LEAST_BANK_GAP
from cortet.meshes import IntArray, TetMesh, TriSurface
from cortet.optimise.crossing import crossing_faces, flaws_since, without_crossing
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
        surface,
        Generate(facet_distance=(0.05, 0.02), backend="cgal", odt=False, lloyd=False),
        cell_size=1.2,
        mesher="cgal",
    )
    assert report.topology_ok and len(crossing_faces(result)) == 0
    return result


def bank_nodes(mesh: TetMesh) -> IntArray:
    """Nodes of the two flat ends."""
    nodes = topology.boundary_nodes(mesh)
    return nodes[(np.abs(mesh.points[nodes, 1]) <= GAP) & (mesh.points[nodes, 0] > 3.5)]


def test_sliding_and_swapping_next_to_a_narrow_gap_keep_the_banks_apart(mesh, surface):
    kept = np.arange(0, len(mesh.points), 3, dtype=np.int32)
    held, report = clean(mesh, surface, held=kept)
    assert np.array_equal(held.points[kept], mesh.points[kept]) and report.vertices_held >= len(kept)
    cleaned, report = clean(mesh, surface)
    assert report.q_max < report.q_max_before and len(crossing_faces(cleaned)) == 0
    swapped, report = reconnect(cleaned, surface)
    assert report.q_max < 0.6 and len(crossing_faces(swapped)) == 0
    assert topology.surface_topology(topology.boundary_faces(swapped)).euler_number == 2


def test_vertices_that_cross_are_held_and_the_others_still_move(mesh):
    """Both banks, and a vertex elsewhere, are pushed by a whole gap's width: only the banks end in each other."""
    nodes, banks = topology.boundary_nodes(mesh), bank_nodes(mesh)
    elsewhere = nodes[np.argmin(mesh.points[nodes, 0])]
    numbered = replace(mesh, point_data={"number": np.arange(len(mesh.points))})

    def push(start: TetMesh, held: IntArray) -> tuple[TetMesh, str]:
        shift = np.zeros_like(start.points)
        number = start.point_data["number"]
        shift[:, 1] = np.where(np.isin(number, banks), -GAP * np.sign(start.points[:, 1]), 0)
        shift[number == elsewhere, 0] = 0.01
        shift[held] = 0
        return replace(start, points=start.points + shift), f"{len(held)} held"

    crossed, _ = push(numbered, np.zeros(0, np.int32))
    assert len(crossing_faces(crossed)) > 0
    result, report, held = without_crossing(numbered, push)
    assert len(crossing_faces(result)) == 0
    assert report == "0 held" and np.isin(held, banks).any() and elsewhere not in held
    assert result.points[elsewhere, 0] == mesh.points[elsewhere, 0] + 0.01
    undone, _, held = without_crossing(numbered, lambda start, _: push(start, np.zeros(0, np.int32)))
    assert len(crossing_faces(undone)) == 0 < len(held), "what crosses whatever is held stays undone"


def test_banks_that_almost_close_their_gap_are_held_though_nothing_crosses(mesh, surface):
    banks, numbered = bank_nodes(mesh), replace(mesh, point_data={"number": np.arange(len(mesh.points))})

    def close(start: TetMesh, held: IntArray) -> tuple[TetMesh, None]:
        points = start.points.copy()
        points[np.setdiff1d(np.flatnonzero(np.isin(start.point_data["number"], banks)), held), 1] *= 0.002
        return replace(start, points=points), None

    def least_share(of: TetMesh) -> float:
        return smallest(topology.boundary_surface(of)[0], surface).least_share

    closed, _ = close(numbered, np.zeros(0, np.int32))
    assert len(crossing_faces(closed)) == 0 and least_share(closed) < LEAST_BANK_GAP < least_share(mesh)
    result, _, held = without_crossing(numbered, close, surface, cell_size=1.2)
    assert len(crossing_faces(result)) == 0 and least_share(result) >= LEAST_BANK_GAP and np.isin(held, banks).any()
    assert not flaws_since(closed, surface, 1.2)(closed).met.size  # what is there from the beginning does not count


def test_a_crest_that_vertices_slide_away_from_is_held_by_the_vertex_that_covered_it(mesh):
    """The top of the ring sinks by half a cell: the vertex nearest to it is told."""
    surface = topology.boundary_surface(mesh)[0]
    top = int(topology.boundary_nodes(mesh)[np.argmax(surface.points[:, 2])])
    points = mesh.points.copy()
    points[top, 2] -= 1.2
    flaws = flaws_since(mesh, surface, cell_size=0.6)
    assert not flaws(mesh)
    found = flaws(replace(mesh, points=points))
    assert not len(found.met) and found.to_hold(np.zeros(0, np.int32)).tolist() == [top]
    assert not flaws_since(mesh, surface, cell_size=5.0)(replace(mesh, points=points))
