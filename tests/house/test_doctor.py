"""The doctor names each dependency, uses what is compiled, and says how to mend what does not work."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cortet import doctor


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Puts a module that runs `code` on import in the place of an installed one, for every child process."""

    def breaks(module: str, code: str) -> None:
        (tmp_path / f"{module}.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    return breaks


def test_windows_is_refused_with_what_to_use_instead():
    code = "import sys; sys.platform = 'win32'; import cortet"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "Windows Subsystem for Linux" in done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("name", doctor.PROOFS)
def test_every_library_works_here(name):
    if name == "pygalmesh":
        pytest.importorskip(name)
    assert doctor.proved(name) == ""


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("raise OSError('libGLU.so.1: cannot open shared object file')", "libGLU.so.1"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("option = None", "gmsh"),  # another module of this name
    ],
)
def test_a_library_that_does_not_work_is_a_problem_with_its_remedy(broken, monkeypatch, capsys, code, reason):
    broken("gmsh", code)
    monkeypatch.setattr(doctor, "LIBRARIES", ("gmsh", "cgal"))
    monkeypatch.setattr(doctor, "PROOFS", {"gmsh": doctor.PROOFS["gmsh"]})
    assert doctor.run() == 1
    told = capsys.readouterr().out
    assert reason in told and "libglu1-mesa" in told and "make setup" in told and "FAILED" in told
