"""The sheet and the configuration of a run, as the rules see them: a plan and the names of all files."""

import os
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from cortet import __version__
from cortet.cohort.app import require_plain_python
from cortet.cohort.bids import Places, descriptions, require_own_output
from cortet.cohort.layout import EXPORTED, LABELS, SHARED, WILDCARDS, beside, file_of
from cortet.cohort.lock import is_held_by_parent, require_free
from cortet.cohort.plan import existing
from cortet.cohort.receipts import ask, content, receipt_path
from cortet.cohort.resources import cost
from cortet.config import keys_not_given, read, version_of
from cortet.errors import CortetError
from cortet.formats.ownership import changed_of, is_whole
from cortet.meshers import OWN
from cortet.neighbours import neighbours
from cortet.report.over_all import OF_COHORT, OverAll, plan_of
from cortet.stages import STAGES


def waited_for(rule, **wildcards):
    """The report of a checkpoint; asking for it makes its job run first."""
    return getattr(checkpoints, rule).get(**wildcards).output["report"]


try:
    require_plain_python()
    if workflow.is_main_process:
        for file in workflow.configfiles:  # Snakemake takes the last of two values of a key in silence
            read(Path(file))
    # the sheet is read here and never an input of a rule: a new row then runs one new case
    PLAN = replace(plan_of(config), waited_for=waited_for)
    if workflow.is_main_process:  # receipts are written there before a run begins, and by a dry run
        require_own_output(PLAN.config.output, PLAN.config.cohort.dataset)
        if not is_held_by_parent():
            require_free(PLAN.config.output)
    OVER_ALL = OverAll(PLAN)
    CONFIG, SETTINGS, CASES = PLAN.config, PLAN.settings, PLAN.cases
    RESULTS = OVER_ALL.results
except CortetError as error:
    raise WorkflowError(str(error)) from None
DEFAULTS = keys_not_given(config, GIVEN) if "sheet" in GIVEN.get("cohort", {}) else []
if DEFAULTS:
    logger.warning(
        f"from config.yaml in {Path.cwd()}, since your own configuration does not say: {'; '.join(DEFAULTS)}"
    )
for notice in [*CONFIG.notices(), *PLAN.notices()]:
    logger.warning(notice)

# scripts/_job.py keeps to it; no parameter of a rule, since another limit makes no other result
os.environ.update(CORTET_TIME_LIMIT=str(CONFIG.time_limit or 0))

LAYOUT = PLAN.layout
OUT = LAYOUT.output
# what BIDS URIs begin with; no parameter either, it changes no result
RAW = str(CONFIG.cohort.dataset or CONFIG.cohort.sheet.parent)
os.environ.update(CORTET_OUTPUT=OUT, CORTET_RAW=RAW)

# names of wildcards of the jobs on a surface, on an inner one, and on a mesh
SURFACE = ("folder", "case")
INNER = (*SURFACE, "inner")
MESH = (*SURFACE, "res", "mesher", "setting")
SHARED_MESH = (*SURFACE, "res", "mesher")
#: rules that this run asks for, and what it asks of each job, by its receipt
ASKED, FINGERPRINTS = set(), {}
#: files that were changed after cortet wrote them, of which this run has told
TOLD = set()


wildcard_constraints:
    **WILDCARDS,
    setting="|".join(["", *SETTINGS]),  # an empty expression alone would be none
    suffix="|".join(map(re.escape, EXPORTED)),


def of_neighbours(_):
    """Files of single cases that neighbours of the core add to a whole run."""
    return [path for neighbour in neighbours() for path in neighbour.files(PLAN)]


def of_mesh(stage):
    """Wildcards of the jobs of a stage that makes a mesh; some stages are shared by all settings."""
    return SHARED_MESH if LABELS[stage] in SHARED else MESH


def intermediate(files):
    """Output that only later stages read."""
    return files if CONFIG.keep_intermediates else temp(files)


def versions(*modules):
    """Parameter of a rule: the versions of the code that makes its results."""
    return [version_of(module) for module in modules]


def recorded(stage):
    """Parameters of a rule that say in its report whose it is, what it was made from, and in whose space it is."""
    return {
        "origin": partial(PLAN.origin, STAGES[stage].label),
        "input_sha256": PLAN.input_sha256,
        "space": PLAN.space,
    }


def took(rule, wildcards):
    """Pattern of the benchmark of a job: its seconds and memory."""
    return LAYOUT.log(rule, wildcards, kind="tsv")


def asked(rule):
    """Memory and minutes that a job on a case asks for."""
    cost(rule)  # an error here and now for a rule that nobody has measured
    return {"mem_mb": partial(PLAN.megabytes, rule), "runtime": partial(PLAN.minutes, rule)}


def receipt(name):
    """An input of a rule: the receipt of its job, newer than the job's files if they must be made again.

    What is there is used only if it was made with what is asked for now, from files of the same names. A job runs again,
    too, if a file is gone that a record among its outputs lists: the files of some formats are several. One that was
    changed is left, and reported.
    """

    def path(wildcards):
        step, known = getattr(rules, name), dict(wildcards.items())
        file = receipt_path(Path(OUT), Path(str(step.log[0]).format(**known)))
        if workflow.is_main_process:
            ASKED.add(name)
            parameters = {key: filled_in(value, wildcards) for key, value in step.params.items()}
            inputs = [filled_in(value, wildcards) for key, value in step.input.items() if key != "receipt"]
            records = records_of(step, known) if name in ("export", "ten_nodes") else []
            names = [[relative(path) for path in listed(value)] for value in inputs]
            try:
                again = not all(map(is_whole, records))
                FINGERPRINTS[relative(file)] = ask(file, name, known, {**parameters, "inputs": names}, again=again)
            except CortetError as error:
                raise WorkflowError(str(error)) from None
            for changed in [changed for record in filter(is_whole, records) for changed in changed_of(record)]:
                if changed not in TOLD:
                    logger.warning(f"{changed} was changed after cortet wrote it: delete it, and it is made again")
                    TOLD.add(changed)
        return str(file)

    return path


def filled_in(value, wildcards):
    """A parameter or an input of a job."""
    return value(wildcards) if callable(value) else value.format(**wildcards) if isinstance(value, str) else value


def listed(value):
    return [value] if isinstance(value, (str, Path)) else list(value)


def relative(path):
    """A file below the output folder; others, which are the user's, count by their content."""
    inside = os.path.relpath(path, OUT)
    return None if inside.startswith("..") else inside


def records_of(step, wildcards):
    """Records among the outputs of a job."""
    return [Path(str(output).format(**wildcards)) for output in step.output if str(output).endswith(".json")]


def made_from(result, wildcards):
    return list(result.inputs())


def facts_of(result, wildcards):
    return result.facts()


def in_report(result, path):
    """An output, as Snakemake's report shows it."""
    if path not in result.shown:
        return path
    category, labels = result.shown[path]
    return report(path, caption=f"../reports/{result.caption}.rst", category=category, labels=labels)
