"""All folds of a cohort: their table, figure and part of the page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cohort.layout import beside
from cortet.cohort.plan import Plan
from cortet.folding.plan import Folds
from cortet.neighbours import OnPage
from cortet.report.over_all import Result, files

if TYPE_CHECKING:
    from cortet.report.pages import Panel


def results(plan: Plan) -> list[Result]:
    """All results."""
    folds = Folds(plan)
    return [_all_folds(folds)] if folds.folded else []


def on_page(plan: Plan) -> OnPage:
    """The curves of all folds and their table, if there are some."""
    folds, table = Folds(plan), files(plan, "cohort_folding", ".tsv", ".svg")
    page = plan.layout.cohort_page
    there = folds.folded and (plan.measured_certificates() or not plan.failures)

    def panels() -> list[Panel]:
        from cortet.folding.cohort_folding import panel

        if not there:
            return []
        runs = [{**run, "folder": beside(Path(path).parent, page)} for path, run in folds.runs().items()]
        return [panel(Path(table[0]), Path(table[1]), runs)]

    return OnPage(table if there else [], list(folds.runs().values()), panels)


def _all_folds(folds: Folds) -> Result:
    plan, outputs = folds.plan, files(folds.plan, "cohort_folding", ".tsv", ".json", ".svg", ".pdf", ".png")

    def write() -> None:
        from cortet.folding.cohort_folding import write_cohort_folding

        runs = {verdict: (run, plan.missing(verdict)) for verdict, run in folds.runs().items()}
        there = [{**run, "folder": str(Path(path).parent)} for path, (run, reason) in runs.items() if not reason]
        failed = [{**run, "reason": reason} for run, reason in runs.values() if reason]
        write_cohort_folding(there, failed, outputs)

    return Result(
        "cohort_folding",
        outputs,
        lambda: [str(Path(path).with_name(name)) for path in folds.runs() for name in ("verdict.json", "fold.tsv")],
        write,
        ("folding.cohort_folding",),
        {outputs[2]: ("Folding", {"figure": "all folds"})},
        "cohort_folding",
        lambda: list(folds.runs().values()),
    )
