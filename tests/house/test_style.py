"""What every kernel that is compiled must say."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
KERNELS = [path for path in sorted(ROOT.glob("cortet/**/*.py")) if "njit(" in path.read_text()]


@pytest.mark.parametrize("kernels", KERNELS, ids=lambda path: path.stem)
def test_kernels_divide_as_ieee_says_and_raise_nothing(kernels):
    """A flat element somewhere in a search has an infinite mu; it does not end the run."""
    text = kernels.read_text()
    assert text.count('error_model="numpy"') == len(re.findall(r"\bnjit\(", text))
