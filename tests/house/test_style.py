"""Formatter, linter, type checker and Snakemake's own have nothing to say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RULES = ["Snakefile", *(str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("rules/*.smk")))]

KERNELS = [path for path in sorted(ROOT.glob("cortet/**/*.py")) if "njit(" in path.read_text()]


@pytest.mark.thorough  # `make check` has them, too
@pytest.mark.parametrize(
    "command",
    [
        pytest.param(["ruff", "format", "--check"], id="ruff-format"),
        pytest.param(["ruff", "check"], id="ruff-check"),
        pytest.param(["mypy"], id="mypy"),
        pytest.param(["lint-imports", "--no-cache"], id="imports"),
        pytest.param(["snakefmt", "--check", *RULES], id="snakefmt"),
    ],
)
def test_nothing_to_say(command):
    tool = Path(sys.executable).with_name(command[0])
    done = subprocess.run([tool, *command[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_snakemake_misses_nothing_but_environments_of_single_rules():
    """All rules run in the environment of the workflow."""
    tool = Path(sys.executable).with_name("snakemake")
    done = subprocess.run([tool, "--lint"], cwd=ROOT, capture_output=True, text=True, check=False)
    titles = set(re.findall(r"^ +\* (.*):$", done.stderr + done.stdout, flags=re.MULTILINE))
    assert titles <= {"Specify a conda environment or container for each rule."}, done.stderr


@pytest.mark.parametrize("kernels", KERNELS, ids=lambda path: path.stem)
def test_kernels_divide_as_ieee_says_and_raise_nothing(kernels):
    """A flat element somewhere in a search has an infinite mu; it does not end the run."""
    text = kernels.read_text()
    assert text.count('error_model="numpy"') == len(re.findall(r"\bnjit\(", text))
