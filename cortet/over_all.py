"""Tables, figures and pages over all cases, made of what is in the output folder.

Four rules of the workflow make them when all cases are done. After a run with failures, and at any time by
`cortet cohort report`, `report` makes them of what is there.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import chdir, contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, cast

from cortet.cohort.bids import Places, describe, descriptions
from cortet.cohort.inputs import existing
from cortet.cohort.jobs import Jobs
from cortet.cohort.layout import beside, filled
from cortet.cohort.outdated import set_aside
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import read_sheet
from cortet.cohort.states import COLUMNS, States, read_states
from cortet.config import load
from cortet.errors import CortetError, InputError
from cortet.folding.plan import Folds, folds_on_page
from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.ownership import json_of
from cortet.formats.tables import write_table
from cortet.paper.results import results as paper_results
from cortet.report.results import Results, files_of
from cortet.stages import require_nesting, require_programs, settled

logger = logging.getLogger(__name__)

#: rules that a whole run asks for; those of the paper need at least one mesh with a certificate
OF_COHORT = ("cohort_tables", "cohort_page")
#: what a run records of itself in its output folder
RUN = ".cortet/run.json"
#: when `report` last wrote results that a run may still change; Snakemake then makes them again
REPORTED = ".cortet/reported.txt"


# --- a run -------------------------------------------------------------------------------------------------------


def plan_of(config: Mapping[str, Any]) -> Plan:
    """The plan of a run, from the content of its configuration."""
    own = settled(load(config))
    # by the name that files carry: the line's own setting carries none, others are run beside it
    settings = {"": own} | {
        name.capitalize(): settled(load({**config, "setting": name}))
        for name in own.experiments.settings
        if name != own.setting
    }
    for setting in settings.values():
        require_programs(setting)
    plan = Plan(settings, read_sheet(own.cohort.sheet))
    if any(case.inner for case in plan.cases.values()):
        require_nesting(own)
    return plan


def remember_run(plan: Plan, config: Mapping[str, Any], asked: Iterable[str]) -> None:
    """Describe the output folder of a run; record its configuration, and the rules over all cases that it asks for.

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
    _describe(plan)
    _update_states(read_states(plan), began=datetime.now().astimezone().strftime("%Y-%m-%d at %H:%M"))


def _describe(plan: Plan) -> None:
    """Write what the output folder of a run is."""
    output = Path(plan.layout.output)
    sources = Places(output, plan.raw).links(path for case in plan.cases.values() for path in case.files)
    describe(output, sources, descriptions(plan.settings))


def run_record(output: Path) -> dict[str, Any]:
    """What the last run recorded of itself in an output folder; empty if no run did."""
    return json_of(output / RUN)


def is_of_run(config: Mapping[str, Any], output: Path) -> bool:
    """Whether the last run that wrote to an output folder had the sheet and the dataset of a configuration."""
    earlier, now = ((one.get("cohort") or {}) for one in (run_record(output).get("config") or {}, config))
    return bool(earlier) and all(earlier.get(key) == now.get(key) for key in ("sheet", "dataset"))


@contextmanager
def last_run(output: Path) -> Iterator[tuple[Plan, list[str]]]:
    """The plan of the last run that wrote to an output folder, and the rules over all cases that it asked for.

    Meanwhile the process is in the folder in which the run was started: names of files are relative to it.

    Raises
    ------
    InputError : no run recorded its configuration there, or its folder or its sheet is missing
    """
    output, record = output.absolute(), run_record(output)
    if not {"config", "asked", "folder"} <= record.keys():
        remedy = "name the output folder of `snakemake` or `cortet run`"
        raise InputError("the folder has no configuration of a cortet run", file=output, remedy=remedy)
    folder = output / record["folder"]
    if not folder.is_dir():
        remedy = "move the output folder back next to it, or restart the run"
        raise InputError("the folder of the run is missing", file=folder, remedy=remedy)
    with chdir(folder):
        yield plan_of({**record["config"], "output": os.path.relpath(output)}), list(record["asked"])


def report(output: Path, *, after: Literal["success", "failure"] | None = None) -> list[Path]:
    """Make results over all cases, and the pages of failed cases, of what is in an output folder.

    Parameters
    ----------
    after : how the run ended that calls this. After a failure, what the run asked for and what is there is made again;
        after a success, only what is there and the run did not make. None: everything that a whole run makes, too

    Returns
    -------
    The files that were written

    Raises
    ------
    InputError : as `last_run`
    """
    with last_run(output) as (plan, asked):
        for moved in set_aside(read_states(plan)):
            logger.warning("%s", moved)
        states = read_states(plan)
        if after is None:
            _describe(plan)
        written = _write_failure_pages(states)
        wanted = {None: {*asked, *OF_COHORT}, "failure": {*asked}, "success": set[str]()}[after]
        if Path(plan.layout.cohort_page).exists():
            wanted.add("cohort_tables")  # of which it is made
        for rule, result in results(states).items():
            made_by_run = after == "success" and (rule in asked or not all(map(_exists, result.inputs())))
            if made_by_run or not (rule in wanted or any(map(_exists, result.files))):
                continue
            if rule in OF_COHORT or states.measured():
                result.write()
            else:
                _delete(result.files)
            written += filter(_exists, result.files)
        if after == "success":
            _update_states(states)
        else:
            with atomic_path(Path(plan.layout.output) / REPORTED) as temporary:
                temporary.write_text(datetime.now().isoformat(), encoding="utf-8")
        return [Path(path).absolute() for path in written]


def _exists(path: str) -> bool:
    return Path(path).exists()


def _delete(files: Iterable[str]) -> None:
    for path in files:
        Path(path).unlink(missing_ok=True)


def _write_failure_pages(states: States) -> list[str]:
    """Write the pages of meshes that have none of their own, because they or their volumes failed; their paths.

    A mesh of an earlier version, or of other settings, keeps its page with its certificate.
    """
    plan = states.plan
    pages, small = plan.each_case(plan.layout.case_page), plan.each_case(plan.layout.thumbnail)
    failed = {mesh: state for mesh, state in states.of.items() if not state.verdict or state.stage == "volumes"}
    for mesh, state in states.of.items():
        if state.state == "unfinished" and state.is_kept and _exists(pages[mesh]):
            failed.pop(mesh, None)
    if not failed:  # what draws takes a second to load
        return []
    from cortet.formats import gifti
    from cortet.report.case_page import about, write_failure_page
    from cortet.report.pictures import thumbnail

    written = []
    for mesh, state in failed.items():
        case, job, page = plan.cases[mesh[0]], plan.job(mesh), pages[mesh]
        given = existing(filled(plan.layout.surface("phantom"), job) if case.is_phantom else case.surface)
        surface, trouble = None, "There is no such file."
        try:
            surface = gifti.read_surface(str(given), finite=False) if given else None
        except CortetError as error:
            trouble = f"cortet cannot draw it: {error}"
        facts, cohort = about(Jobs(plan).page_facts(job)), beside(plan.layout.cohort_page, page)
        write_failure_page(case.name, vars(state), page, surface=surface, trouble=trouble, facts=facts, cohort=cohort)
        with atomic_path(small[mesh]) as temporary:
            temporary.write_bytes(thumbnail(surface, cast(Literal["L", "R"] | None, case.hemi)))
        written.append(page)
    return written


# --- results -----------------------------------------------------------------------------------------------------


def results(states: States) -> dict[str, Results]:
    """All results by their rules, those that others are made from first."""
    return {"cohort_tables": cohort_tables(states), "cohort_page": cohort_page(states), **paper_results(states)}


def cohort_tables(states: States) -> Results:
    """Quality, stages, tissues and states."""
    plan = states.plan
    files = _tables(plan)

    def inputs() -> list[str]:
        measured = [*states.measured_certificates(), *states.exported_files(), *plan.quality_records(states.measured())]
        return [*measured, *states.tissue_tables().values()]

    def facts() -> Any:
        return [[asdict(case) for case in plan.sheet], plan.meshes()]

    def write() -> None:
        from cortet.report import cohort_tables
        from cortet.report.records import read_certificate

        _write_status(states)
        certificates, cases = [*map(read_certificate, states.measured_certificates())], list(plan.cases.values())
        cohort_tables.write_quality(certificates, cases, files["quality"])
        cohort_tables.write_stages(plan.quality_records(states.measured()), files["stages"])
        if plan.has_volumes:
            tables = states.tissue_tables()
            described = [plan.described(mesh) for mesh in tables]
            cohort_tables.write_tissues(list(tables.values()), described, files["tissues"])

    return Results([path for paths in files.values() for path in paths], inputs, facts, write)


def _tables(plan: Plan) -> dict[str, list[str]]:
    """Files of each table of a cohort."""
    return {
        "status": files_of(plan, "cohort_status", ".tsv", ".json"),
        "quality": files_of(plan, "cohort_quality", ".tsv", ".json"),
        "stages": files_of(plan, "cohort_stages", ".tsv", ".json"),
        **({"tissues": files_of(plan, "cohort_tissues", ".tsv", ".json")} if plan.has_volumes else {}),
    }


def _write_status(states: States) -> None:
    write_table(COLUMNS, states.rows(), *_tables(states.plan)["status"])


def _update_states(states: States, *, began: str = "") -> None:
    """Write the table of states and the page anew, where they are there: they say how far the cases are."""
    plan = states.plan
    if _exists(_tables(plan)["status"][0]):
        _write_status(states)
        if _exists(plan.layout.cohort_page):
            _write_page(states, began=began)


def cohort_page(states: States) -> Results:
    """The page of a cohort with what it shows: figure, means on the common mesh, folds; and the methods paragraph."""
    plan = states.plan
    tables, parts, maps = _tables(plan), folds_on_page(states), _maps(plan)
    figure = _figure(plan)
    of_parts = [path for part in parts for path in part.files]

    def inputs() -> list[str]:
        return [
            tables["status"][0],
            *(tables["quality"][:2] if states.measured() else []),
            *(tables["tissues"][:1] if states.tissue_tables() else []),
            *plan.each_case(plan.layout.thumbnail).values(),
            *(path for hemi in maps for path in states.maps(hemi).values()),
            *(path for part in parts for path in part.inputs),
        ]

    def facts() -> Any:
        mapped, of_parts = [list(states.maps(hemi)) for hemi in maps], [part.facts for part in parts]
        return [_listed(plan), mapped, of_parts, _limits(plan)]

    def write() -> None:
        from cortet.report.figures import cohort_figure, save

        save(cohort_figure(Path(tables["quality"][0]), **_limits(plan)), *figure)
        for hemi, files in maps.items():
            if cases := states.maps(hemi):
                from cortet.report.cohort_maps import write_maps  # loads VTK

                write_maps(list(cases.items()), hemi, *files)
            else:
                _delete(files)
        for part in parts:
            part.write()
        _write_page(states)
        _cite(states)

    of_maps = [path for paths in maps.values() for path in paths]
    files = [plan.layout.cohort_page, *_citation(plan), *figure, *of_maps, *of_parts]
    return Results(files, inputs, facts, write)


def _listed(plan: Plan) -> list[dict[str, Any]]:
    """The meshes that the page lists."""
    pages = plan.each_case(plan.layout.case_page)
    return [plan.described(mesh) | {"page": beside(page, plan.layout.cohort_page)} for mesh, page in pages.items()]


def _citation(plan: Plan) -> list[str]:
    """Files of the methods paragraph of a run, and of its references."""
    return [f"{plan.layout.output}/logs/CITATION{suffix}" for suffix in (".md", ".bib")]


def _cite(states: States) -> None:
    """Write the methods paragraph of a run, with its folds."""
    plan = states.plan
    from cortet.folding.sentences import fold_sentences, verdict_of_fold
    from cortet.report.methods import methods_text, write_citation
    from cortet.report.records import read_certificate

    certificates = [*map(read_certificate, states.measured_certificates())]
    unmeasured = {mesh[0]: state.reason for mesh, state in states.of.items() if not state.verdict}
    methods, folds = "No mesh has been made.", {}
    for path, run in Folds(plan).runs().items():
        if verdict := verdict_of_fold(Path(path).parent):
            folds[" ".join(filter(None, (run["case"], run["variant"])))] = verdict
    if certificates:
        methods = methods_text(certificates, plan.sheet, unmeasured, fold_sentences(folds))
    write_citation(methods, certificates, *_citation(plan))


def _figure(plan: Plan) -> list[str]:
    """Files of the figure of a cohort."""
    return files_of(plan, "figure-cohort", ".svg", ".pdf", ".png")


def _limits(plan: Plan) -> dict[str, Any]:
    """The limit and the target of the worst q, which figures show."""
    return {"limit": plan.config.certify.q_max, "target": plan.config.target}


def _maps(plan: Plan) -> dict[Literal["L", "R"], list[str]]:
    """By hemisphere with cases on the common mesh: mean surface, its maps, their sidecar, and their picture."""
    sides: tuple[Literal["L", "R"], ...] = ("L", "R")
    return {
        hemi: [
            *files_of(plan, f"hemi-{hemi}_desc-mean_", "white.surf.gii", "maps.shape.gii", "maps.json"),
            *files_of(plan, f"figure-maps_hemi-{hemi}", ".png"),
        ]
        for hemi in sides
        if plan.mapped(hemi)
    }


def _write_page(states: States, *, began: str = "") -> None:
    """Write the page.

    Parameters
    ----------
    began : when a run began that has not ended; empty if none runs
    """
    plan = states.plan
    from cortet.report.cohort_page import write_cohort_page
    from cortet.report.pages import data_uri

    tables = {name: [Path(path) for path in paths] for name, paths in _tables(plan).items()}
    quality, dataset = tables["quality"], plan.config.cohort.dataset
    measured = bool(states.measured()) and quality[0].exists()
    figure = Path(_figure(plan)[0])
    small = [Path(path) for path in plan.each_case(plan.layout.thumbnail).values()]
    write_cohort_page(
        tables["status"][0],
        (quality[0], quality[1]) if measured else None,
        plan.layout.cohort_page,
        meshes=[
            {**row, "thumbnail": data_uri(file.read_bytes()) if file.exists() else None}
            for row, file in zip(_listed(plan), small, strict=True)
        ],
        figure=figure.read_text(encoding="utf-8", errors="replace") if measured and figure.exists() else "",
        maps={hemi: Path(files[-1]) for hemi, files in _maps(plan).items() if _exists(files[-1])},
        tissues=tables["tissues"][0] if states.tissue_tables() else None,
        more=[part for part in folds_on_page(states) if all(map(_exists, part.files))],
        dataset=dataset.resolve().name if dataset else "",
        began=began,
    )
