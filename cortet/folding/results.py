"""Folds, convergence and prediction over all cases: their tables, figures and part of the page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.cohort.layout import beside
from cortet.cohort.plan import Plan
from cortet.errors import InputError
from cortet.folding.measures import USUAL
from cortet.folding.plan import Folds
from cortet.formats.ownership import json_of
from cortet.neighbours import OnPage
from cortet.report.over_all import Result, files

if TYPE_CHECKING:
    from cortet.report.pages import Panel


def results(plan: Plan) -> list[Result]:
    """All results."""
    folds = Folds(plan)
    of_folds = [_all_folds(folds)] if folds.folded else []
    return [*of_folds, _population(folds), _convergence(folds), _prediction(folds)]


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


def _population(folds: Folds) -> Result:
    plan, groups, chosen = folds.plan, folds.population(), folds.plan.config.biomarkers
    table = files(plan, "biomarkers", ".tsv", ".json")
    named = {group: folds.population_files(*group) for group in groups}
    every = [run for runs in groups.values() for run in runs]

    def modelled(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
        from cortet.folding.biomarkers import VARIANT

        return [run for run in runs if VARIANT in chosen.model or run["variant"] == USUAL]

    def inputs() -> list[str]:
        """What is asked for is checked before hours of folding, and before Snakemake deletes an earlier result."""
        from cortet.folding.biomarkers import design_of

        _require_folds(every)
        if chosen.parcels and not any(chosen.parcels in plan.cases[run["case"]].fields for run in every):
            raise InputError(
                f"biomarkers.parcels: no folded case has the field {chosen.parcels}",
                remedy=f"add the column field_{chosen.parcels} to the cohort sheet, or mend biomarkers.parcels",
            )
        for group, runs in groups.items() if chosen.model else ():
            design_of(modelled(runs), chosen.model, of=_named(group))
        return [path for run in every for path in run["files"].values()]

    def write() -> None:
        from importlib.metadata import version

        from cortet.folding.biomarkers import write_population, write_values

        there = [run for run in every if not any(map(plan.missing, run["files"].values()))]
        _require_folds(there)
        options = {"model": chosen.model, "permutations": chosen.permutations, "seed": chosen.seed}
        record: dict[str, Any] = {**options, "nilearn": version("nilearn")}
        for group, runs in groups.items():
            if mine := [run for run in modelled(runs) if run in there]:
                made = write_population(mine, chosen.measures, outputs=named[group], hemi=mine[0]["hemi"], **options)
                record[_named(group)] = made
        write_values(there, record, Path(table[0]), Path(table[1]))

    return Result(
        "biomarkers",
        [*table, *(path for some in named.values() for path in some.values())],
        inputs,
        write,
        ("folding.biomarkers", "report.render", "report.surface_maps"),
        {some["figure"]: ("Folding", {"figure": f"{group[1]:g} weeks, {group[0]}"}) for group, some in named.items()},
        "biomarkers",
        lambda: [chosen.model_dump(mode="json"), [{key: run[key] for key in run if key != "files"} for run in every]],
        memory_mb=4000,
        minutes=240,
        measures=False,
    )


def _named(group: tuple[str, float]) -> str:
    """The name of the folds of a hemisphere at a week."""
    return f"hemi-{group[0]}_week-{group[1]:g}"


def _require_folds(runs: list[dict[str, Any]]) -> None:
    if not runs:
        raise InputError(
            "no fold is on the common mesh",
            remedy="name weeks that folds reach in fold.surfaces, cases in fold.cases, and spheres in column sphere",
        )


def sentences(plan: Plan) -> list[str]:
    """What a paper says of the folds on the common mesh, if they are there."""
    record = json_of(Path(files(plan, "biomarkers", ".json")[0])).get("Model", {})
    groups = {name: made for name, made in record.items() if name.startswith("hemi-")}
    if not groups:
        return []
    listed = "; ".join(f"{name.replace('_', ', ')} weeks: {made['folds']}" for name, made in groups.items())
    vertices = next(iter(groups.values()))["vertices"]
    said = [
        f"Folded surfaces were brought onto a common mesh of {vertices:,} vertices through their spheres, by "
        f"barycentric interpolation (folds of {listed})."
    ]
    if record["model"]:
        said.append(
            f"A general linear model of {', '.join(record['model'])} was fitted at each vertex; p is two-sided and "
            f"corrected over all vertices of a map, not over maps, by the largest t of {record['permutations']} "
            f"permutations (Freedman-Lane; nilearn {record['nilearn']}, seed {record['seed']})."
        )
    return said


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
