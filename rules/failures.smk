"""What happens when a case fails.

A failed case makes its job fail: the log says why, the others go on (`keep-going`), the exit code is not zero. But a rule
over all cases cannot run when one of its inputs was not made. So when a run ends with failures, the rules over all cases
run once more over those that are done, with the failures as a parameter; the next run, which has other inputs and
parameters, makes them again. What an earlier run left of a failed case, or of the tables of an unfinished run, is deleted.
From its start to its end a run holds the lock of the output folder.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections import defaultdict

from cortet.cohort.bids import require_own_output
from cortet.cohort.lock import hold, is_held_by_parent
from cortet.cohort.saved_jobs import debug_command, saved_path
from cortet.cohort.status import failure_reason, was_killed

STARTED = time.time()
HELD = []  # files whose locks last until the end of this process


def failed_jobs():
    """Jobs that failed. A cluster's profile groups jobs; of a group it is those that say why, or the last that ran."""
    found = set()
    for job in workflow.scheduler.failed:
        members = list(job.jobs) if job.is_group() else [job]
        logs = {member: Path(member.log[0]) for member in members}
        written = [member for member in members if logs[member].exists() and logs[member].stat().st_mtime >= STARTED]
        says_why = [member for member in written if not was_killed(logs[member])]
        last = [max(written, key=lambda member: logs[member].stat().st_mtime)] if written else members
        found.update(says_why or last)
    return found


def failures_of_run():
    """What keeps a mesh from being done, as `FAILURES`, from the jobs that failed or never ran."""
    failed_in_run = failed_jobs()
    order = {rule.name: number for number, rule in enumerate(workflow.rules)}
    undone = defaultdict(list)
    for job in sorted(workflow.dag.needrun_jobs(), key=lambda job: order[job.rule.name]):
        undone[job.wildcards.get("case")].append(job)
    failures = {}
    for mesh in PLAN.each_case(LAYOUT.certificate):
        case, res, mesher = mesh
        jobs = [job for job in undone[case] if is_about(job, res=res, mesher=mesher, setting="")]
        failed = [job for job in jobs if job in failed_in_run]
        if failed:
            log = Path(failed[0].log[0])
            reason = failure_reason(log, since=STARTED)
            failures[mesh] = {
                "stage": failed[0].rule.name,
                "state": "failed",
                "reason": reason,
                "log": str(log),
            }
        elif jobs:
            failures[mesh] = {
                "stage": jobs[0].rule.name,
                "state": "unfinished",
                "reason": "the run ended before",
            }
    return failures


def is_about(job, **mesh):
    """Whether a job works for a mesh, as far as its wildcards tell: one on a surface works for all meshes in it."""
    return all(job.wildcards.get(key, str(value)) == str(value) for key, value in mesh.items())


def missing_of_run():
    """Files that were not made, as `MISSING`: the reason of the failed job that theirs waited for."""
    undone = [job for job in workflow.dag.needrun_jobs() if job.wildcards.get("case")]
    found = failed_jobs()
    failed = defaultdict(list)
    for job in undone:
        if job in found:
            failed[job.wildcards["case"]].append(job)
    missing = {}
    for job in undone:
        keys = [key for key in ("res", "mesher", "setting") if job.wildcards.get(key) is not None]
        mesh = {key: job.wildcards[key] for key in keys}
        causes = [other for other in failed[job.wildcards["case"]] if is_about(other, **mesh)]
        reasons = [f"{cause.rule.name}: {failure_reason(Path(cause.log[0]), since=STARTED)}" for cause in causes[:1]]
        missing |= dict.fromkeys(job.output, reasons[0] if reasons else "the run ended before")
        if causes:  # what an earlier run made of this case must not pass for this one's
            delete_outputs([job])
    return missing


def delete_outputs(jobs):
    for job in jobs:
        for path in job.output:
            Path(path).unlink(missing_ok=True)


def run_over_done_cases(failures, missing, targets):
    """Run the rules over all cases with the failed ones left out."""
    records = [{"mesh": mesh, "failure": failure} for mesh, failure in failures.items()]
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump({**config, "failures": records, "missing": missing}, file, default=str)
        file.flush()
        command = [sys.executable, "-m", "snakemake", "--cores", "1", "--nolock"]
        command += ["--snakefile", str(workflow.main_snakefile)]
        command += ["--configfile", file.name, "--no-hooks", "--quiet", "all"]
        command += ["--allowed-rules", *OVER_ALL_CASES, "case_page", "--", *targets]
        subprocess.run(command, check=False)


onstart:
    try:
        require_own_output(CONFIG.output, CONFIG.cohort.dataset)
        if not is_held_by_parent():
            HELD.append(hold(CONFIG.output))
    except CortetError as error:
        raise WorkflowError(str(error)) from None
    # a table of an earlier run must not pass for this one's, should this one be killed
    delete_outputs(job for job in workflow.dag.needrun_jobs() if job.rule.name in OVER_ALL_CASES)
    # Under a limit of jobs per second (100 by default) Snakemake starts a timer at every look at its queue, to look again
    # a second later: each job that ends adds one more such look per second, for good, and after some hundred jobs the
    # main process does little else. A limit that the user gives stays.
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit and (limit.max_jobs, limit.timespan) == (100, 1):
        workflow.scheduler.job_rate_limiter = None


onerror:
    failures, missing = failures_of_run(), missing_of_run()
    for (case, *_), failure in failures.items():
        logger.error(f"{case}: {failure['stage']}: {failure['reason']}")
        if (log := failure.get("log")) and saved_path(Path(log)).exists():
            runner = Path(workflow.basedir) / "scripts/_job.py"
            logger.error(f"{case}: to run it again in a debugger: {debug_command(Path(log), runner)}")
    measured = any(PLAN.is_measured(mesh, failures) for mesh in PLAN.each_case(LAYOUT.certificate))
    possible = OVER_ALL_CASES if measured else ["cohort_status", "cohort_page"]
    targets = [path for job in workflow.dag.jobs if job.rule.name in possible for path in job.output]
    pages = {
        page
        for mesh, page in PLAN.each_case(LAYOUT.case_page).items()
        if not PLAN.is_measured(mesh, failures) or failures.get(mesh, {}).get("stage") == "volumes"
    }
    targets += sorted(pages & {path for job in workflow.dag.jobs for path in job.output})
    if missing and targets:
        run_over_done_cases(failures, missing, targets)
