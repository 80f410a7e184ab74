"""What holds for all tests."""

import numba
import pytest


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Tests are small, and threads that wait for each other on a busy machine take longer than one alone."""
    numba.set_num_threads(1)
