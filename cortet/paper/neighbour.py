"""What the experiments of the paper bring to the core."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from cortet.neighbours import Neighbour

if TYPE_CHECKING:
    from cortet.cohort.plan import Plan
    from cortet.config import Config
    from cortet.report.over_all import Results


class Paper(Neighbour):
    """Tables and figures of the CORTET paper, on any cohort."""

    name = "paper"

    def settings(self, config: Config) -> Iterable[str]:
        """Those that are compared."""
        return config.experiments.settings

    def results(self, plan: Plan) -> Mapping[str, Results]:
        """Tables and figures."""
        from cortet.paper.results import results

        return results(plan)


NEIGHBOUR = Paper()
