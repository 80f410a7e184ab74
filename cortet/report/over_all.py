"""Tables, figures and pages over all cases, as a function of what is in the output folder.

The rules of the workflow make each of them when all cases are done. After a run with failures, and at any time by
`cortet cohort report`, all are made of what is there.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, cast

from cortet.cohort.failures import with_failures
from cortet.cohort.jobs import Mesh, existing
from cortet.cohort.layout import beside, filled
from cortet.cohort.outdated import set_aside
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import read_sheet
from cortet.config import load
from cortet.errors import CortetError, InputError
from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.ownership import json_of
from cortet.neighbours import OnPage, neighbours

logger = logging.getLogger(__name__)

#: rules of the core that a whole run asks for
OF_COHORT = (
    *("cohort_quality", "cohort_summary", "cohort_stages", "cohort_figure", "cohort_status", "citation"),
    *("cohort_tissues", "cohort_maps_L", "cohort_maps_R", "cohort_page"),
)
#: what a run leaves of itself in its output folder
RUN = ".cortet/run.json"
#: when `report` last wrote results that a run may still change; Snakemake then makes them again
REPORTED = ".cortet/reported.txt"


@dataclass(frozen=True)
class Result:
    """One table, figure or page over all cases."""

    #: name of the rule that makes it
    rule: str
    files: Sequence[str]
    #: files that it is made from, when all cases are done; the certificates, too, if it leaves out meshes without one
    inputs: Callable[[], Iterable[str]]
    write: Callable[[], None]
    #: modules whose `VERSION` counts
    code: Sequence[str]
    #: file -> category and labels in Snakemake's report
    shown: Mapping[str, tuple[str, dict[str, str]]] = field(default_factory=dict)
    #: name of the caption in reports/
    caption: str = ""
    #: what it depends on besides its inputs; captions quote it
    facts: Callable[[], Any] = dict
    memory_mb: int = 2000
    minutes: int = 20
    #: whether it needs at least one mesh with a certificate
    measures: bool = True

    @property
    def is_drawn(self) -> bool:
        """Whether it is a figure for print, which has the look of a journal."""
        return any(path.endswith(".pdf") for path in self.files)


def plan_of(config: Mapping[str, Any]) -> Plan:
    """The plan of a run, of the content of its configuration.

    Raises
    ------
    InputError : the configuration or the sheet is wrong
    """
    own = load(config)
    # by the name that files carry: the line's own setting carries none, others are run beside it
    settings = {"": own} | {
        name.capitalize(): load({**config, "setting": name})
        for neighbour in neighbours()
        for name in neighbour.settings(own)
        if name != own.setting
    }
    for setting in settings.values():
        setting.require_programs()
    plan = Plan(settings, read_sheet(own.cohort.sheet, own.cohort.fields))
    own.require_workflow()
    own.require_nesting(any(case.inner for case in plan.cases.values()))
    return plan


def remember_run(plan: Plan, config: Mapping[str, Any], asked: Iterable[str]) -> None:
    """Leave the configuration of a run in its output folder, and the rules over all cases that it asks for.

    Until the run has ended, the page of the cohort says that it is older, and meshes that the run makes again are
    unfinished in the table of states.
    """
    output = Path(plan.layout.output)
    record = {
        "config": json.loads(json.dumps(config, default=str)),
        "asked": sorted(asked),
        "folder": os.path.relpath(Path.cwd(), output),
    }
    write_json(record, output / RUN)
    began = datetime.now().astimezone().strftime("%Y-%m-%d at %H:%M")
    results = OverAll(with_failures(plan), began=began)
    for result in (results["cohort_status"], results["cohort_page"]):
        if all(Path(path).exists() for path in (*result.files, *result.inputs())):
            result.write()


def is_of_run(config: Mapping[str, Any], output: Path) -> bool:
    """Whether the last run that wrote to an output folder had the sheet and the dataset of a configuration."""
    record = run_record(output)
    earlier = (record.get("config") or {}).get("cohort") or {}
    return all(earlier.get(key) == (config.get("cohort") or {}).get(key) for key in ("sheet", "dataset")) and bool(
        record
    )


def run_record(output: Path) -> dict[str, Any]:
    """What the last run left of itself in an output folder; empty if nothing."""
    return json_of(output / RUN)


def plan_of_run(output: Path) -> tuple[Plan, list[str]]:
    """The plan of the last run that wrote to an output folder, and the rules over all cases that it asked for.

    The process changes to the folder of the run, to which names of files are relative.

    Raises
    ------
    InputError : no run left its configuration there, or its sheet is gone
    """
    output = output.absolute()
    record = run_record(output)
    try:
        config, asked, folder = record["config"], list(record["asked"]), output / record["folder"]
    except (LookupError, TypeError):
        remedy = "name the output folder of `snakemake` or `cortet run`"
        raise InputError("no run of cortet left its configuration there", file=output, remedy=remedy) from None
    try:
        os.chdir(folder)
    except OSError:
        remedy = "move the output folder back beside it, or start the run again"
        raise InputError("the folder of the run is not there", file=folder, remedy=remedy) from None
    return plan_of({**config, "output": os.path.relpath(output)}), asked


def report(output: Path, *, after: Literal["success", "failure"] | None = None) -> list[Path]:
    """Make results over all cases, and the pages of failed cases, of what is in an output folder.

    Results of neighbours are made if the last run asked for them, or if they are there already.

    Parameters
    ----------
    after : how the run ended that calls this; it then gets, of all results, only what it asked for and what was there,
        and after a success only the page and what it did not make itself

    Returns
    -------
    The files that were written

    Raises
    ------
    InputError : as `plan_of_run`
    """
    plan, asked = plan_of_run(output)
    for moved in set_aside(with_failures(plan)):
        logger.warning("%s", moved)
    plan = with_failures(plan)
    wanted = {None: {*asked, *OF_COHORT}, "failure": {*asked}, "success": set[str]()}[after]
    done = {*asked} - {"cohort_page"} if after == "success" else set()
    written = [Path(path) for path in _write_failure_pages(plan)]
    measured = bool(plan.measured_certificates())
    for result in OverAll(plan).results:
        there = any(Path(path).exists() for path in result.files)
        if result.rule in done or not (result.rule in wanted or there):
            continue
        if after == "success" and not all(Path(path).exists() for path in result.inputs()):
            continue
        if measured or not result.measures:
            result.write()
            written += map(Path, result.files)
        else:
            for path in result.files:
                Path(path).unlink(missing_ok=True)
    if after != "success":
        with atomic_path(Path(plan.layout.output) / REPORTED) as temporary:
            temporary.write_text(datetime.now().isoformat(), encoding="utf-8")
    return written


def _write_failure_pages(plan: Plan) -> list[str]:
    """Write the pages of meshes that have none of their own, because they or their volumes failed; their paths."""
    written = []
    pages, small = plan.each_case(plan.layout.case_page), plan.each_case(plan.layout.thumbnail)
    for mesh, failure in plan.failures.items():
        if not plan.is_measured(mesh) or failure["stage"] == "volumes":
            _write_failure_page(plan, mesh, failure, pages[mesh], small[mesh])
            written.append(pages[mesh])
    return written


def _write_failure_page(plan: Plan, mesh: Mesh, failure: Mapping[str, Any], page: str, small: str) -> None:
    from cortet.formats import gifti
    from cortet.report.case_page import about, write_failure_page
    from cortet.report.pictures import thumbnail

    case, job = plan.cases[mesh[0]], plan.job(mesh)
    given = existing(filled(plan.layout.surface("phantom"), job) if case.is_phantom else case.surface)
    surface, trouble = None, "There is no such file."
    if given:
        try:
            surface = gifti.read_surface(str(given), finite=False)
        except CortetError as error:
            trouble = f"It cannot be drawn: {error}"
    facts, cohort = about(plan.about(job)), beside(plan.layout.cohort_page, page)
    write_failure_page(case.name, failure, page, surface=surface, trouble=trouble, facts=facts, cohort=cohort)
    with atomic_path(small) as temporary:
        temporary.write_bytes(thumbnail(surface, cast(Literal["L", "R"] | None, case.hemi)))


def aggregate(config: Mapping[str, Any], output: Path, *, dry_run: bool = False) -> list[Path]:
    """Make the results over all cases of the meshes that earlier runs left; the caller holds the lock of the folder.

    Parameters
    ----------
    config : content of a configuration, whose sheet names the cases
    dry_run : see only whether there is a mesh

    Returns
    -------
    The files that were written

    Raises
    ------
    InputError : no case of the sheet has a certificate there, or as `plan_of`
    """
    plan = plan_of(config)
    if not with_failures(plan).measured_certificates():
        raise InputError("holds no mesh of these cases yet", file=output, remedy="run the level participant first")
    if dry_run:
        return []
    remember_run(plan, config, {*run_record(output).get("asked", []), *OF_COHORT})
    return report(output)


def files(plan: Plan, name: str, *suffixes: str) -> list[str]:
    """Files over all cases that have one name."""
    return [plan.layout.cohort(f"{name}{suffix}") for suffix in suffixes]


@dataclass(frozen=True)
class OverAll:
    """The results over all cases of a plan."""

    plan: Plan
    #: when a run began that has not ended
    began: str = ""

    @cached_property
    def results(self) -> list[Result]:
        """All results, those that others are made from first."""
        maps = map(self._mean_maps, filter(self.plan.mapped, "LR"))
        more = (result for neighbour in neighbours() for result in neighbour.results(self.plan))
        return [*map(self._with_look, [*self._cohort(), *maps, *more]), self._methods(), self._page()]

    def _with_look(self, result: Result) -> Result:
        """A result that, where it is a figure, is drawn in the look that the configuration names."""

        def write() -> None:
            from cortet.report.figures import look

            with look(self.plan.config.figures.journal):
                result.write()

        return replace(result, write=write) if result.is_drawn else result

    def of(self, *rules: str) -> list[str]:
        """The files of some results."""
        return [path for result in self.results if result.rule in rules for path in result.files]

    def __getitem__(self, rule: str) -> Result:
        return next(result for result in self.results if result.rule == rule)

    def _files(self, name: str, *suffixes: str) -> list[str]:
        return files(self.plan, name, *suffixes)

    def _certificates(self) -> list[str]:
        return self.plan.measured_certificates()

    def _cases(self) -> list[dict[str, Any]]:
        return [asdict(case) for case in self.plan.cases.values()]

    def _table(
        self, rule: str, label: str, inputs: Callable[[], Iterable[str]], write: Callable[..., None], **more: Any
    ) -> Result:
        """A table of the cohort: TSV, sidecar and a page for Snakemake's report."""
        files = self._files(rule, ".tsv", ".json", ".html")
        shown = {files[2]: ("Cohort", {"result": f"table: {label}"})}
        code = (more.pop("code"), "report.table_files")
        return Result(rule, files, inputs, lambda: write(files), code, shown, caption=rule, **more)

    def _cohort(self) -> list[Result]:
        plan, cases = self.plan, list(self.plan.cases.values())

        def quality(files: Sequence[str]) -> None:
            from cortet.report.cohort_tables import write_quality

            write_quality(self._certificates(), cases, files)

        def summary(files: Sequence[str]) -> None:
            from cortet.report.cohort_tables import write_summary

            write_summary(self._certificates(), cases, files)

        def stages(files: Sequence[str]) -> None:
            from cortet.report.records import write_stages

            write_stages(plan.stage_records(), files)

        def draw() -> None:
            from cortet.report.figures import cohort_figure, save

            table, own = Path(self.of("cohort_quality")[0]), plan.config
            save(cohort_figure(table, limit=own.certify.q_max, target=own.target), *figure)

        def status(files: Sequence[str]) -> None:
            from cortet.cohort.status import COLUMNS, status_rows
            from cortet.report.table_files import Table, write

            write(Table("What became of every case", COLUMNS), status_rows(plan.status()), *files)

        def cite() -> None:
            from cortet.report.citation import write_citation
            from cortet.report.methods import methods_text
            from cortet.report.records import read_certificate

            contents = [read_certificate(path) for path in self._certificates()]
            write_citation(methods_text(contents, plan.sheet, plan.unmeasured()), contents, *cited)

        def tissues(files: Sequence[str]) -> None:
            from cortet.report.cohort_tissues import write_tissues

            tables = plan.tissue_tables()
            write_tissues(list(tables.values()), [plan.described(mesh) for mesh in tables], files)

        of_cases = {"code": "report.cohort_tables", "facts": self._cases}
        figure = self._files("figure-cohort", ".svg", ".pdf", ".png")
        cited = [f"{plan.layout.output}/logs/CITATION{suffix}" for suffix in (".md", ".bib", ".tex", ".html")]
        found = [
            self._table("cohort_quality", "quality", self._certificates, quality, **of_cases),
            self._table("cohort_summary", "summary", self._certificates, summary, **of_cases),
            self._table(
                "cohort_stages",
                "stages",
                lambda: [*plan.stage_records(), *self._certificates()],
                stages,
                code="report.records",
            ),
            Result(
                "cohort_figure",
                figure,
                lambda: self.of("cohort_quality")[:1],
                draw,
                ("report.figures",),
                {figure[0]: ("Cohort", {"result": "figure: quality against age"})},
                "cohort_figure",
                lambda: {"limit": plan.config.certify.q_max, "target": plan.config.target},
            ),
            self._table(
                "cohort_status",
                "status",
                lambda: [*self._certificates(), *plan.exported_files()],
                status,
                code="cohort.status",
                facts=lambda: [{**row, "certificate": "certificate" in row} for row in plan.status()],
                measures=False,
            ),
            Result(
                "citation",
                cited,
                self._certificates,
                cite,
                ("report.methods", "report.citation"),
                facts=lambda: [asdict(case) for case in plan.sheet],
            ),
        ]
        if plan.has_volumes:
            found.append(
                self._table(
                    "cohort_tissues",
                    "tissues",
                    lambda: [*plan.tissue_tables().values(), *self._certificates()],
                    tissues,
                    code="report.cohort_tissues",
                    facts=lambda: [plan.described(mesh) for mesh in plan.tissue_tables()],
                )
            )
        return found

    def _mean_maps(self, hemi: str) -> Result:
        plan = self.plan
        files = [
            *self._files(f"hemi-{hemi}_desc-mean_", "white.surf.gii", "maps.shape.gii", "maps.json"),
            *self._files(f"figure-maps_hemi-{hemi}", ".png"),
        ]

        def write() -> None:
            from cortet.report.cohort_maps import write_maps

            write_maps(list(plan.maps(hemi).items()), *files)

        return Result(
            f"cohort_maps_{hemi}",
            files,
            lambda: [*plan.maps(hemi).values(), *self._certificates()],
            write,
            ("report.cohort_maps", "report.render"),
            {files[-1]: ("Cohort", {"result": f"maps on the common mesh, {hemi}"})},
            "cohort_maps",
            lambda: list(plan.maps(hemi)),
            memory_mb=4000,
            minutes=60,
        )

    def _methods(self) -> Result:
        plan, text = self.plan, self._files("methods", ".md", ".html")

        def write() -> None:
            from cortet.report.methods import write_methods

            write_methods(self._certificates(), plan.sheet, plan.unmeasured(), text[0], text[1])

        return Result(
            "methods",
            text,
            self._certificates,
            write,
            ("report.methods", "report.citation"),
            {text[1]: ("Methods", {"text": "methods paragraph"})},
            "methods",
            lambda: [asdict(case) for case in plan.sheet],
        )

    def _page(self) -> Result:
        plan, page = self.plan, self.plan.layout.cohort_page

        def of_neighbours() -> list[OnPage]:
            return [part for neighbour in neighbours() if (part := neighbour.on_page(plan))]

        def parts() -> dict[str, Any]:
            """Parts of the page that are there."""
            quality, figure = self._files("cohort_quality", ".tsv", ".json"), self._files("figure-cohort", ".svg")
            tissues = self._files("cohort_tissues", ".tsv")
            measured = bool(self._certificates())
            return {
                "quality": quality if measured else [],
                "figure": figure if measured else [],
                "maps": [self.plan.layout.cohort(f"figure-maps_hemi-{hemi}.png") for hemi in plan.mapped_hemispheres()],
                "tissues": tissues if plan.tissue_tables() else [],
            }

        def write() -> None:
            from cortet.report.cohort_page import write_cohort_page
            from cortet.report.pages import data_uri

            part = {name: [Path(path) for path in paths] for name, paths in parts().items()}
            small = {mesh: Path(file) for mesh, file in plan.each_case(plan.layout.thumbnail).items()}
            meshes = [
                {**row, "thumbnail": data_uri(file.read_bytes(), "image/webp") if file.exists() else None}
                for row, file in zip(plan.listed_on_page(), small.values(), strict=True)
            ]
            write_cohort_page(
                Path(self.of("cohort_status")[0]),
                (part["quality"][0], part["quality"][1]) if part["quality"] else None,
                page,
                meshes=meshes,
                figure=part["figure"][0] if part["figure"] else None,
                maps=dict(zip(cast(list[Literal["L", "R"]], plan.mapped_hemispheres()), part["maps"], strict=True)),
                tissues=part["tissues"][0] if part["tissues"] else None,
                more=of_neighbours(),
                dataset=plan.config.cohort.dataset.resolve().name if plan.config.cohort.dataset else "",
                began=self.began,
            )

        return Result(
            "cohort_page",
            [page],
            lambda: [
                *self.of("cohort_status")[:1],
                *(path for paths in parts().values() for path in paths),
                *(path for part in of_neighbours() for path in part.files),
                *plan.each_case(plan.layout.thumbnail).values(),
            ],
            write,
            ("report.pages",),
            facts=lambda: [plan.listed_on_page(), *(part.facts for part in of_neighbours())],
            measures=False,
        )
