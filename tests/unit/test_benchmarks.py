"""Nothing else runs the benchmarks: they must keep up with the package, started as their documentation says."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import speed
from shapes import ball_surface

from cortet.formats.gifti import write_surface
from cortet.measure.quality import opening_bound

pytestmark = pytest.mark.thorough

FOLDER = Path(__file__).parents[2] / "benchmarks"
SCRIPTS = [path for path in sorted(FOLDER.glob("*.py")) if "__main__" in path.read_text()]
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


def test_readme_names_the_column_of_each_number_that_it_compares() -> None:
    """And the two angles that it gives for q = 0.3 are those that the bound allows."""
    text = (FOLDER.parent / "README.md").read_text()
    table = text[text.index("| measure (column of the benchmark)") :].split("\n\n")[0].splitlines()[2:]
    named = re.findall(r"`(\S+?)`", " ".join(table))
    assert len(named) > len(table) and set(named) <= {*speed.MESH_COLUMNS, *speed.STAGE_COLUMNS}
    assert all(re.search(r"`\)", row) for row in table)
    assert opening_bound(32.0) < 0.305 and opening_bound(120.0) == pytest.approx(0.3, abs=1e-3)
    assert "0.3, which means dihedral angles from 32 to 120 degrees" in text


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_it_says_what_it_measures(script: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        import_module(script.stem).main(["--help"])
    assert not ended.value.code
    assert f"python benchmarks/{script.name}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", TINY)
def test_it_measures_something_tiny(name: str, tmp_path: Path) -> None:
    for which, radius in (("pial", 12.0), ("white", 8.0)):
        write_surface(ball_surface(3, radius=radius), tmp_path / f"x_{which}.surf.gii")
    script, *question = name.split()
    command = [sys.executable, FOLDER / f"{script}.py", *question, *TINY[name]]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr and "ended without a word" not in done.stdout
    assert len(done.stdout.splitlines()) > 1, "a heading and a row"
