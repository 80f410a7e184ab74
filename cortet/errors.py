"""Errors that a user can act on: each says what was found, in which file, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import SupportsInt


class CortetError(Exception):
    """A problem that the user can solve; printed without a traceback.

    Parameters
    ----------
    what : the finding, with the offending value
    file : the file (and, for tables, line and column) where it was found
    remedy : what to do about it
    """

    def __init__(self, what: str, *, file: object = None, remedy: str | None = None) -> None:
        self.what, self.file, self.remedy = what, file, remedy
        place = f"{file}: " if file is not None else ""
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


def counted(count: SupportsInt, one: str, many: str = "") -> str:
    """A number and the words for what it counts: ``1 node belongs`` of these words, ``1,234 nodes belong`` of many."""
    return f"{int(count):,} {one if int(count) == 1 else many or one + 's'}"


def place_mm(point: Iterable[float]) -> str:
    """A location (3,), mm, as messages name it: ``(1.00, 2.00, 3.00) mm``."""
    return "({}) mm".format(", ".join(f"{x:.2f}" for x in point))
