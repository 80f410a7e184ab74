"""Every script of the gallery runs as it stands, in an empty folder, and draws what the page of the gallery shows."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import matplotlib.image
import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
PAGE = (ROOT / "docs/gallery.md").read_text()


@pytest.mark.parametrize("script", [pytest.param(path, id=path.stem) for path in SCRIPTS])
def test_an_example_runs(script, tmp_path, monkeypatch):
    """Its own last lines say what must hold."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [script.name])
    assert re.search(r"^ *assert .", script.read_text(), re.MULTILINE)
    runpy.run_path(str(script), run_name="__main__")
    for picture in tmp_path.glob("*.png"):
        assert matplotlib.image.imread(picture)[..., :3].std() > 0.05, "something is drawn"
        assert picture.name in PAGE


def test_the_cells_of_the_notebook_run(tmp_path, monkeypatch):
    """As plain Python: Jupyter itself is not among what the tests need. It is stored with small outputs."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "examples/tour.ipynb").read_text()
    cells = json.loads(text)["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1)), "`make notebook` stores it"
    assert "image/png" in text and str(ROOT) not in text and len(text) < 300_000
    known: dict[str, object] = {}
    for cell in code:
        exec("".join(cell["source"]), known)
    assert (tmp_path / "x.inp").exists()
