"""What holds for all tests."""

import numba

# tests are small, and threads that wait for each other on a busy machine take longer than one alone
numba.set_num_threads(1)
