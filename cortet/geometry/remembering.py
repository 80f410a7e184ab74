"""Results that are computed once per object or mesh, and kept as long as it lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from cortet.meshes import REGION, TetMesh

S = TypeVar("S")
T = TypeVar("T")


def once_per_object(function: Callable[[S], T]) -> Callable[[S], T]:
    """Remember the result of a function for each (immutable) object that it is called with."""
    results: weakref.WeakKeyDictionary[S, T] = weakref.WeakKeyDictionary()

    @wraps(function)
    def remembered(given: S) -> T:
        if given not in results:
            results[given] = function(given)
        return results[given]

    return remembered


def once_per_mesh(function: Callable[..., T]) -> Callable[..., T]:
    """Remember the result of a function of a mesh with regions, and of numbers.

    Meshes that differ in other fields or in sets share the arrays of points, tetrahedra and regions, and the result.
    """
    results: dict[tuple[int, ...], T] = {}

    @wraps(function)
    def remembered(mesh: TetMesh, *numbers: int) -> T:
        arrays: list[Any] = [mesh.points, mesh.cells, mesh.cell_data[REGION]]
        key = (*map(id, arrays), *numbers)
        if key not in results:
            results[key] = function(mesh, *numbers)
            for array in arrays:
                weakref.finalize(array, results.pop, key, None)
        return results[key]

    return remembered
