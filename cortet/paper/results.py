"""Tables and figures of the paper, over all cases."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from cortet.cohort.plan import Plan
from cortet.paper.experiments import Experiments, Records
from cortet.report.over_all import Results, files_of

#: tables of the paper, which are written in these forms
_TABLES = ("table-ablation", "table-resolution", "table-measures")
_FORMS = (".tsv", ".json", ".tex", ".md")
_PICTURES = (".svg", ".pdf", ".png")


def results(plan: Plan) -> dict[str, Results]:
    """The tables with the methods paragraph, and the figures."""
    return {"tables": tables(plan), "figures": figures(plan)}


def tables(plan: Plan) -> Results:
    """Ablation, cell size, other measures, and the methods paragraph."""
    of = Experiments(plan)
    files = {name: files_of(plan, name, *_FORMS) for name in _TABLES}
    methods = files_of(plan, "methods", ".md")
    references = [plan.layout.cohort(f"reference-{name}_quality.json") for name in of.references()]

    def inputs() -> list[str]:
        last = {**of.resolution_records(), **of.measures_records()}
        ablation = [*of.ablation_records(), *of.ablation_reports(), *references]
        return list(dict.fromkeys([*ablation, *last, *of.certificates(last), *plan.measured_certificates()]))

    def write() -> None:
        from cortet.paper.ablation import write_ablation
        from cortet.report.methods import methods_text, write_methods
        from cortet.report.records import read_certificate

        made, reports = of.made(of.ablation_records()), of.made(of.ablation_reports())
        write_ablation(made, reports, of.missing(of.ablation_asked()), references, files["table-ablation"])
        write_by_mesh("resolution", of.resolution_records())
        write_by_mesh("measures", of.measures_records())
        certificates = [*map(read_certificate, plan.measured_certificates())]
        write_methods(methods_text(certificates, plan.sheet, plan.unmeasured()), certificates, methods[0])

    def write_by_mesh(name: str, records: Records) -> None:
        from cortet.paper.mesh_tables import write_mesh_table

        certificates = of.certificates(records)
        write_mesh_table(
            name,
            of.made(records),
            of.missing(records),
            files[f"table-{name}"],
            ages={case.name: case.scan_age for case in plan.cases.values()},
            certificates={path: certificates[path] for path in of.made(certificates)},
            uncertified=of.missing(certificates),
        )

    every = [path for paths in files.values() for path in paths]
    return Results([*every, *methods], inputs, lambda: [asdict(case) for case in plan.sheet], write, measures=True)


def figures(plan: Plan) -> Results:
    """Pooled quality at each cell size, and the developmental series."""
    of, size = Experiments(plan), plan.resolutions[0] / 1000
    pooled = {res: files_of(plan, f"figure-pooled-quality_res-{res}um", *_PICTURES) for res in of.ablation_cases}
    series = files_of(plan, "figure-series", *_PICTURES)

    def inputs() -> list[str]:
        shown = [path for brain in of.series() for kind in ("meshes", "certificates") for path in brain[kind].values()]
        return list(dict.fromkeys([*shown, *(path for res in pooled for path in of.pooled_records(res))]))

    def facts() -> Any:
        """Whose meshes the series shows, without the paths of files."""
        brains = [{"name": one["name"], "age": one["age"], "meshes": list(one["meshes"])} for one in of.series()]
        return {"brains": brains, "h": size, "limit": plan.config.certify.q_max, "look": plan.config.figures.journal}

    def write() -> None:
        from cortet.paper.pooled_quality import draw_pooled
        from cortet.paper.series import draw_series
        from cortet.report.figures import look

        named = {name: str(setting.setting) for name, setting in plan.settings.items()}
        settings = {named[name]: (mesher, plan.settings[name].target) for name, mesher in of.mesher_of.items()}
        with look(plan.config.figures.journal):
            for res, files in pooled.items():
                records = of.made(of.pooled_records(res))
                draw_pooled(records, files, settings=settings, limit=plan.config.certify.q_max)
            draw_series(of.series(), series, cell_size=size)

    every = [path for paths in pooled.values() for path in paths]
    return Results([*every, *series], inputs, facts, write, measures=True)
