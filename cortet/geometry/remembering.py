"""Results that are computed once per object or mesh, and kept as long as it lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import update_wrapper, wraps
from typing import Any, Generic, TypeVar

from numpy.typing import NDArray

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


def once_per_array(function: Callable[[NDArray[Any]], T]) -> Callable[[NDArray[Any]], T]:
    """Remember the result of a function for each read-only array that it is called with."""
    results: dict[int, T] = {}

    @wraps(function)
    def remembered(given: NDArray[Any]) -> T:
        if given.flags.writeable:
            return function(given)
        if id(given) not in results:
            results[id(given)] = function(given)
            weakref.finalize(given, results.pop, id(given), None).atexit = False
        return results[id(given)]

    return remembered


class OncePerCells(Generic[T]):
    """Remembers a result for each (read-only) array of tetrahedra; meshes that differ only in their points share it."""

    def __init__(self, function: Callable[..., T]) -> None:
        """`function` takes a mesh, of which it must look at nothing but `arrays`, and numbers."""
        self._function = function
        self._results: dict[tuple[int, ...], T] = {}
        update_wrapper(self, function)

    def __call__(self, mesh: TetMesh, *numbers: int) -> T:
        """The result of `function`, computed at the first call."""
        key = (*map(id, self.arrays(mesh)), *numbers)
        if key not in self._results:
            self.remember(mesh, self._function(mesh, *numbers), *numbers)
        return self._results[key]

    def remember(self, mesh: TetMesh, result: T, *numbers: int) -> None:
        """Store a result that the caller already knows."""
        arrays = self.arrays(mesh)
        key = (*map(id, arrays), *numbers)
        self._results[key] = result
        for array in arrays:
            weakref.finalize(array, self._results.pop, key, None).atexit = False

    @staticmethod
    def arrays(mesh: TetMesh) -> list[NDArray[Any]]:
        """The arrays that decide the result."""
        return [mesh.cells]


class OncePerRegions(OncePerCells[T]):
    """Remembers a result for each mesh with regions; meshes that differ only in other fields or in sets share it."""

    @staticmethod
    def arrays(mesh: TetMesh) -> list[NDArray[Any]]:
        """The arrays that decide the result."""
        return [mesh.points, mesh.cells, mesh.cell_data[REGION]]
