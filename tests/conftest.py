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
