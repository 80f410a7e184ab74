"""Tables and figures of the paper, over all cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from cortet.cohort.plan import Plan
from cortet.paper.experiments import Experiments
from cortet.report.over_all import Result, files


def _table(
    plan: Plan, rule: str, inputs: Callable[[], Iterable[str]], write: Callable[..., None], **more: Any
) -> Result:
    """A table of the paper: a page for Snakemake's report, TSV, sidecar, LaTeX and Markdown."""
    made = files(plan, rule.replace("_", "-"), ".html", ".tsv", ".json", ".tex", ".md")
    shown = {made[0]: ("Tables", {"table": more.pop("label")})}
    code = (more.pop("code"), "report.table_files")
    return Result(rule, made, inputs, lambda: write(made), code, shown, caption=rule, **more)


def results(plan: Plan) -> list[Result]:
    """The tables, the figures of pooled quality, one per cell size, and the series."""
    of = Experiments(plan)
    config, ages = plan.config, {case.name: case.scan_age for case in plan.cases.values()}
    references = [plan.layout.cohort(f"reference-{name}_quality.json") for name in of.references()]

    def ablation(outputs: Sequence[str]) -> None:
        from cortet.paper.ablation import write_ablation

        write_ablation(
            plan.made(of.ablation_records()),
            plan.made(of.ablation_reports()),
            of.missing(of.ablation_asked()),
            references,
            outputs,
        )

    def by_mesh(name: str, records: Callable[[], dict[str, Any]]) -> Callable[[Sequence[str]], None]:
        def write(outputs: Sequence[str]) -> None:
            from cortet.paper.mesh_tables import write_mesh_table

            certificates = of.certificates(records())
            made = {path: certificates[path] for path in plan.made(certificates)}
            write_mesh_table(
                name,
                plan.made(records()),
                of.missing(records()),
                outputs,
                ages=ages,
                certificates=made,
                uncertified=of.missing(certificates),
            )

        return write

    def with_certificates(records: Callable[[], dict[str, Any]]) -> Callable[[], list[str]]:
        return lambda: [*records(), *of.certificates(records())]

    def pooled(res: int, outputs: Sequence[str]) -> None:
        from cortet.paper.pooled_quality import draw_pooled

        ours = plan.settings
        settings = {str(ours[name].setting): (mesher, ours[name].target) for name, mesher in of.mesher_of.items()}
        draw_pooled(plan.made(of.pooled_records(res)), outputs, settings=settings, limit=config.certify.q_max)

    def shown() -> list[str]:
        return [path for brain in of.series() for kind in ("meshes", "certificates") for path in brain[kind].values()]

    def whose() -> dict[str, Any]:
        """Whose meshes the series shows, without the paths of files."""
        brains = [{"name": one["name"], "age": one["age"], "meshes": list(one["meshes"])} for one in of.series()]
        return {"brains": brains, "h": h}

    def side_by_side() -> None:
        from cortet.paper.series import draw_series

        draw_series(of.series(), series, cell_size=h)

    found = [
        _table(
            plan,
            "table_ablation",
            lambda: [*of.ablation_records(), *of.ablation_reports(), *references],
            ablation,
            label="1, stage ablation",
            code="paper.ablation",
        ),
        _table(
            plan,
            "table_resolution",
            with_certificates(of.resolution_records),
            by_mesh("resolution", of.resolution_records),
            label="2, cell size",
            code="paper.mesh_tables",
            facts=lambda: ages,
        ),
        _table(
            plan,
            "table_measures",
            with_certificates(of.measures_records),
            by_mesh("measures", of.measures_records),
            label="other measures",
            code="paper.mesh_tables",
            facts=lambda: ages,
        ),
    ]
    for res, cases in of.ablation_cases.items():
        made = files(plan, f"figure-pooled-quality_res-{res}um", ".svg", ".pdf", ".png")
        found.append(
            Result(
                f"figure_pooled_quality_{res}",
                made,
                partial(of.pooled_records, res),
                partial(pooled, res, made),
                ("report.figures", "paper.pooled_quality"),
                {made[0]: ("Figures", {"figure": f"pooled quality, h = {res} µm"})},
                "figure_pooled_quality",
                partial(dict, h=res / 1000, cases=len(cases), limit=config.certify.q_max),
            )
        )
    series, h = files(plan, "figure-series", ".svg", ".pdf", ".png"), plan.resolutions[0] / 1000
    return [
        *found,
        Result(
            "figure_series",
            series,
            shown,
            side_by_side,
            ("paper.series", "report.render"),
            {series[0]: ("Figures", {"figure": "developmental series"})},
            "figure_series",
            whose,
            memory_mb=8000,
            minutes=30,
        ),
    ]
