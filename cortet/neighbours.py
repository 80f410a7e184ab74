"""The neighbours of the core: packages beside it that build on it, such as folding and the experiments of the paper.

The core imports none of them. A neighbour is a folder `cortet/NAME` whose module `neighbour` declares `NEIGHBOUR`, and
its rules are `rules/NAME.smk`. Without that folder its commands, sections, rules and panels are missing, and nothing
else. Every job of the workflow loads all modules `neighbour`, so their methods import what they use.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cyclopts import App

    from cortet.cohort.plan import Plan
    from cortet.cohort.sheet import Case
    from cortet.config import Config
    from cortet.report.over_all import Results
    from cortet.report.pages import Panel

_PACKAGE = Path(__file__).parent


@dataclass(frozen=True)
class OnPage:
    """What a neighbour adds to the page of all cases."""

    #: files that it makes for its panels; the page names the tables among them
    files: Sequence[str]
    #: files that these are made from, and what they depend on besides
    inputs: Sequence[str]
    facts: Any
    #: makes the files
    write: Callable[[], None]
    #: the panels, once the files are there
    panels: Callable[[], list[Panel]]


class Neighbour:
    """What a neighbour brings to the core: nothing, unless it says more."""

    #: names of its folder in `cortet` and of its file in `rules`
    name: str
    #: Python call -> module that has it: `cortet.CALL`
    calls: Mapping[str, str] = {}
    #: its rules on a case, which follow the certificate, in their order
    rules: Sequence[str] = ()
    #: label of its results on a mesh in names of files
    label: str = ""

    def settings(self, _: Config) -> Iterable[str]:
        """Named settings that are run beside that of the line."""
        return ()

    def meshers(self, _: Config) -> Iterable[str]:
        """Meshers that are run beside those of the line."""
        return ()

    def check_field(self, name: str, own_name: str, file: str | Path) -> None:
        """Raise InputError for a field whose name contradicts the one that it has in its file."""

    def counts(self, _plan: Plan, _case: Case, _rule: str, _wildcards: Mapping[str, str]) -> bool:
        """Whether a mesh of a case is not done if one of `rules` failed."""
        return False

    def files(self, _: Plan) -> list[str]:
        """Its files of single cases that a whole run makes."""
        return []

    def results(self, _: Plan) -> Mapping[str, Results]:
        """Its tables and figures over all cases, by their rules."""
        return {}

    def before(self, _: Plan, _asked: Collection[str]) -> list[str]:
        """What should be known before a run that asks for some rules, in words."""
        return []

    def on_page(self, _: Plan) -> OnPage | None:
        """Its part of the page of all cases."""
        return None

    def add_commands(self, _: App) -> None:
        """Add its commands to `cortet`."""


@cache
def neighbours() -> tuple[Neighbour, ...]:
    """The neighbours that are there, by name."""
    names = sorted(path.parent.name for path in _PACKAGE.glob("*/neighbour.py"))
    return tuple(import_module(f"cortet.{name}.neighbour").NEIGHBOUR for name in names)
