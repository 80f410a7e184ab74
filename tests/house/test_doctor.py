"""The doctor lists each dependency, uses what is compiled, and names the remedy when something does not work."""

import subprocess
import sys
from pathlib import Path

import pytest

from cortet import doctor
from cortet.doctor import Finding, Tool, problems


def finding(state: str, name: str) -> Finding:
    return Finding(state, name, "1.0", "purpose", "what happened", "what to do")


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Puts a module that runs `code` on import in the place of an installed one, for this and every child process."""

    def breaks(module: str, code: str) -> None:
        (tmp_path / f"{module}.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    return breaks


def library(name: str) -> Tool:
    return next(library for library in doctor.LIBRARIES if library.name == name)


@pytest.mark.parametrize("name", [library.name for library in doctor.LIBRARIES])
def test_every_library_works_here(name):
    found = doctor.examine(library(name))
    if found.state == "missing" and name in doctor.MESHERS:
        pytest.skip(f"{name} could not be had here")
    assert found.state == "ok", found.detail
    assert found.version and (found.detail != "installed") == bool(library(name).proof)


def test_what_is_compiled_or_linked_with_the_system_is_proved():
    proved = {tool.name for tool in (*doctor.LIBRARIES, *doctor.OPTIONAL, *doctor.PROGRAMS) if tool.proof}
    assert proved == {"numba", "pygalmesh", "cgal", "gmsh", "pymeshlab", "pyvista", "meshtool"}
    assert {tool.name for tool in doctor.LIBRARIES if tool.system_packages} < proved


def test_a_library_that_is_not_installed_is_missing():
    found = doctor.examine(Tool("no-such-distribution", "nothing"))
    assert found.state == "missing" and "make setup" in found.remedy


@pytest.mark.parametrize("works", [True, False])
def test_the_command_says_it_all_and_its_exit_code_too(works, broken, monkeypatch, capsys):
    monkeypatch.setattr(doctor, "LIBRARIES", (library("numpy"), library("numba"), library("pymeshlab")))
    if not works:
        broken("pymeshlab", "raise ImportError('no pymeshlab today')")
    assert doctor.run() == (0 if works else 1)
    table = capsys.readouterr().out
    assert "the kernels compile" in table and "installed" in table
    assert ("Everything cortet needs works." in table) == works
    assert ("no pymeshlab today" in table and "remedy: " in table) == (not works)


def test_a_program_without_a_proof_is_listed_with_its_place(tmp_path, monkeypatch):
    (tmp_path / "ccx").touch(mode=0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert doctor.examine(next(tool for tool in doctor.PROGRAMS if tool.name == "ccx")).detail == str(tmp_path / "ccx")


def test_nothing_heavy_is_needed_to_ask_the_doctor():
    program = "import cortet.doctor, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


@pytest.mark.parametrize(
    ("name", "code", "detail"),
    [
        ("gmsh", "raise OSError('libGLU.so.1: cannot open shared object file')", "libGLU.so.1"),
        ("gmsh", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
        ("pymeshlab", "class MeshSet: ...", "MeshSet"),
    ],
)
def test_a_library_that_cannot_load_crashes_or_works_wrongly_is_a_failure(broken, name, code, detail):
    broken(name, code)
    found = doctor.examine(library(name))
    assert found.state == "failed" and detail in found.detail and "make setup" in found.remedy


def test_a_failure_is_a_problem_and_one_mesher_of_two_is_enough():
    assert problems([finding("ok", "numpy"), finding("failed", "gmsh")]) == [
        "gmsh: what happened\n  remedy: what to do"
    ]
    for first, second, count in (("missing", "ok", 0), ("missing", "missing", 2), ("failed", "ok", 1)):
        assert len(problems([finding(first, "pygalmesh"), finding(second, "cgal")])) == count
