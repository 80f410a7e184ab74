"""What folding brings to the core."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cortet.neighbours import Neighbour, OnPage

if TYPE_CHECKING:
    from cortet.cohort.plan import Plan


class Folding(Neighbour):
    """Folds of meshes."""

    name = "folding"

    def on_page(self, plan: Plan) -> OnPage | None:
        """Curves and table of all folds."""
        from cortet.folding.plan import on_page

        return on_page(plan)


NEIGHBOUR = Folding()
