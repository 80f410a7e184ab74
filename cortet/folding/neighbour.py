"""What folding brings to the core."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.neighbours import Neighbour, OnPage

if TYPE_CHECKING:
    from cyclopts import App

    from cortet.cohort.plan import Plan
    from cortet.cohort.sheet import Case


class Folding(Neighbour):
    """Folds of meshes."""

    name = "folding"
    calls = dict.fromkeys(("Folded", "fold", "growth"), "cortet.folding.calls")
    rules = ("fold", "fold_figures", "folded_surface")
    label = "Folded"

    def check_field(self, name: str, own_name: str, file: str | Path) -> None:
        """Growth is named for the age up to which it was measured."""
        from cortet.folding.fields import check_age

        check_age(name, own_name, file)

    def counts(self, plan: Plan, case: Case, _rule: str, wildcards: Mapping[str, str]) -> bool:
        """A fold that is asked for counts."""
        from cortet.folding.plan import Folds

        variants = ("", *plan.config.fold.variants)
        return wildcards.get("variant", "").lower() in variants and case.name in Folds(plan).folded

    def files(self, plan: Plan) -> list[str]:
        """Pictures of the folds, and their surfaces."""
        from cortet.folding.plan import Folds

        return Folds(plan).files()

    def on_page(self, plan: Plan) -> OnPage | None:
        """Curves and table of all folds."""
        from cortet.folding.plan import on_page

        return on_page(plan)

    def add_commands(self, app: App) -> None:
        """Add `fold` and `growth`."""
        from cortet.folding.commands import add_commands

        add_commands(app)


NEIGHBOUR = Folding()
