"""Ten-node tetrahedra: middles on the surface, elements valid everywhere, files that other programs read the same."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import gmsh
import meshio
import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh

from cortet.errors import InputError
from cortet.geometry.quadratic import EDGES, LEAST_JACOBIAN, QuadraticMesh, jacobian_bounds, quadratic
from cortet.geometry.topology import boundary_surface
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.sets import named_sets
from cortet.solver_files.ten_nodes import with_middles, write_ten_nodes

#: 4-point rule on a tetrahedron, exact for polynomials of degree 2, and the corners
RULE = 0.1381966011250105 + 0.4472135954999579 * np.eye(4)


@pytest.fixture(scope="module")
def ball() -> tuple[TetMesh, TriSurface]:
    """A coarse mesh of a ball whose boundary nodes are on a fine sphere of radius 1."""
    mesh = ball_mesh()
    fine, _ = boundary_surface(mesh)
    for _ in range(2):
        fine = refined(fine)
        fine = TriSurface(fine.points / np.linalg.norm(fine.points, axis=1, keepdims=True), fine.faces)
    return mesh, fine


def refined(surface: TriSurface) -> TriSurface:
    """Each triangle in four."""
    pairs = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    ends, number = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    a, b, c = surface.faces.T
    ab, bc, ca = (number.reshape(-1, 3) + len(surface.points)).T
    faces = np.concatenate([np.column_stack(part) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return TriSurface(np.concatenate([surface.points, surface.points[ends].mean(axis=1)]), faces)


def determinants(curved: QuadraticMesh, places: np.ndarray) -> np.ndarray:
    """Jacobian determinants (m, k) at barycentric places (k, 4), by the derivatives of the shape functions."""
    found = []
    for place in places:
        gradient = np.zeros((10, 4))
        gradient[range(4), range(4)] = 4 * place - 1
        for number, (i, j) in enumerate(EDGES):
            gradient[4 + number, i], gradient[4 + number, j] = 4 * place[j], 4 * place[i]
        slopes = (gradient[:, 1:] - gradient[:, :1]).T @ curved.points[curved.cells]
        found.append(np.linalg.det(slopes))
    return np.array(found).T


def test_a_ball_gets_its_volume_back(ball):
    mesh, surface = ball
    curved = quadratic(mesh, surface)
    corners, middles = np.split(curved.points, [len(mesh.points)])
    assert np.array_equal(corners, mesh.points) and np.array_equal(curved.cells[:, :4], mesh.cells)
    off = np.abs(np.linalg.norm(middles[curved.on_surface], axis=1) - 1) > 2e-3
    assert off.sum() <= curved.straightened_for_elements <= 0.01 * curved.curved
    straight = (corners[curved.ends[:, 0]] + corners[curved.ends[:, 1]]) / 2
    assert np.array_equal(middles[~curved.on_surface], straight[~curved.on_surface])
    volume = determinants(curved, RULE).sum() / 24
    lost = 4 / 3 * np.pi - signed_volumes(mesh.points, mesh.cells).sum()
    assert abs(4 / 3 * np.pi - volume) < 0.05 * lost


def test_the_bound_holds_everywhere_in_the_element():
    rng = np.random.default_rng(0)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    middles = corners[EDGES].mean(axis=1)
    assert jacobian_bounds(corners[None], middles[None]) == pytest.approx([1])
    bent = middles + rng.uniform(-0.08, 0.08, (200, 6, 3))
    bounds = jacobian_bounds(np.broadcast_to(corners, (200, 4, 3)), bent)
    grid = np.array([c for c in product(np.linspace(0, 1, 7), repeat=4) if abs(sum(c) - 1) < 1e-12])
    points = np.concatenate([np.broadcast_to(corners, (200, 4, 3)), bent], axis=1).reshape(-1, 3)
    curved = QuadraticMesh(points, np.arange(2000).reshape(200, 10), *[None] * 7)  # type: ignore[arg-type]
    sampled = determinants(curved, grid).min(axis=1)
    assert (bounds <= sampled + 1e-12).all()
    assert (sampled - bounds).max() < 0.6, "and is not far below"
    at_corners = determinants(curved, np.eye(4)).min(axis=1)
    assert (bounds <= at_corners + 1e-12).all()


def test_an_element_that_would_not_be_valid_stays_straight(ball):
    mesh, surface = ball
    # pull the surface in at one place, deeper than the elements below it are high
    pole = surface.points @ [0, 0, 1]
    dented = replace(surface, points=surface.points * np.where((pole > 0.9) & (pole < 0.995), 0.5, 1)[:, None])
    curved = quadratic(mesh, dented, max_boundary_distance=None)
    assert curved.straightened_for_elements > 0
    assert curved.least_jacobian >= LEAST_JACOBIAN
    assert determinants(curved, np.vstack([np.eye(4), RULE])).min() > 0


def test_faces_that_would_cross_stay_straight():
    # two cubes 0.05 apart; the surface of the first bulges into the second, which it lies nearer to then
    one = cube_mesh(2)
    points = np.concatenate([one.points, one.points + np.array([1.05, 0, 0])])
    twins = TetMesh(points, np.concatenate([one.cells, one.cells + len(one.points)]))
    surface = refined(refined(boundary_surface(twins)[0]))
    x, y, z = surface.points.T
    bulge = np.where(np.isclose(x, 1), 0.1 * (np.sin(2 * np.pi * y) * np.sin(2 * np.pi * z)) ** 2, 0)
    bulging = TriSurface(surface.points + bulge[:, None] * [1, 0, 0], surface.faces)
    curved = quadratic(twins, bulging, max_boundary_distance=None)
    assert curved.straightened_for_crossings > 0
    assert curved.points[curved.cells[: len(one.cells)], 0].max() < 1.05


def test_another_surface_than_the_meshed_one_is_refused(ball):
    """A hundredth of a radius is what smoothing changes; the middles would lie elsewhere than the corners."""
    mesh, surface = ball
    other = replace(surface, points=surface.points * 1.01)
    with pytest.raises(InputError, match="162 of 162 boundary nodes .* 0.00999 mm .*meshed.surf.gii"):
        quadratic(mesh, other)
    assert quadratic(mesh, other, max_boundary_distance=0.02).curved > 0
    for none in (np.nan, -1.0, 0.0, np.inf):
        with pytest.raises(InputError, match="is not above 0"):
            quadratic(mesh, other, max_boundary_distance=none)


def by_meshio(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Nodes, elements of ten nodes, and the field."""
    read = meshio.read(path)
    (cells,) = (block.data for block in read.cells if block.type == "tetra10")
    return read.points, cells, read.point_data.get("depth")


def by_xml(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of FEBio, whose elements stand in the order of their regions."""
    root = ElementTree.parse(path).getroot()
    points, depth = (
        np.array([str(row.text).split(",") for row in root.iterfind(at)], float)
        for at in ("Mesh/Nodes/node", "MeshData/NodeData/node")
    )
    rows = {int(row.get("id", "")): str(row.text) for row in root.iterfind("Mesh/Elements/elem")}
    return points, np.array([rows[number].split(",") for number in sorted(rows)], int) - 1, depth[:, 0]


def test_gmsh_measures_the_jacobian_that_was_certified(ball, tmp_path):
    mesh, surface = ball
    curved = quadratic(mesh, surface)
    write_ten_nodes(named_sets(mesh, cortex_depth=0.3), curved, tmp_path / "ball.msh")
    gmsh.initialize(["-noenv"], interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "ball.msh"))
        tags, _ = gmsh.model.mesh.getElementsByType(11)
        least = np.array(gmsh.model.mesh.getElementQualities(np.sort(tags), "minDetJac"))
        triangles = gmsh.model.mesh.getElementsByType(9)[1].reshape(-1, 6)[:, :3]
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
    finally:
        gmsh.finalize()
    corners = mesh.points[mesh.cells]
    bound = jacobian_bounds(corners, curved.points[curved.cells[:, 4:]]) * 6 * signed_volumes(mesh.points, mesh.cells)
    assert (bound <= least + 1e-9).all() and least.min() > 0
    assert "cortical_surface" in names
    assert len(np.unique(np.sort(triangles, axis=1), axis=0)) == len(triangles) == len(boundary_surface(mesh)[0].faces)


@pytest.mark.skipif(not shutil.which("ccx"), reason="calculix-ccx is not installed")
def test_calculix_solves_on_the_curved_ball(ball, tmp_path):
    """Under pressure p a ball shrinks evenly: the displacement of its surface is -p r / 3 K."""
    mesh, surface = ball
    write_ten_nodes(named_sets(mesh, cortex_depth=0.3), quadratic(mesh, surface), tmp_path / "ball.inp")
    pressure, young, poisson = 0.01, 1.0, 0.3
    bulk = young / 3 / (1 - 2 * poisson)
    # three nodes on (nearly) two axes hold the ball without pressing it
    centre, on_x, on_y = (
        1 + int(np.argmin(np.linalg.norm(mesh.points - place, axis=1))) for place in ([0, 0, 0], [1, 0, 0], [0, 1, 0])
    )
    (tmp_path / "job.inp").write_text(
        "*INCLUDE, INPUT=ball.inp\n*MATERIAL, NAME=m\n*ELASTIC\n"
        f"{young}, {poisson}\n*SOLID SECTION, ELSET=all_elements, MATERIAL=m\n*STEP\n*STATIC\n"
        f"*BOUNDARY\n{centre}, 1, 3\n{on_x}, 2, 3\n{on_y}, 3\n*DSLOAD\ncortical_surface, P, {pressure}\n"
        "*NODE PRINT, NSET=cortical_surface\nU\n*END STEP\n"
    )
    subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True)
    rows = [line.split() for line in (tmp_path / "job.dat").read_text().splitlines()[3:] if line.strip()]
    table = np.array([[float(word) for word in row] for row in rows])
    nodes = meshio.read(tmp_path / "ball.inp").points[table[:, 0].astype(int) - 1]
    outward = np.einsum("nc,nc->n", table[:, 1:], nodes / np.linalg.norm(nodes, axis=1, keepdims=True))
    # where the nodes are not quite on the axes, the ball moves as a whole, which the mean over the sphere leaves out
    assert outward.mean() == pytest.approx(-pressure / 3 / bulk, rel=5e-3)


@pytest.mark.parametrize("suffix", [".inp", ".feb", ".vtu", ".msh", ".xdmf"])
def test_programs_find_the_ten_node_mesh(ball, tmp_path, suffix):
    """Elements, nodes, fields and sets; the table of names stands beside it."""
    mesh, surface = ball
    mesh = named_sets(replace(mesh, point_data={"depth": mesh.points[:, 0] + 2}), cortex_depth=0.3)
    curved = quadratic(mesh, surface)
    write_ten_nodes(mesh, curved, path := tmp_path / f"ten{suffix}")
    with pytest.raises(InputError, match=r"ten\.stl"):
        write_ten_nodes(mesh, curved, path.with_suffix(".stl"))
    record = json.loads((tmp_path / "ten.quadratic.json").read_text())
    assert record["tetrahedra"] == len(mesh.cells) and record["least_jacobian"] == curved.least_jacobian
    assert record["regions"] == {"cortex": 1, "core": 2} and "cortical_surface" in record["surface"]
    points, cells, depth = (by_xml if suffix == ".feb" else by_meshio)(path)
    assert np.array_equal(cells, curved.cells) and np.allclose(points, curved.points, rtol=1e-9, atol=1e-11)
    if suffix != ".inp":  # Abaqus files hold no fields
        assert np.allclose(depth, with_middles(mesh, curved)["depth"], rtol=1e-9)
    if suffix == ".feb":
        assert '<Elements type="tet10"' in path.read_text() and "<tri6 " in path.read_text()
    if suffix in (".vtu", ".xdmf"):
        found = meshio.read(path)
        assert np.array_equal(np.flatnonzero(found.cell_data["cell_set_cortex"][0]), mesh.sets.cells["cortex"])
        on_surface = np.flatnonzero(found.point_data["node_set_cortical_surface"])
        assert set(mesh.sets.nodes["cortical_surface"]) < set(on_surface) and on_surface[-1] >= len(mesh.points)
