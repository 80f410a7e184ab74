"""How a run begins and ends. From its start to its end it holds the lock of the output folder.

A failed case makes its job fail: the log says why, the others go on (`keep-going`), and the exit code is not zero. But a
rule over all cases cannot run when one of its inputs was not made. So a run ends with `cortet cohort report`, which makes
tables, figures and pages of what is there.
"""

import subprocess
import sys

from cortet.cohort.app import outcome, workflow as of_workflow
from cortet.cohort.lock import hold, is_held_by_parent
from cortet.cohort.outdated import set_aside
from cortet.cohort.states import States, read_states
from cortet.over_all import is_of_run, remember_run

HELD = []  # files whose locks last until the end of this process
HAD_RESULTS = Path(f"{OUT}/cohort").is_dir()  # which may be older than what this run makes


onstart:
    try:
        if not is_held_by_parent(CONFIG.output):
            HELD.append(hold(CONFIG.output))
    except CortetError as error:
        raise WorkflowError(str(error)) from None
    dropped = is_of_run(config, CONFIG.output)
    for moved in [] if workflow.touch else set_aside(States(PLANNED), dropped=dropped):
        logger.warning(moved)
    remember_run(PLANNED, config, ASKED)
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit and (limit.max_jobs, limit.timespan) == (100, 1):  # nobody has asked for another one
        # with it, each finished job makes Snakemake 9 look at its queue once more per second until the run ends
        workflow.scheduler.job_rate_limiter = None


def end_run(after):
    """Make what is over all cases, and say what became of them, unless `cortet run` started this and will say it."""
    if not workflow.touch and (HAD_RESULTS or after == "failure"):
        # in a process of its own, which has seconds to work in
        path = os.pathsep.join(filter(None, [str(of_workflow()), os.environ.get("PYTHONPATH")]))
        command = [sys.executable, "-m", "cortet.cli", "cohort", "report", "--after", after, OUT]
        subprocess.run(command, check=False, env=os.environ | {"PYTHONPATH": path}, stdout=subprocess.DEVNULL)
    if HELD:
        logger.warning(outcome(read_states(PLANNED), Path(OUT), page="cohort_page" in ASKED))


onsuccess:
    end_run("success")


onerror:
    for (case, *_), state in read_states(PLANNED).of.items():
        if state.state == "failed":
            logger.error(f"{case}: {state.stage}: {state.in_words}")
    end_run("failure")
