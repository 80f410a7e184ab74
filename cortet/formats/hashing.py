"""SHA-256 of files and arrays: by it inputs, fields and meshes are known again."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError


def sha256(path: str | Path) -> str:
    """Hash of a file, as `sha256sum` prints it.

    Raises
    ------
    InputError : the file cannot be read
    """
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def array_sha256(values: NDArray[Any]) -> str:
    """Hash of numbers as float64, row by row, little-endian."""
    return hashlib.sha256(np.ascontiguousarray(values, "<f8").tobytes()).hexdigest()
