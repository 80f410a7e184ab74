"""Tissue that yields: a held strain decays as in a Maxwell body, in shape and not in volume, in the core alone."""

from __future__ import annotations

import numba
import numpy as np
import pandas as pd
import pytest
from cubes import cube_mesh
from scipy.integrate import solve_ivp
from scipy.linalg import logm
from shapes import ball_mesh

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.fold import fold
from cortet.folding.journal import TABLE
from cortet.folding.kernels import Motion, energies, workspace
from cortet.folding.models import tangential
from cortet.folding.relaxation import FLATTEST, Relaxation, quality, relax
from cortet.folding.run import advance_to, beginning, prepared
from cortet.formats.tsv import read_tsv
from cortet.measure.quality import quality as q_of
from cortet.meshes import REGION, FloatArray, TetMesh

UNIT, MATERIAL, NOTHING = Scale(np.zeros(3), 1.0), Material(mu_core=1.0), tangential([0.0])
YIELDS = Settings(gestational_age=22.0, force=True, end=22.5, thickness=3.0, core_relaxation=0.5, record_interval=0.1)


def core(mesh: TetMesh) -> Body:
    """A body of which all is core."""
    body = body_of(mesh, UNIT, mask=np.zeros(len(mesh.points)))
    return body._replace(gradients=body.gradients.copy())


def step(body: Body, x: FloatArray, part: float, growth: FloatArray = NOTHING) -> None:
    """Let a body yield."""
    work = workspace(body)
    energies(MATERIAL, Motion(x, np.zeros_like(x)), work, growth, 0.0)
    relax(body.gradients, work, growth, 0.0, np.full(len(body.cells), part))


def elastic_strain(body: Body, x: FloatArray, element: int = 0) -> FloatArray:
    """Logarithm of Fe^T Fe of an element, half of it."""
    corners = x[body.cells[element]]
    f = (corners[1:] - corners[0]).T @ body.gradients[element]
    return np.asarray(np.real(logm(f.T @ f)) / 2)


SHEARED = np.array([[1.3, 0.4, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]])


def test_the_cortex_and_elements_that_are_inverted_do_not_yield():
    mesh = cube_mesh(2, jitter=0.2)
    cortex = core(mesh)._replace(mask=np.ones(len(mesh.cells)), depth=np.full(len(mesh.cells), -1e9))
    step(cortex, mesh.points @ SHEARED.T, 0.5)
    inverted = core(mesh)
    step(inverted, mesh.points * [1, 1, -1], 0.5)
    for body in (cortex, inverted):
        assert body.gradients == pytest.approx(core(mesh).gradients, rel=1e-12)


def test_a_small_strain_that_is_held_decays_by_the_exponential():
    mesh = cube_mesh(2, jitter=0.2)
    body, x = core(mesh), mesh.points @ (np.eye(3) + 1e-5 * SHEARED).T
    before = elastic_strain(body, x)
    for _ in range(10):
        step(body, x, 1 - np.exp(-0.1))  # a time tau in all
    after = elastic_strain(body, x)
    deviator = before - np.trace(before) / 3 * np.eye(3)
    assert np.trace(after) == pytest.approx(np.trace(before), abs=1e-13)
    assert np.linalg.eigvalsh(after - np.trace(after) / 3 * np.eye(3)) == pytest.approx(
        np.exp(-1) * np.linalg.eigvalsh(deviator), rel=1e-4
    )


@pytest.mark.parametrize(("steps", "error"), [(10, 0.02), (1000, 0.0002)])
def test_a_large_one_flows_in_proportion_to_stress(steps, error):
    """The stretches follow d ln c / dt = -(c - mean c) / tau, c = squared stretches of determinant 1."""
    mesh = cube_mesh(2, jitter=0.2)
    body, x = core(mesh), mesh.points @ SHEARED.T
    squares = np.exp(2 * np.linalg.eigvalsh(elastic_strain(body, x)))
    start = np.log(squares / np.prod(squares) ** (1 / 3))
    flow = solve_ivp(lambda _, logs: np.exp(logs).mean() - np.exp(logs), (0, 1), start, rtol=1e-10, atol=1e-12)
    for _ in range(steps):
        step(body, x, 1 - np.exp(-1 / steps))
    after = elastic_strain(body, x)
    assert np.linalg.det(body.gradients) == pytest.approx(1 / (6 * body.volumes), rel=1e-12)
    assert 2 * np.linalg.eigvalsh(after - np.trace(after) / 3 * np.eye(3)) == pytest.approx(flow.y[:, -1], abs=error)


def test_no_reference_becomes_flat():
    mesh = cube_mesh(2, jitter=0.2)
    body, x = core(mesh), mesh.points * [4.0, 4.0, 1 / 16]
    for _ in range(200):
        step(body, x, 0.1)
    edges = np.linalg.inv(body.gradients).transpose(0, 2, 1)
    reference = np.concatenate([np.zeros((len(edges), 1, 3)), edges], axis=1)
    worst = q_of(reference.reshape(-1, 3), np.arange(4 * len(edges)).reshape(-1, 4)).max()
    assert 0.5 < worst < 1
    assert min(quality(*map(tuple, rows)) for rows in body.gradients) >= FLATTEST


def test_rates_follow_ages_and_regions():
    laws = Relaxation(np.array([0, 1, 2]), [0.5, {24.0: 1.0, 28.0: 2.0}, "elastic"])
    assert laws.rates(26.0) == pytest.approx([2.0, 1 / 1.5, 0.0])
    assert laws.rates(20.0)[1] == 1.0 and laws.rates(40.0)[1] == 0.5


def test_a_core_that_yields_lets_the_cortex_press_less(tmp_path):
    """Its elastic energy is smaller, what is lost is booked, and in the end all is accounted for."""
    ball, ends = ball_mesh(2, radius=10.0), {}
    for name, time in (("elastic", "elastic"), ("slow", 5.0), ("fast", 0.2)):
        fold(ball, tmp_path / name, YIELDS.with_keys(core_relaxation=time))
        ends[name] = read_tsv(tmp_path / name / TABLE).apply(pd.to_numeric, errors="coerce").iloc[-1]
    assert ends["fast"].elastic_energy < ends["slow"].elastic_energy < ends["elastic"].elastic_energy
    assert ends["fast"].dissipated_energy > ends["slow"].dissipated_energy > ends["elastic"].dissipated_energy
    assert max(abs(end.energy_error) for end in ends.values()) < 0.01


def test_a_region_may_stay_elastic():
    ball = ball_mesh(2, radius=10.0)
    inner = np.linalg.norm(ball.points[ball.cells].mean(axis=1), axis=1) < 4
    mesh = TetMesh(ball.points, ball.cells, cell_data={REGION: np.where(inner, 4, 1)})
    run = prepared(mesh, YIELDS.with_keys(region_relaxation={4: "elastic"}))
    moment = beginning(run)
    advance_to(run, moment, run.end)
    changed = (moment.base.gradients != run.body.gradients).any(axis=(1, 2))
    own = np.linalg.norm(run.mesh.points[run.body.cells].mean(axis=1), axis=1) < 4
    assert not changed[own].any() and changed[~own].mean() > 0.5
    with pytest.raises(InputError, match="region_relaxation.* 9"):
        prepared(mesh, YIELDS.with_keys(region_relaxation={9: 1.0}))


def test_the_bits_are_the_same_for_any_number_of_threads(tmp_path):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one processor only")
    ball, ends = ball_mesh(3, radius=10.0), []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        fold(ball, tmp_path / str(threads), YIELDS)
        ends.append(sorted((tmp_path / str(threads) / "frames").glob("*.vtu"))[-1].read_bytes())
    assert ends[0] == ends[1]
