"""Each dependency is asked for once, pinned, proved by the doctor and part of the conda environment."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from cortet import doctor

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=;\s]", requirement)[0] for requirement in requirements}


RUNTIME = names(PROJECT["project"]["dependencies"] + PROJECT["project"]["optional-dependencies"]["published"])
DEVELOPMENT = names([name for group in PROJECT["dependency-groups"].values() for name in group])


def test_the_lock_pins_every_dependency():
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    assert names([line for line in lines if "==" in line]) >= RUNTIME | DEVELOPMENT


def test_the_doctor_proves_every_runtime_dependency():
    assert set(doctor.LIBRARIES) == RUNTIME and set(doctor.PROOFS) < RUNTIME


def test_windows_is_refused_in_words():
    code = "import sys; sys.platform = 'win32'; import cortet"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "not on Windows: use the Windows Subsystem for Linux" in done.stderr
