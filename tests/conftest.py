"""What holds for all tests."""

import os

import numba
import pytest

# processes that tests start would compile every module of the project each time
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Tests are small, and threads that wait for each other on a busy machine take longer than one alone."""
    numba.set_num_threads(1)


@pytest.fixture
def at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion ends within a short fold of a ball: what is compared is a shape at rest."""
    from cortet.folding.models import CONSTANTS

    monkeypatch.setitem(CONSTANTS, "growing", CONSTANTS["growing"]._replace(damping=0.5))
