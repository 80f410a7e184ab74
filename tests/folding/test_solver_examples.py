"""The jobs of `examples/`: CalculiX and dolfinx grow a cortex as theory says, and as our own solver does."""

from __future__ import annotations

import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_surface

from cortet.folding.body import Material, Scale, body_of
from cortet.folding.contact import contact_of
from cortet.folding.kernels import DONE, Motion, advance, workspace
from cortet.folding.models import course, tangential
from cortet.folding.stability import longest_step
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, TetMesh
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.solver_ready import surface_nodes_first

CALCULIX, FENICS = (
    runpy.run_path(str(Path(__file__).parents[2] / f"examples/{name}.py")) for name in ("calculix", "fenics")
)
INNER, OUTER, GROWTH = 10.0, 14.0, 0.02


@pytest.fixture(scope="module")
def ball() -> TetMesh:
    pair = nested(ball_surface(4, OUTER), {"white": ball_surface(4, INNER)})
    mesh, _ = surface_nodes_first(generate(pair, cell_size=2.5)[0])
    return named_sets(mesh, inner=["white"])


def exact(growth: float, material: Material) -> tuple[float, float]:
    """Displacements of the outside and of the interface, mm.

    In the core u = A r. In the shell, whose stress-free strain is `growth` in both tangential directions, equilibrium
    is u'' + 2 u' / r - 2 u / r^2 = -4 mu growth / (lambda + 2 mu) / r, so u = B r + C / r^2 + c r ln r.
    """
    shear, bulk = material.mu_cortex, material.bulk
    first = bulk - 2 / 3 * shear
    stiff = first + 2 * shear
    c = -4 * shear * growth / (3 * stiff)

    def displacement(r: float) -> FloatArray:
        return np.array([r, 1 / r**2, c * r * np.log(r)])

    def stress(r: float) -> FloatArray:
        slope = np.array([1, -2 / r**3, c * (np.log(r) + 1)])
        return stiff * slope + 2 * first * displacement(r) / r - [0, 0, 2 * first * growth]

    at_inner, at_outer, pressed, free = displacement(INNER), displacement(OUTER), stress(INNER), stress(OUTER)
    equations = [[INNER, *-at_inner[:2]], [3 * bulk, *-pressed[:2]], [0, *free[:2]]]
    a, *shell = np.linalg.solve(equations, [at_inner[2], pressed[2], -free[2]])
    return float(at_outer @ [*shell, 1]), float(a * INNER)


def by_cortet(mesh: TetMesh, growth: float) -> FloatArray:
    """Displacements of all nodes by the folding model, at rest: (n, 3) mm."""
    points, material = mesh.points / OUTER, Material(damping=5.0)  # enough that nothing swings for long
    body = body_of(mesh, Scale(np.zeros(3), OUTER))
    work, state = workspace(body), Motion(points.copy(), np.zeros(points.shape))
    contact = contact_of(points, boundary_faces(mesh), bulk=0.0)._replace(radius=np.inf)
    dt, _ = longest_step(material, points, work, contact, tangential([growth]))
    speed = np.inf
    while speed > 1e-9:
        assert advance(body, material, state, work, contact, course(np.full((500, 1), growth)), dt) == (500, DONE)
        speed = np.abs(state.v).max()
    return OUTER * (state.x - points)


def outward(mesh: TetMesh, displacement: FloatArray) -> tuple[float, float]:
    """Mean displacement away from the centre, of the outside and of the interface, mm."""
    length = np.linalg.norm(mesh.points, axis=1)
    along = np.einsum("nc,nc->n", displacement, mesh.points) / np.maximum(length, 1e-9)
    outside, interface = (along[mesh.sets.nodes[name]].mean() for name in ("cortical_surface", "white_interface"))
    return float(outside), float(interface)


def test_a_ball_whose_shell_grows_moves_as_theory_says(ball):
    """Our pressure is a mean over the elements around a node: what grows is smeared over the interface, by one."""
    outside, interface = exact(GROWTH, Material())
    assert outward(ball, by_cortet(ball, GROWTH)) == (
        pytest.approx(outside, rel=0.02),
        pytest.approx(interface, rel=0.7),
    )


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_it_does_so_in_calculix(ball, tmp_path):
    CALCULIX["write_job"](ball, tmp_path, GROWTH)
    outside, interface = exact(GROWTH, Material())
    assert outward(ball, CALCULIX["displacement"](ball, tmp_path)) == (
        pytest.approx(outside, rel=0.01),
        pytest.approx(interface, rel=0.15),
    )


@pytest.mark.skipif(not FENICS["has_dolfinx"](), reason="the Python of the system has no dolfinx (python3-dolfinx)")
def test_it_does_so_in_dolfinx(ball, tmp_path):
    from scipy.spatial import cKDTree

    FENICS["write_job"](ball, tmp_path, GROWTH)
    program = Path(__file__).parents[2] / "examples/fenics.py"
    subprocess.run([FENICS["DOLFINX"], program, "solve"], cwd=tmp_path, capture_output=True, check=True)
    rows = np.loadtxt(tmp_path / "displacement.txt")
    outside, interface = exact(GROWTH, Material())
    assert outward(ball, rows[cKDTree(rows[:, :3]).query(ball.points)[1], 3:]) == (
        pytest.approx(outside, rel=0.02),
        pytest.approx(interface, rel=0.15),
    )
