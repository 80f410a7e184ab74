"""Results that are computed once per object and kept as long as the object lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

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
