"""Errors that a user can act on: each says what was found, in which file, and what to do about it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

#: most characters of a message, because a value may be as long as the file that it is in
_LONGEST = 10_000


def _shortened(text: str) -> str:
    if len(text) <= _LONGEST:
        return text
    return f"{text[: _LONGEST // 2]} [... {len(text) - _LONGEST:,} characters ...] {text[-_LONGEST // 2 :]}"


class CortetError(Exception):
    """A problem that the user can solve; printed without a traceback.

    Parameters
    ----------
    what : the finding, with the offending value; if it is very long, only its beginning and end are kept
    file : the file (and, for tables, line and column) where it was found
    remedy : what to do about it, shortened likewise
    """

    def __init__(self, what: str, *, file: object = None, remedy: str | None = None) -> None:
        what, remedy = _shortened(what), remedy and _shortened(remedy)
        self.what, self.file, self.remedy = what, file, remedy
        place = f"{_shortened(str(file))}: " if file is not None else ""
        hint = f" ({remedy})" if remedy else ""
        super().__init__(f"{place}{what}{hint}")


class InputError(CortetError):
    """A file, table row or parameter given by the user cannot be used.

    Functions raise it for a file that is missing, damaged or of another kind, and for a value that the description of
    its parameter rules out. So docstrings list only what else is refused.
    """


class UsageError(InputError):
    """Options of a command do not go together, or lack others."""


class DamagedFileError(InputError):
    """A file is incomplete, or not of the format that its name says."""

    def __init__(self, what: str, *, file: object) -> None:
        super().__init__(what, file=file, remedy="export it again: it is damaged or has another format")


class StageError(CortetError):
    """A stage could not produce a valid result from valid input."""


def short_traceback(call: Callable[P, R]) -> Callable[P, R]:
    """A public call whose `CortetError` comes without the frames inside cortet: its message is all that helps."""

    @functools.wraps(call)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return call(*args, **kwargs)
        except CortetError as error:
            raise error.with_traceback(None) from None

    return called


def place_mm(point: Iterable[float]) -> str:
    """A location (3,), mm, as messages name it: ``(1.00, 2.00, 3.00) mm``."""
    return "({}) mm".format(", ".join(f"{x:.2f}" for x in point))
