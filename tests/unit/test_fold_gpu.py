"""Folding on a GPU: right under the simulator of CUDA, compiled for real devices, and refused where there is none."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_mesh

from cortet import doctor
from cortet.cli import main
from cortet.errors import InputError
from cortet.folding.device import device_name
from cortet.folding.law import degenerate_stress, stretches, turned_stress, turned_stretches
from cortet.folding.run import prepared
from cortet.folding.state import Settings
from cortet.formats import vtu

HERE = Path(__file__).parent


def test_the_simulated_gpu_does_what_the_cpu_does() -> None:
    """In a process of its own, as Numba decides when it is loaded whether CUDA is simulated."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "simulated_gpu.py"]
    done = subprocess.run(
        [*command, "-W", "ignore::RuntimeWarning"],  # what overflows in an inverted element; kernels do not warn
        cwd=HERE,
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="no libNVVM: pip install 'cortet[gpu]'")
@pytest.mark.parametrize("architecture", ["8.0", "9.0"])
def test_the_kernels_compile_for_a_real_device(architecture: str) -> None:
    """As the simulator runs plain Python, it takes what the compiler would not."""
    command = [sys.executable, HERE / "gpu_assembly.py", architecture]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    lines = dict(line.split(": ") for line in done.stdout.splitlines())
    assert set(lines) == {"advance", "energies"}
    for numbers in lines.values():
        found = dict(zip(words := numbers.split()[1::2], map(int, numbers.split()[::2]), strict=True))
        assert words == ["fma", "atomic", "local", "bytes"]
        assert found["fma"] > 100 and found["atomic"] == found["local"] == 0
        assert found["bytes"] < 4096  # of parameters


CASES = {
    "plain": np.diag([1.2, 1.0, 0.05]),
    "sheared": np.array([[1.0, 0.5, 0.0], [0.0, 0.08, 0.1], [0.2, 0.0, 0.9]]),
    "inverted": np.diag([1.1, 1.0, -0.05]),
    "flat": np.diag([1.0, 1e-7, 1.1]),
    "a needle": np.diag([1e-3, 2e-2, 1.3]),
    "alike": np.diag([0.05, 0.05, 0.05]),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(5))
def test_stretches_without_lapack_are_those_of_lapack(case: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    f = CASES[case] if seed == 0 else left @ CASES[case] @ right
    rows = tuple(map(tuple, f))
    u, s, v = turned_stretches(*rows)
    expected = stretches(*rows)
    assert s == pytest.approx(expected[1].tolist(), rel=1e-13, abs=1e-15)
    for turn in (u, v):
        assert np.array(turn) @ np.transpose(turn) == pytest.approx(np.eye(3), abs=1e-14)
        assert np.linalg.det(turn) == pytest.approx(1)
    assert np.transpose(u) @ np.diag(s) @ np.array(v) == pytest.approx(f, abs=1e-14)
    assert np.array(turned_stress(u, s, v, 1.3)) == pytest.approx(
        np.array(degenerate_stress(*expected, 1.3)), rel=1e-10, abs=1e-10
    )


def test_nothing_at_all_has_stretches() -> None:
    u, s, v = turned_stretches(*3 * [(0.0, 0.0, 0.0)])
    assert s == (0, 0, 0)
    assert np.array(u) @ np.transpose(u) == pytest.approx(np.eye(3)) and np.array(v) == pytest.approx(np.eye(3))


def no_gpu() -> bool:
    try:
        device_name()
    except InputError:
        return True
    return False


@pytest.mark.skipif(not no_gpu(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_an_error_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=r"GPU.*(pip install 'cortet\[gpu\]'|nvidia-smi).*--device cuda"):
        prepared(ball_mesh(1, radius=10.0), Settings(22.0, device="cuda"))
    vtu.write(ball_mesh(1, radius=10.0), tmp_path / "ball.vtu")
    command = ["fold", str(tmp_path / "ball.vtu"), "--ga", "22", "--device", "cuda", "-o", str(tmp_path / "folded")]
    assert main(command) != 0
    assert "GPU" in capsys.readouterr().err
    assert not (tmp_path / "folded").exists()


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="numba-cuda is not installed"):
        device_name()


def test_the_doctor_says_what_a_gpu_lacks() -> None:
    (library,) = [library for library in doctor.OPTIONAL if library.name == "numba-cuda"]
    found = doctor.examine(library)
    assert found.state in ("ok", "missing"), found.detail
