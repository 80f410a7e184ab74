"""Whether there is a GPU, and its name."""

from __future__ import annotations

import importlib.util
from typing import Any

import numba

from cortet.errors import InputError

#: remedy where no GPU can be used
ON_CPU = "run on the CPU: leave out --device cuda, or set fold.device: cpu"


def is_simulated() -> bool:
    """Whether Numba's simulator replaces the GPU, as in tests."""
    return bool(numba.config.ENABLE_CUDASIM)  # type: ignore[attr-defined]


def device_name() -> str:
    """The name of the GPU that a run would use.

    Raises
    ------
    InputError : there is no numba-cuda, no driver, no compiler for the device, or no GPU
    """
    if is_simulated():
        return "simulator"
    if importlib.util.find_spec("numba_cuda") is None:
        raise InputError(
            "a GPU is asked for, but the package numba-cuda is not installed",
            remedy=f"pip install 'cortet[gpu]', or {ON_CPU}",
        )
    from numba import cuda

    try:
        if not cuda.is_available():
            raise InputError(f"no GPU can be used: {_reason(cuda)}", remedy=f"see what nvidia-smi says, or {ON_CPU}")
        name = cuda.get_current_device().name
    except Exception as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"no GPU can be used: {' '.join(str(error).split())}", remedy=f"see what nvidia-smi says, or {ON_CPU}"
        ) from None
    return name.decode() if isinstance(name, bytes) else str(name)


def _reason(cuda: Any) -> str:
    """Why Numba finds no GPU."""
    return " ".join(str(cuda.cuda_error() or "the compiler for the device (libNVVM) is missing").split())
