"""Nothing else runs the benchmarks: they must keep up with the package, started as their documentation says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from shapes import ball_surface

from cortet.formats.gifti import write_surface

pytestmark = pytest.mark.thorough

FOLDER = Path(__file__).parents[2] / "benchmarks"
#: of those that take seconds on something tiny
TINY = {
    "speed": ["x_pial.surf.gii", "--cell-sizes", "4", "--chains", "default"],
    "fidelity": ["x_pial.surf.gii", "--cell-sizes", "4"],
    "fold_brain": ["--real", "x_white.surf.gii:24:L", "--pair", "x_pial.surf.gii:x_white.surf.gii:26:both"],
    "fold_speed": ["--cells", "1000", "--threads", "1", "--steps", "2"],
    "read_back formats": ["--tets", "500", "--formats", "carp"],
    "fidelity regions": ["x_pial.surf.gii", "--cell-sizes", "4"],
    "repair": ["x_pial.surf.gii", "--cell-size", "4"],
}


@pytest.mark.parametrize("name", TINY)
def test_it_measures_something_tiny(name, tmp_path):
    for which, radius in (("pial", 12.0), ("white", 8.0)):
        write_surface(ball_surface(3, radius=radius), tmp_path / f"x_{which}.surf.gii")
    script, *question = name.split()
    command = [sys.executable, FOLDER / f"{script}.py", *question, *TINY[name]]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr and "ended without a word" not in done.stdout
    assert len(done.stdout.splitlines()) > 1, "a heading and a row"
