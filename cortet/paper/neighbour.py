"""What the experiments of the paper bring to the core."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
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

    def meshers(self, config: Config) -> Iterable[str]:
        """Those of the ablation."""
        return config.experiments.ablation.meshers

    def before(self, plan: Plan, asked: Collection[str]) -> list[str]:
        """What the meshes of the experiments cost."""
        from cortet.paper.experiments import Experiments

        return Experiments(plan).costs() if "tables" in asked else []

    def results(self, plan: Plan) -> Mapping[str, Results]:
        """Tables and figures."""
        from cortet.paper.results import results

        return results(plan)


NEIGHBOUR = Paper()
