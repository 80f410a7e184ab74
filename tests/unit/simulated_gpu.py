"""The kernels of the GPU do what those of the CPU do: run by `test_fold_gpu`, with Numba's simulator of CUDA."""

from __future__ import annotations

import csv
import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cubes import cube_mesh
from scipy.spatial import ConvexHull
from shapes import ball_mesh

from cortet.folding import fold as fold_module
from cortet.folding import gpu, gpu_kernels
from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.contact import contact_of
from cortet.folding.convex import planes_of
from cortet.folding.fold import fold
from cortet.folding.growth import Course
from cortet.folding.growth_map import GrowthMap, grown_body
from cortet.folding.kernels import DONE, INVERTED, LIST_OUTDATED, Motion, workspace
from cortet.folding.models import course, tangential
from cortet.folding.patches import SIZE
from cortet.folding.state import Moment, Settings, Stepper
from cortet.folding.stepper import OnCpu
from cortet.geometry.topology import boundary_faces
from cortet.meshes import TetMesh

UNIT = Scale(np.zeros(3), 1.0)
EXACT = {"rtol": 0, "atol": 1e-12}


@pytest.fixture(autouse=True)
def _few_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is a thread of Python here, and waits for the others hundreds of times a step."""
    monkeypatch.setattr(gpu_kernels, "THREADS", 2)
    sys.setswitchinterval(2e-5)


def steppers(
    body: Body,
    state: Motion,
    mesh: TetMesh,
    *,
    bulk: float = 5.0,
    side: float = 0.0,
    material: Material | None = None,
    planes: Any = None,
) -> list[tuple[Stepper, Moment]]:
    """The same moment on the CPU and on the simulated GPU."""
    run: Any = SimpleNamespace(body=body, material=material or Material())
    found = []
    for kind in (OnCpu, gpu.OnGpu):
        contact = contact_of(mesh.points, boundary_faces(mesh), bulk=bulk, side=side, planes=planes)
        contact = contact if bulk else contact._replace(radius=np.inf, softness=3.0)
        moment = Moment(0, 0.0, Motion(state.x.copy(), state.v.copy()), workspace(body), contact)
        moment.stepper = kind(run, moment)
        moment.stepper.begin()
        found.append((moment.stepper, moment))
    return found


def assert_same(cpu: Moment, device: Moment) -> None:
    """All that a moment holds, apart from what no device has."""
    for moment in (cpu, device):
        assert moment.stepper is not None
        moment.stepper.finish()
    np.testing.assert_allclose(device.state.x, cpu.state.x, **EXACT)
    np.testing.assert_allclose(device.state.v, cpu.state.v, rtol=1e-12, atol=1e-12)
    assert device.work.counts.tolist() == cpu.work.counts.tolist()
    assert device.work.min_j == pytest.approx(cpu.work.min_j, rel=1e-12)
    assert device.work.energy == pytest.approx(cpu.work.energy, rel=1e-10, abs=1e-15)


def at_rest(mesh: TetMesh) -> Motion:
    return Motion(mesh.points.copy(), np.zeros_like(mesh.points))


def ungrown(mesh: TetMesh) -> Body:
    return body_of(mesh, UNIT, mask=np.zeros(len(mesh.points)))


def test_a_body_that_grows_by_two_laws_slides_along_a_plane_and_fills_its_envelope() -> None:
    mesh = cube_mesh(2, jitter=0.2)
    labels = (mesh.points[:, 1] > 0.4).astype(np.int32)
    body = body_of(mesh, UNIT, thickness=0.3, labels=labels, held=mesh.points[:, 0] == 0)
    body = body._replace(stiffness=np.linspace(0.1, 3.0, len(mesh.cells)))
    assert len(set(body.label.tolist())) == 2
    growth = np.linspace(0, 0.4, 100)[:, None, None] * [[1.0, -0.3, 0.2], [0.5, 0.1, -0.1]]
    planes = planes_of(ConvexHull(mesh.points))
    (on_cpu, cpu), (on_gpu, device) = steppers(body, at_rest(mesh), mesh, bulk=0.0, planes=planes)
    course = Course(growth, np.linspace(0, 0.02, 100), np.linspace(1, 0.97, 100))
    for stepper in (on_cpu, on_gpu):
        assert stepper.advance(course, 1e-3) == (100, DONE)
    assert_same(cpu, device)
    assert np.abs(cpu.state.x - mesh.points).max() > 1e-2
    for state in ("state", "copy"):
        energies = [
            stepper.energies(stepper.copy() if state == "copy" else stepper.state, growth[-1], 0.01)
            for stepper in (on_cpu, on_gpu)
        ]
        assert energies[1] == pytest.approx(energies[0], rel=1e-12)
        assert min(energies[0]) > 0


def test_elements_that_grow_by_a_map() -> None:
    mesh = cube_mesh(2, jitter=0.2)
    body = body_of(mesh, UNIT, thickness=0.3)
    mapped = GrowthMap(np.array([22.0, 24.0]), np.random.default_rng(0).normal(0, 0.1, (2, len(mesh.cells), 4)))
    (on_cpu, cpu), (on_gpu, device) = steppers(body, at_rest(mesh), mesh, bulk=0.0)
    for age in (22.5, 23.5):
        grown = grown_body(body, mapped, age, 1.1)
        for stepper in (on_cpu, on_gpu):
            stepper.take(grown)
            assert stepper.advance(course(np.ones((20, 1))), 1e-3) == (20, DONE)
    assert_same(cpu, device)
    assert np.abs(cpu.state.x - mesh.points).max() > 1e-3
    energies = [stepper.energies(stepper.state, tangential([1.0]), 0.0) for stepper in (on_cpu, on_gpu)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-12)


def test_blocks_that_collide_beside_the_medial_plane_while_lists_grow_old() -> None:
    low, high = cube_mesh(1), cube_mesh(2)
    shift = np.array([0.05, 0.08, 1.04])
    mesh = TetMesh(np.vstack([low.points, high.points + shift]), np.vstack([low.cells, high.cells + len(low.points)]))
    state, upper = at_rest(mesh), mesh.points[:, 2] > 1.01
    state.v[upper] = [-3.0, 0.0, -8.0]
    (on_cpu, cpu), (on_gpu, device) = steppers(ungrown(mesh), state, mesh, side=1.0)
    listed, touched, left = 0, 0, 100
    while left:
        ended = [stepper.advance(course(np.zeros((left, 1))), 5e-4) for stepper in (on_cpu, on_gpu)]
        assert ended[0] == ended[1] != (0, DONE)
        left -= ended[0][0]
        touched = max(touched, int(cpu.work.counts[1]))
        if ended[0][1] == LIST_OUTDATED:
            listed += 1
            for stepper in (on_cpu, on_gpu):
                stepper.list_contacts(1.0)
            assert np.array_equal(cpu.contact.candidates, device.contact.candidates)
    assert_same(cpu, device)
    assert listed and touched > 3
    assert not np.allclose(cpu.work.energy[1], 0)


def test_nearly_flat_elements_are_opened_and_counted() -> None:
    mesh = cube_mesh(1)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    flat = Motion(mesh.points * [1, 0.9, 0.06] @ turn, np.zeros_like(mesh.points))
    (on_cpu, cpu), (on_gpu, device) = steppers(ungrown(mesh), flat, mesh, bulk=0.0)
    for stepper in (on_cpu, on_gpu):
        assert stepper.advance(course(np.zeros((100, 1))), 2e-5) == (100, DONE)
    energies = [stepper.energies(stepper.state, tangential([0.0]), 0.0) for stepper in (on_cpu, on_gpu)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-12)
    assert_same(cpu, device)
    assert cpu.work.counts[0] >= 100


def test_both_stop_at_the_step_in_which_an_element_inverts_and_leave_it_as_it_was() -> None:
    mesh = cube_mesh(1)
    state = at_rest(mesh)
    state.v[mesh.cells[3, 0]] = 400 * (mesh.points[mesh.cells[3, 1:]].mean(axis=0) - mesh.points[mesh.cells[3, 0]])
    (on_cpu, cpu), (on_gpu, device) = steppers(ungrown(mesh), state, mesh, bulk=0.0)
    ended = [stepper.advance(course(np.zeros((100, 1))), 1e-3) for stepper in (on_cpu, on_gpu)]
    assert ended[0] == ended[1]
    assert ended[0][1] == INVERTED and 0 < ended[0][0] < 100
    assert_same(cpu, device)
    assert cpu.work.min_j[0] <= 0


def test_a_position_that_is_no_number_stops_both_at_once() -> None:
    mesh = cube_mesh(2)
    state = at_rest(mesh)
    inner = np.flatnonzero((mesh.points == 0.5).all(axis=1))
    state.x[inner] = np.nan
    for stepper, _ in steppers(ungrown(mesh), state, mesh, bulk=0.0):
        assert stepper.advance(course(np.zeros((3, 1))), 1e-3) == (0, INVERTED)


def test_more_elements_than_a_patch_has() -> None:
    mesh = cube_mesh(5, jitter=0.2)
    assert len(mesh.cells) > SIZE
    body = body_of(mesh, UNIT, thickness=0.3)
    (on_cpu, cpu), (on_gpu, device) = steppers(body, at_rest(mesh), mesh)
    for stepper in (on_cpu, on_gpu):
        assert stepper.advance(course(np.full((2, 1), 0.3)), 1e-4) == (2, DONE)
    assert_same(cpu, device)


def test_a_run_folds_alike_and_goes_on_where_it_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = ball_mesh(1, radius=10.0)
    settings = Settings(22.0, "L", end=22.03, thickness=3.0, record_interval=0.01, device="cuda")
    verdicts = {
        device: fold(mesh, tmp_path / device, replace(settings, device=device), say=lambda _: None)
        for device in ("cpu", "cuda")
    }
    assert (verdicts["cpu"].device, verdicts["cuda"].device) == ("cpu", "simulator")
    plain = [{key: value for key, value in asdict(verdict).items() if key != "device"} for verdict in verdicts.values()]
    for key, value in plain[0].items():
        assert plain[1][key] == (pytest.approx(value, rel=1e-9, abs=1e-9) if isinstance(value, float) else value), key
    monkeypatch.setattr(fold_module, "_CHECKPOINT_SECONDS", 0.0)

    def killed(*progress: Any) -> None:
        if progress[1] > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fold(mesh, tmp_path / "killed", settings, killed, say=lambda _: None)
    fold(mesh, tmp_path / "killed", settings, say=lambda _: None)
    for name in ("fold.tsv", "verdict.json"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "cuda" / name).read_bytes()
    with (tmp_path / "cuda/fold.tsv").open() as file:
        assert len(list(csv.DictReader(file, delimiter="\t"))) == 4
