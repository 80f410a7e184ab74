"""The sheet and the configuration of a run, as the rules see them: a plan and the names of all files.

Snakemake remembers the parameters of each job and runs it again if one has changed (profiles/default). The parameter
`made_from` is a hash of the settings of the stages so far, of the VERSION of their code and of the content of the user's
files. Names of files decide nothing: they are `derived`.
"""

import os
import re
from dataclasses import replace
from fnmatch import fnmatch
from functools import partial
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from cortet.cohort.app import CHOSEN as of_app, require_plain_python
from cortet.cohort.bids import require_own_output
from cortet.cohort.inputs import existing, existing_of
from cortet.cohort.jobs import Jobs
from cortet.cohort.layout import EXPORTED, LABELS, WILDCARDS, beside, filled, inner_of
from cortet.cohort.lock import require_free
from cortet.cohort.states import States, read_states
from cortet.cohort.user_files import content
from cortet.config import keys_not_given, read
from cortet.errors import CortetError
from cortet.meshers import OWN
from cortet.folding.plan import Folds
from cortet.over_all import REPORTED, plan_of, results
from cortet.formats.certificates import certificate_of
from cortet.stages import STAGES, notices
from cortet.version import version_of


def waited_for(rule, **wildcards):
    """The report of a checkpoint; asking for it makes its job run first."""
    return getattr(checkpoints, rule).get(**wildcards).output["report"]


def told_at_start():
    """Checks and warnings for the user; jobs of a cluster, which read these rules, too, do without."""
    for file in workflow.configfiles:  # Snakemake takes the last of two values of a key in silence
        read(Path(file))
    require_own_output(CONFIG.output, CONFIG.cohort.dataset)
    require_free(CONFIG.output)
    again = [state for state in read_states(PLANNED).of.values() if state.state == "unfinished" and state.remedy]
    edited, others = ([one for one in again if (one.stage == "export") is is_edited] for is_edited in (True, False))
    told = [*notices(CONFIG), *PLANNED.notices(), *(state.in_words for state in edited)]
    if "sheet" in GIVEN.get("cohort", {}) and (defaults := keys_not_given(config, GIVEN)):
        told.append(
            f"config.yaml in {Path.cwd()} sets keys that your own configuration does not: {'; '.join(defaults)}"
        )
    if others:
        rules = " ".join(sorted({state.stage for state in others}))
        told.append(
            f"meshes with other settings, surfaces or versions than the present ones, or edited ones: {len(others)}. "
            f"If this run has no jobs for them, `snakemake --forcerun {rules}` remakes them"
        )
    return told


try:
    require_plain_python()
    # the sheet is read here and never an input of a rule: a new row then runs one new case
    PLANNED = plan_of(config)  # as it lies there
    PLAN = replace(PLANNED, waited_for=waited_for)
    CONFIG, SETTINGS, CASES = PLAN.config, PLAN.settings, PLAN.cases
    RESULTS = results(States(PLAN))
    for warning in told_at_start() if workflow.is_main_process else []:
        logger.warning(warning)
except CortetError as error:
    raise WorkflowError(str(error)) from None

FOLDS = Folds(PLAN)
# what `cortet run` asks for, which may be some cases
CHOSEN = replace(PLAN, chosen=frozenset(os.environ[of_app].split())) if of_app in os.environ else PLAN
JOBS = Jobs(PLAN)
INPUTS, SOURCES = JOBS.inputs, JOBS.sources
LAYOUT = PLAN.layout
OUT = LAYOUT.output
# what BIDS URIs begin with
RAW = str(PLAN.raw)

# names of wildcards of the jobs on a case, on one of its surfaces, and on a mesh
CASE = ("folder", "case")
SURFACE = (*CASE, "region")
MESH = (*CASE, "res", "mesher", "setting")
SHARED_MESH = (*CASE, "res", "mesher")
#: rules over all cases that this run asks for
ASKED = set()
#: names of files that Snakemake's report shows -> captions in reports/
CAPTIONS = {
    "figure-cohort.svg": "cohort_figure",
    "figure-maps_*.png": "cohort_maps",
    "cohort_folding.svg": "cohort_folding",
    "figure-pooled-quality_*.svg": "figure_pooled_quality",
    "figure-series.svg": "figure_series",
}


wildcard_constraints:
    **WILDCARDS,
    setting="|".join(["", *SETTINGS]),  # an empty expression alone would be none
    suffix="|".join(map(re.escape, EXPORTED)),


def intermediate(files):
    """Output that only later stages read."""
    return files if CONFIG.keep_intermediates else temp(files)


def by_content(function):
    """Inputs that the user may have made. Whether these have changed is for `input_sha256` to say, not for their times.

    A copy has a new name and is newer than what was made from the same content.
    """

    def files(wildcards):
        found = function(wildcards)
        if isinstance(found, list):
            return [one if one.startswith(f"{OUT}/") else ancient(one) for one in found]
        return found if found.startswith(f"{OUT}/") else ancient(found)

    return files


#: the mesh at the end of the line and its certificate. One that was edited makes no job run again: the job would refuse
#: it, and Snakemake first deletes what the job made before. When the last stage runs again, its report says so
LAST_MESH = ancient(LAYOUT.mesh(LABELS["solver_ready"]))
CERTIFICATE = ancient(LAYOUT.certificate)
LAST_REPORT = LAYOUT.mesh(LABELS["solver_ready"], "tetmesh.json")


def mesh_with_volumes(wildcards):
    """The mesh at the end of the line, with what its volumes hold if the case has some."""
    return LAYOUT.mesh(LABELS["solver_ready"], "volumes.vtu") if CASES[wildcards.case].volumes else LAST_MESH


def surface_of(stage):
    """Output of a stage that takes each surface of a case by itself."""
    return {"surface": LAYOUT.each_surface(stage), "report": LAYOUT.each_surface(stage, "white.json")}


def mesh_of(stage):
    """Output of a stage that makes a mesh."""
    label = LABELS[stage]
    mesh = LAYOUT.mesh(label)
    return {
        "mesh": mesh if stage == "solver_ready" else intermediate(mesh),
        "report": LAYOUT.mesh(label, "tetmesh.json"),
        "quality": LAYOUT.mesh(label, "quality.json"),
    }


def versions(*modules):
    """Parameter of a rule: the versions of the code that makes its results."""
    return [version_of(module) for module in modules]


def derived(function):
    """A parameter that is no reason to run a job again, as Snakemake takes one that depends on `input`."""
    return lambda wildcards, input: function(wildcards)


def made_from(rule):
    """Parameter of a rule on a case, by which `cortet.cohort.states` knows a failure that still counts."""
    return derived(partial(JOBS.made_from, rule))


def hemisphere(wildcards):
    """Parameter of a rule: the hemisphere of the case, or None for an entire brain."""
    return CASES[wildcards.case].hemi


def names_of(kind):
    """Parameter of a rule: names of the fields, volumes or inner surfaces of the case."""
    return lambda wildcards: list(getattr(CASES[wildcards.case], kind))


def stage_params(*stages):
    """Parameters of the job of some stages: what it is made from, and what the report of the last one records."""
    *_, last = stages
    return {
        "steps": derived(partial(JOBS.steps, stages)),
        "made_from": partial(JOBS.made_from, last),
        "version": versions(*(["measure.quality"] if last in LABELS else [])),
        **recorded(STAGES[last].label),
    }


def recorded(label):
    """Parameters of a rule that say in its report whose it is, what it was made from, and in whose space it is."""
    return {
        "origin": partial(JOBS.origin, label),
        "input_sha256": SOURCES.input_sha256,
        "space": derived(SOURCES.space),
        "roots": ROOTS,
    }


#: parameter of a rule whose report names its sources as BIDS does
ROOTS = derived(lambda _: (OUT, RAW))


def took(rule, wildcards):
    """Pattern of the benchmark of a job: its seconds and memory."""
    return LAYOUT.log(rule, wildcards, kind="tsv")


def asked(rule):
    """Memory and minutes that a job on a case asks for, and the seconds after which it ends itself."""
    return {
        "mem_mb": partial(JOBS.megabytes, rule),
        "runtime": partial(JOBS.minutes, rule),
        "time_limit": round(60 * (CONFIG.time_limit or 0)),
    }


def of_all(rule):
    """Inputs of a rule over all cases; a job that asks for them says so in ASKED."""

    def files(_):
        ASKED.add(rule)
        return list(RESULTS[rule].inputs())

    return {"files": files, "reported": existing(f"{OUT}/{REPORTED}")}


def facts_of(rule):
    """Facts that the files of a rule over all cases depend on, and the names of its inputs."""

    def facts(_):
        names = (Path(os.path.relpath(path, OUT)).as_posix() for path in RESULTS[rule].inputs())
        return [RESULTS[rule].facts(), *names]

    return facts


def in_report(rule):
    """The outputs of a rule over all cases; Snakemake's report shows those that have a caption."""

    def shown(path):
        caption = next((CAPTIONS[name] for name in CAPTIONS if fnmatch(Path(path).name, name)), None)
        return report(path, caption=f"../reports/{caption}.rst", category="Cohort") if caption else path

    return [shown(path) for path in RESULTS[rule].files]


def in_fold_report(name, caption, figure):
    """A picture of a fold, with its caption in Snakemake's report."""
    labels = {"case": "{case} {variant}", "figure": figure}
    return report(FOLDS.fold(name), caption=f"../reports/{caption}.rst", category="Folding", labels=labels)
