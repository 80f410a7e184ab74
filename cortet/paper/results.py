"""Tables and figures of the paper, over all cases."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from cortet.cohort.states import States
from cortet.paper.experiments import Experiments
from cortet.report.records import by_origin
from cortet.report.results import Results, files_of

#: tables of the paper, which are written in these forms
_TABLES = ("table-ablation", "table-resolution", "table-measures")
_FORMS = (".tsv", ".json", ".tex")
_PICTURES = (".svg", ".pdf", ".png")


def results(states: States) -> dict[str, Results]:
    """The tables and the figures."""
    return {"tables": tables(states), "figures": figures(states)}


def tables(states: States) -> Results:
    """Ablation, cell size, and other measures."""
    plan, of = states.plan, Experiments(states)
    files = {name: files_of(plan, name, *_FORMS) for name in _TABLES}
    references = [plan.layout.cohort(f"reference-{name}_quality.json") for name in of.references()]

    def inputs() -> list[str]:
        last = {**of.resolution_records(), **of.measures_records()}
        ablation = [*of.ablation_records(), *of.ablation_reports(), *references]
        return list(dict.fromkeys([*ablation, *last, *of.certificates(last)]))

    def write() -> None:
        from cortet.paper.ablation import ABLATION, ablation_table
        from cortet.paper.mesh_tables import MEASURES, RESOLUTION, measures_table, not_certified, resolution_table
        from cortet.report import table_files
        from cortet.report.records import read_record

        made, reports = (by_origin(of.made(one)) for one in (of.ablation_records(), of.ablation_reports()))
        named = {record["origin"]["reference"]: record for record in map(read_record, references)}
        ablation = ablation_table(made, reports, of.missing(of.ablation_asked()), named)
        table_files.write(ABLATION, ablation, *files["table-ablation"])

        ages = {case.name: case.scan_age for case in plan.cases.values()}
        for name, table, table_of, records in (
            ("table-resolution", RESOLUTION, resolution_table, of.resolution_records()),
            ("table-measures", MEASURES, measures_table, of.measures_records()),
        ):
            certificates = of.certificates(records)
            refused = not_certified(of.made(certificates)) | of.missing(certificates)
            rows = table_of(by_origin(of.made(records)), of.missing(records), ages, refused)
            table_files.write(table, rows, *files[name])

    every = [path for paths in files.values() for path in paths]
    return Results(every, inputs, lambda: [asdict(case) for case in plan.sheet], write)


def figures(states: States) -> Results:
    """Pooled quality at each cell size, and the developmental series."""
    plan, of = states.plan, Experiments(states)
    size = plan.resolutions[0] / 1000
    pooled = {res: files_of(plan, f"figure-pooled-quality_res-{res}um", *_PICTURES) for res in of.ablation_cases}
    series = files_of(plan, "figure-series", *_PICTURES)

    def inputs() -> list[str]:
        shown = [path for brain in of.series() for kind in ("meshes", "certificates") for path in brain[kind].values()]
        return list(dict.fromkeys([*shown, *(path for res in pooled for path in of.pooled_records(res))]))

    def facts() -> Any:
        """Whose meshes the series shows, without the paths of files."""
        brains = [{"name": one["name"], "age": one["age"], "meshes": list(one["meshes"])} for one in of.series()]
        return {"brains": brains, "h": size, "limit": plan.config.certify.q_max}

    def write() -> None:
        from cortet.paper.pooled_quality import draw_pooled
        from cortet.paper.series import draw_series

        named = {name: str(setting.setting) for name, setting in plan.settings.items()}
        settings = {named[name]: (mesher, plan.settings[name].target) for name, mesher in of.mesher_of.items()}
        for res, files in pooled.items():
            records = of.made(of.pooled_records(res))
            draw_pooled(records, files, settings=settings, limit=plan.config.certify.q_max)
        draw_series(of.series(), series, cell_size=size)

    every = [path for paths in pooled.values() for path in paths]
    return Results([*every, *series], inputs, facts, write)
