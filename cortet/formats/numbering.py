"""Labels as the numbers of 32 bits that files hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError


def in_32_bits(values: NDArray[Any], what: str, path: str | Path | None = None) -> NDArray[np.int32]:
    """Whole numbers as int32. Raises InputError for a fraction, and for a number that would wrap to another one."""
    for bad, why in (
        (~(values == np.floor(values)), "which is not a whole number"),
        (~((values >= -(2**31)) & (values < 2**31)), "and labels have at most 32 bits"),
    ):
        if bad.any():
            what += f" has the label {values[bad].ravel()[0]}, {why}"
            raise InputError(what, file=path, remedy="number the labels from 0 on")
    return values.astype(np.int32)
