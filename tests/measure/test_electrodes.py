"""Contacts of electrodes on a mesh; potentials of scikit-fem with their loads, beside those that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem
from scipy.sparse import diags
from scipy.sparse.linalg import cg
from scipy.special import eval_legendre
from shapes import ball_surface, shell_mesh
from skfem.models.poisson import laplace

from cortet.errors import InputError
from cortet.formats.electrodes import Contact
from cortet.geometry.topology import boundary_nodes
from cortet.measure.electrodes import electrode_remarks, seated, with_electrodes
from cortet.measure.quality import signed_volumes
from cortet.meshes import FILLED, REGION, FloatArray, TetMesh
from cortet.stages.generate import generate

#: S/mm
SIGMA = 0.33e-3


def potential(mesh: TetMesh, load: FloatArray, fixed: np.ndarray, values: FloatArray) -> FloatArray:
    """The potential, V, of currents (n,), A, into the nodes, with given values at some nodes."""
    tetrahedra = skfem.MeshTet(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    matrix = SIGMA * laplace.assemble(skfem.Basis(tetrahedra, skfem.ElementTetP1()))
    free = np.setdiff1d(np.arange(len(mesh.points)), fixed)
    found = np.zeros(len(mesh.points))
    found[fixed] = values
    inner, right = matrix[free][:, free], load[free] - matrix[free][:, fixed] @ values
    found[free], failed = cg(inner, right, rtol=1e-8, M=diags(1 / inner.diagonal()))
    assert not failed
    return found


def block(inner: float, outer: float, finest: float) -> TetMesh:
    """The block |x|, |y| <= outer, -outer <= z <= 0 of bricks that grow outside the inner one, six tetrahedra each."""
    half = [*np.arange(0, inner + finest / 2, finest)]
    while half[-1] < outer:
        half.append(half[-1] + 1.35 * (half[-1] - half[-2]))
    x, z = np.array([-one for one in half[:0:-1]] + half), -np.array(half[::-1])
    points = np.stack(np.meshgrid(x, x, z, indexing="ij"), axis=3).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(x), len(x), len(z))
    first = number[:-1, :-1, :-1].ravel()
    step = np.array([number[1, 0, 0], number[0, 1, 0], 1])
    orders = ([0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0])
    cells = np.concatenate([first[:, None] + np.cumsum([0, *step[order]]) for order in orders])
    wrong = signed_volumes(points, cells) < 0
    cells[wrong] = cells[wrong][:, [1, 0, 2, 3]]
    return TetMesh(points, cells)


@pytest.mark.parametrize(("across", "error"), [(5, 0.03), pytest.param(12, 0.01, marks=pytest.mark.thorough)])
def test_the_mean_potential_below_a_disc_on_a_half_space(across, error):
    """8 / (3 pi^2 sigma a) for a uniform current; a block of 48 a, with the potential of the half-space around it."""
    radius = 2.0
    mesh = block(1.5 * radius, 24 * radius, radius / across)
    mesh, (record,) = with_electrodes(mesh, [Contact("A1", (0.03, -0.05, 0.0), radius)])
    load = mesh.point_data["electrode_A1"]
    edge = np.flatnonzero((np.abs(mesh.points[:, :2]).max(axis=1) > 24 * radius) | (mesh.points[:, 2] < -24 * radius))
    far = 1 / (2 * np.pi * SIGMA * np.linalg.norm(mesh.points[edge] - record.location_mm, axis=1))
    mean = load @ potential(mesh, load, edge, far)
    assert record.area_mm2 == pytest.approx(np.pi * radius**2, rel=1e-12)
    assert mean == pytest.approx(8 / (3 * np.pi**2 * SIGMA * radius), rel=error)


def ball(radius: float, cell_size: float, *contacts: Contact) -> tuple[TetMesh, FloatArray]:
    """A ball with two contacts, and the potential, V, when 1 A flows from the first to the second."""
    mesh, _ = generate(ball_surface(6, radius=radius), cell_size=cell_size)
    mesh, records = with_electrodes(mesh, contacts)
    into, out = (mesh.point_data[f"electrode_{record.name}"] for record in records)
    found = potential(mesh, into - out, np.array([0]), np.zeros(1))
    skin = boundary_nodes(mesh)
    return mesh, found - found[skin].mean()


@pytest.mark.parametrize(("cell_size", "error"), [(1.4, 0.03), pytest.param(0.7, 0.01, marks=pytest.mark.thorough)])
def test_two_contacts_on_a_sphere(cell_size, error):
    radius, contact = 20.0, 4.0
    both = Contact("top", (0, 0, radius), contact), Contact("bottom", (0, 0, -radius - 0.5), contact)
    mesh, found = ball(radius, cell_size, *both)
    skin = boundary_nodes(mesh)
    cosine = mesh.points[skin, 2] / np.linalg.norm(mesh.points[skin], axis=1)
    cap = np.sqrt(1 - (contact / radius) ** 2)
    density = 1 / (2 * np.pi * radius**2 * (1 - cap))
    truth = np.zeros(len(skin))
    for n in range(1, 200, 2):
        part = density / 2 * (eval_legendre(n - 1, cap) - eval_legendre(n + 1, cap))
        truth += 2 * part * radius / (SIGMA * n) * eval_legendre(n, cosine)
    truth -= truth.mean()
    assert np.linalg.norm(found[skin] - truth) < error * np.linalg.norm(truth)


def test_point_sources_inside_a_sphere():
    """Wilson and Bayley's closed form at the surface, for a source and a sink."""
    radius, source, sink = 20.0, np.array([2.3, -1.1, 9.7]), np.array([-6.2, 3.4, -4.8])
    mesh, found = ball(radius, 2.0, Contact("source", tuple(source), None), Contact("sink", tuple(sink), None))
    skin = boundary_nodes(mesh)
    points = mesh.points[skin] * radius / np.linalg.norm(mesh.points[skin], axis=1, keepdims=True)

    def alone(point: FloatArray) -> FloatArray:
        way = np.linalg.norm(points - point, axis=1)
        logarithm = np.log((radius**2 - points @ point + radius * way) / (2 * radius**2))
        return (2 / way - logarithm / radius) / (4 * np.pi * SIGMA)

    truth = alone(source) - alone(sink)
    truth -= truth.mean()
    assert np.linalg.norm(found[skin] - truth) < 0.02 * np.linalg.norm(truth)


def test_a_disc_has_its_faces_and_a_point_its_tetrahedron():
    mesh = shell_mesh(20.0, 10.0, 5, subdivisions=4)
    mesh = replace(mesh, cell_data={REGION: np.ones(len(mesh.cells), np.int32)})
    contacts = [Contact("A1", (0, 0, 20.7), 3.0), Contact("B1", (12.3, 2, 1), None), Contact("C'1", (0, 20.9, 0), None)]
    made, records = with_electrodes(mesh, contacts)
    assert [record.kind for record in records] == ["disc", "point", "point"]
    assert [round(record.moved_mm, 1) for record in records] == [0.7, 0.0, 0.9]
    assert records[0].area_mm2 == pytest.approx(np.pi * 9, rel=0.02)
    assert records[0].faces == len(made.sets.faces["electrode_A1"]) > 5
    assert len(made.sets.cells["electrode_B1"]) == len(made.sets.faces["electrode_C'1"]) == 1
    for name in ("A1", "B1", "C'1"):
        assert made.point_data[f"electrode_{name}"].sum() == pytest.approx(1, abs=1e-12)
    there = made.point_data["electrode_B1"] @ made.points
    assert there == pytest.approx([12.3, 2, 1], abs=1e-9)
    assert set(made.cells[made.sets.cells["electrode_B1"][0]]) >= set(np.flatnonzero(made.point_data["electrode_B1"]))
    assert set(made.sets.faces["electrode_A1"].ravel()) == set(np.flatnonzero(made.point_data["electrode_A1"]))


def test_what_a_user_should_know_is_said_by_name():
    mesh = shell_mesh(20.0, 10.0, 5)
    filled = (mesh.points[:, 2] > 15).astype(np.int32)
    mesh = replace(mesh, point_data={FILLED: filled})
    contacts = [Contact("A1", (0, 0, 20), 3.0), Contact("A2", (0, 4, 20), 3.0), Contact("B1", (20, 0, 0), 18.0)]
    made, records = with_electrodes(mesh, contacts)
    told = electrode_remarks(made, records)
    assert "electrode A1: 100% of it lies on a part of the surface that repair made" in told
    coarse = [one for one in told if "edges of the mesh span the radius" in one]
    assert len(coarse) == 1 and "and 1 other: only" in coarse[0], "one remark for a grid of contacts"
    assert any(one.startswith("electrode B1 touches 1") for one in told)
    assert "electrodes A1 and A2 overlap on the mesh" in told


def test_a_contact_too_small_for_any_mesh_is_to_become_a_point():
    made, records = with_electrodes(shell_mesh(20.0, 10.0, 5), [Contact("A1", (0, 0, 20), 0.01)])
    (told,) = electrode_remarks(made, records)
    assert "leave the radius out" in told and "cell size" not in told


def test_the_label_at_a_contact_is_the_one_with_most_of_it():
    mesh = shell_mesh(20.0, 10.0, 5, subdivisions=4)
    upper = np.where(mesh.points[:, 2] > 0, 7, -2).astype(np.int32)
    of_cells = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 2] > 0, 3, 4).astype(np.int32)
    mesh = replace(mesh, point_data={"lobe": upper, "sulc": upper * 1.0}, cell_data={"tissue": of_cells})
    contacts = [Contact("A1", (20, 0, 2), 3.0), Contact("A2", (20, 0, -2), 1.0), Contact("B1", (0, 0, -15), None)]
    _, records = with_electrodes(mesh, contacts)
    expected = [{"lobe": 7, "tissue": 3}, {"lobe": -2, "tissue": 4}, {"lobe": -2, "tissue": 4}]
    assert [record.labels for record in records] == expected


@pytest.mark.parametrize(
    ("contacts", "words"),
    [
        ([Contact("A1", (0, 0, 23), 1.0)], r"electrode A1 at \(0.00, 0.00, 23.00\) mm lies 3.0 mm outside"),
        ([Contact("A1", (0, 0, 20), 2.0), Contact("A2", (0, 3, 19.8), 2.0)], "electrodes A1 and A2 overlap"),
        ([Contact("A1", (1, 2, 3), None), Contact("A2", (1, 2, 3), None)], "electrodes A1 and A2 overlap"),
        ([Contact(name, (0, 0, 23), 1.0) for name in ("A1", "A2", "A3")], "A1 .* 3.0 mm outside.*likewise A2, A3"),
        ([Contact(name, (1, 2, 3), None) for name in ("A1", "A2", "A3")], "likewise A1 and A3, A2 and A3"),
    ],
)
def test_contacts_that_cannot_be_are_refused_before_the_work(contacts, words):
    with pytest.raises(InputError, match=words):
        seated(contacts, ball_surface(4, radius=20.0))


def test_a_contact_near_the_surface_is_put_onto_it_and_a_deep_one_stays():
    given = [Contact("A1", (0, 0, 21.5), 1.0), Contact("A2", (0, 18.5, 0), 1.0), Contact("B1", (15, 0, 0), 1.0)]
    found = seated(given, ball_surface(5, radius=20.0))
    assert np.linalg.norm(found, axis=1) == pytest.approx([20, 20, 15], abs=0.02)


def test_cells_shrink_around_contacts_on_the_surface_and_inside():
    surface = ball_surface(5, radius=20.0)
    plain, _ = generate(surface, cell_size=2.5)
    fine, _ = generate(surface, cell_size=2.5, contacts=((0, 0, 20, 4.0), (0, 0, -6, 4.0)))

    def edge(mesh: TetMesh, point: FloatArray) -> float:
        near = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1) - point, axis=1) < 3
        volumes = signed_volumes(mesh.points, mesh.cells[near])
        return float(np.median(np.cbrt(6 * np.sqrt(2) * volumes)))

    for point in ([0, 0, 20], [0, 0, -6]):
        assert edge(fine, np.array(point)) < 0.6 * edge(plain, np.array(point))
    assert edge(fine, np.array([15, 0, 0])) == pytest.approx(edge(plain, np.array([15, 0, 0])), rel=0.15)
