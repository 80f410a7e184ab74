"""The neighbours of the core: packages beside it that build on it, such as folding and the experiments of the paper.

The core imports none of them. A neighbour is a folder `cortet/NAME` whose module `neighbour` declares `NEIGHBOUR`, and
its rules are `rules/NAME.smk`. Without that folder its commands, sections, rules and panels are missing, and nothing
else. Every job of the workflow loads all modules `neighbour`, so their methods import what they use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cortet.cohort.plan import Plan
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

    def settings(self, _: Config) -> Iterable[str]:
        """Named settings that are run beside that of the line."""
        return ()

    def results(self, _: Plan) -> Mapping[str, Results]:
        """Its tables and figures over all cases, by their rules."""
        return {}

    def on_page(self, _: Plan) -> OnPage | None:
        """Its part of the page of all cases."""
        return None


@cache
def neighbours() -> tuple[Neighbour, ...]:
    """The neighbours that are there, by name."""
    names = sorted(path.parent.name for path in _PACKAGE.glob("*/neighbour.py"))
    return tuple(import_module(f"cortet.{name}.neighbour").NEIGHBOUR for name in names)
