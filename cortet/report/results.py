"""What a rule over all cases declares: its files, what they are made from, and what writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cortet.cohort.plan import Plan

if TYPE_CHECKING:
    from cortet.report.pages import Panel


@dataclass(frozen=True)
class Results:
    """Files over all cases that one rule makes."""

    files: Sequence[str]
    #: files that they are made from, when all cases are done
    inputs: Callable[[], Iterable[str]]
    #: what they depend on besides their inputs
    facts: Callable[[], Any]
    write: Callable[[], None]


@dataclass(frozen=True)
class PagePart:
    """A part of the page of all cases, such as the folds."""

    #: files that it shows; the page names the tables among them
    files: Sequence[str]
    #: files that these are made from, and what they depend on besides
    inputs: Sequence[str]
    facts: Any
    #: makes the files
    write: Callable[[], None]
    #: the panels, once the files are there
    panels: Callable[[], list[Panel]]


def files_of(plan: Plan, name: str, *suffixes: str) -> list[str]:
    """Files over all cases that have one name."""
    return [plan.layout.cohort(f"{name}{suffix}") for suffix in suffixes]
