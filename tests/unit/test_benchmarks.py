"""Nothing else runs the benchmarks: they must keep up with the package, started as their documentation says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = [
    path for path in sorted((Path(__file__).parents[2] / "benchmarks").glob("*.py")) if "__main__" in path.read_text()
]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_it_says_what_it_measures(script: Path) -> None:
    shown = subprocess.run([sys.executable, script, "--help"], check=False, capture_output=True, text=True)

    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.startswith("usage:")
