"""Folds, convergence and prediction over all cases: their tables, figures and part of the page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    return [*([_all_folds(folds)] if folds.folded else []), _convergence(folds), _prediction(folds)]


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


def _experiment(plan: Plan, name: str, *more: str) -> tuple[list[str], dict[str, Any]]:
    """Files of an experiment, and those that Snakemake's report shows."""
    tables = files(plan, f"table-{name}", ".html", ".tsv", ".json", ".tex", ".md")
    pictures = files(plan, f"figure-{name}", ".svg", ".pdf", ".png")
    labels = {tables[0]: ("Folding", {"table": name}), pictures[0]: ("Folding", {"figure": name})}
    return [*tables, *pictures, *files(plan, name, *more)], labels


def _convergence(folds: Folds) -> Result:
    outputs, shown = _experiment(folds.plan, "convergence", ".txt")

    def write() -> None:
        from cortet.folding.convergence import write_convergence

        records = [path for path in folds.plan.made(folds.convergence_files()) if path.endswith("record.json")]
        write_convergence([Path(path).parent for path in records], outputs)

    code = ("folding.convergence", "report.table_files")
    return Result(
        "convergence", outputs, folds.convergence_files, write, code, shown, "table_convergence", measures=False
    )


def _prediction(folds: Folds) -> Result:
    plan, (outputs, shown) = folds.plan, _experiment(folds.plan, "prediction")

    def write() -> None:
        from cortet.folding.prediction_tables import write_prediction

        records = plan.made(folds.prediction_files("record.json"))
        spreads = plan.made(folds.prediction_spreads())
        write_prediction([*map(Path, records)], [*map(Path, spreads)], outputs)

    def predicted() -> list[str]:
        names = ("record.json", "predicted.png", "errors.png")
        return [path for name in names for path in folds.prediction_files(name)] + folds.prediction_spreads()

    code = ("folding.prediction_tables", "report.table_files")
    return Result("prediction", outputs, predicted, write, code, shown, "table_prediction", measures=False)
