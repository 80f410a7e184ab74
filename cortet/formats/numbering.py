"""Conversion of the numbers that files give nodes and elements to the indices that meshes in memory use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.meshes import IntArray


def indices(numbers: NDArray[np.int64], known: NDArray[np.int64], kind: str, path: str | Path) -> IntArray:
    """Index in `known` of each number, in the shape of `numbers`.

    Parameters
    ----------
    known : (n,), number of each node or element, in the order of the file
    kind : what is numbered, for the message

    Raises
    ------
    InputError
        a number is not known, or two in `known` are the same
    """
    count = len(known)
    if count and known[0] == 1 and known[-1] == count and (np.diff(known) == 1).all():  # almost every file does this
        outside = (numbers < 1) | (numbers > count)
        place = numbers - 1
    elif not count:
        outside, place = np.ones(numbers.shape, bool), numbers
    else:
        order = np.argsort(known, kind="stable")
        if (np.diff(known[order]) == 0).any():
            raise DamagedFileError(
                f"two {kind}s have the number {known[order][1:][np.diff(known[order]) == 0][0]}", file=path
            )
        place = order[np.minimum(np.searchsorted(known, numbers, sorter=order), count - 1)]
        outside = known[place] != numbers
    if outside.any():
        raise DamagedFileError(f"{kind} {numbers[outside][0]} is named but not defined", file=path)
    return place.astype(np.int32)


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


def whole(values: NDArray[np.float64], kind: str, path: str | Path) -> NDArray[np.int64]:
    """Whole numbers that were read as real numbers. Raises InputError for fractions and for numbers of ten digits."""
    bad = ~(np.abs(values) < 2**31) | (values != np.round(values))
    if bad.any():
        raise DamagedFileError(f"{values[bad][0]:g} is not a number of a {kind}", file=path)
    return values.astype(np.int64)
