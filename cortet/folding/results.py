"""All folds of a cohort: their table, figure and part of the page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cohort.failures import why_missing
from cortet.cohort.layout import beside
from cortet.cohort.plan import Plan
from cortet.config import version_of
from cortet.folding.plan import Folds
from cortet.neighbours import OnPage
from cortet.report.over_all import files_of

if TYPE_CHECKING:
    from cortet.report.pages import Panel


def on_page(plan: Plan) -> OnPage | None:
    """The curves of all folds and their table, if there are some."""
    folds = Folds(plan)
    if not folds.folded:
        return None
    files, runs = files_of(plan, "cohort_folding", ".tsv", ".json", ".svg", ".pdf", ".png"), folds.runs()
    page = plan.layout.cohort_page

    def write() -> None:
        from cortet.folding.cohort_folding import write_cohort_folding

        whys = {path: why_missing(plan, path, "fold", folds.job(run)) for path, run in runs.items()}
        there = [{**run, "folder": str(Path(path).parent)} for path, run in runs.items() if not whys[path]]
        failed = [{**run, "reason": whys[path]} for path, run in runs.items() if whys[path]]
        write_cohort_folding(there, failed, files)

    def panels() -> list[Panel]:
        from cortet.folding.cohort_folding import panel

        seen = [{**run, "folder": beside(Path(path).parent, page)} for path, run in runs.items()]
        return [panel(Path(files[0]), Path(files[2]), seen)]

    inputs = [str(Path(path).with_name(name)) for path in runs for name in ("verdict.json", "fold.tsv")]
    return OnPage(files, inputs, [version_of("folding.cohort_folding"), *runs.values()], write, panels)
