"""The sheet and the configuration of a run, as the rules see them: a plan and the names of all files."""

import os
import re
from functools import partial
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from cortet import __version__
from cortet.cohort.app import require_plain_python
from cortet.cohort.bids import Places, descriptions
from cortet.cohort.layout import EXPORTED, LABELS, SHARED, WILDCARDS, Layout, beside, file_of
from cortet.cohort.plan import OVER_ALL_CASES, Plan, existing
from cortet.cohort.receipts import content
from cortet.cohort.selection import ageless_notice
from cortet.cohort.sheet import read_sheet
from cortet.config import keys_not_given, load, read, version_of
from cortet.errors import CortetError
from cortet.meshers import OWN
from cortet.stages import STAGES

# what rules/failures.smk hands over: (case, res, mesher) of the meshes that failed, and how; reasons why files that the
# experiments measure are missing
FAILURES = {tuple(record["mesh"]): record["failure"] for record in config.pop("failures", [])}
MISSING = config.pop("missing", {})

try:
    require_plain_python()
    if workflow.is_main_process:
        for file in workflow.configfiles:  # Snakemake takes the last of two values of a key in silence
            read(Path(file))
    CONFIG = load(config)
    # by the name that files carry: the line's own setting carries none, others are run beside it
    SETTINGS = {"": CONFIG} | {
        name.capitalize(): load({**config, "setting": name})
        for name in CONFIG.experiments.settings
        if name != CONFIG.setting
    }
    for setting in SETTINGS.values():
        setting.require_programs()
    # read here and never an input of a rule: a new row then runs one new case
    SHEET = read_sheet(CONFIG.cohort.sheet, CONFIG.cohort.fields)
    PLAN = Plan(SETTINGS, SHEET, FAILURES, MISSING)
    CASES, RESOLUTIONS, FOLDED = PLAN.cases, PLAN.resolutions, PLAN.folded
    CONFIG.require_workflow()
    CONFIG.require_nesting(any(case.inner for case in CASES.values()))
except CortetError as error:
    raise WorkflowError(str(error)) from None
DEFAULTS = keys_not_given(config, GIVEN) if "sheet" in GIVEN.get("cohort", {}) else []
if DEFAULTS:
    logger.warning(
        f"from config.yaml in {Path.cwd()}, since your own configuration does not say: {'; '.join(DEFAULTS)}"
    )
for notice in [*CONFIG.notices(), *PLAN.notices(), *ageless_notice(list(CASES.values()))]:
    logger.warning(notice)

# scripts/_job.py keeps to it; no parameter of a rule, since another limit makes no other result
os.environ.update(CORTET_TIME_LIMIT=str(CONFIG.time_limit or 0))

LAYOUT = PLAN.layout
OUT = LAYOUT.output
# what BIDS URIs begin with; no parameter either, it changes no result
RAW = str(CONFIG.cohort.dataset or CONFIG.cohort.sheet.parent)
os.environ.update(CORTET_OUTPUT=OUT, CORTET_RAW=RAW)


wildcard_constraints:
    **WILDCARDS,
    variant=f"({'|'.join(name.capitalize() for name in CONFIG.fold.variants)})?",
    changed=f"({'|'.join(name.capitalize() for name in CONFIG.experiments.prediction.variants)})?",
    setting="|".join(["", *SETTINGS]),  # an empty expression alone would be none
    suffix="|".join(map(re.escape, EXPORTED)),


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
