"""Tables and figures over all cases, and what happens to them when a case fails.

A failed case makes its job fail: the log says why, the others go on (`keep-going`), the exit code is not zero. But a rule
over all cases cannot run when one of its inputs was not made. So when a run ends with failures, the rules of this file run
once more over the cases that are done, with the failures as a parameter; the next run, which has other inputs and parameters,
makes them again. What an earlier run left of a failed case, or of the tables of an unfinished run, is deleted.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import cortet
from cortet.status import failure_reason

STARTED = time.time()
FAILURES = {
    (record["case"], record["res"], record["mesher"]): record["failure"]
    for record in json.loads(
        Path(os.environ["CORTET_FAILURES"]).read_text()
        if "CORTET_FAILURES" in os.environ
        else "[]"
    )
}
OVER_ALL_CASES = ("cohort_quality", "cohort_summary", "cohort_figure", "cohort_status")
COHORT_QUALITY = f"{OUT}/cohort/cohort_quality"
COHORT_FIGURE = f"{OUT}/cohort/figure-cohort"
COHORT_STATUS = f"{OUT}/cohort/cohort_status"


localrules:
    dataset_description,
    cohort_quality,
    cohort_summary,
    cohort_figure,
    cohort_status,


def done(pattern, *, even_uncertified):
    """Files of a pattern for all meshes that did not fail; a mesh that only its export refused is measured all the same."""
    return [
        path
        for mesh, path in each_case(pattern).items()
        if mesh not in FAILURES
        or (even_uncertified and FAILURES[mesh]["stage"] == "export")
    ]


def status_of_all():
    """Parameter of the status table: excluded rows, failures, and where the certificates of the others are."""
    excluded = [
        {"case": case.name, "state": "excluded", "reason": case.exclude_reason}
        for case in SHEET
        if not case.include
    ]
    meshes = []
    for mesh, certificate in each_case(CERTIFICATE).items():
        name, res, mesher = mesh
        failure = FAILURES.get(mesh, {})
        outcome = (
            {"certificate": certificate}
            if failure.get("stage", "export") == "export"
            else failure
        )
        meshes.append(
            {"case": name, "cell_size_mm": res / 1000, "mesher": mesher, **outcome}
        )
    return meshes + excluded


def concerns(job, mesh):
    """Whether a job makes something of a mesh, given as (case, res, mesher)."""
    keys = ("case", "res", "mesher")
    own = {
        key: str(value) for key, value in zip(keys, mesh) if key in job.wildcards.keys()
    }
    return "case" in own and all(
        job.wildcards[key] == value for key, value in own.items()
    )


def failures_of_run():
    """What keeps a mesh from being done, as `FAILURES`, from the jobs that failed or never ran."""
    order = [rule.name for rule in workflow.rules]
    undone = sorted(
        workflow.dag.needrun_jobs(), key=lambda job: order.index(job.rule.name)
    )
    failures = {}
    for mesh in each_case(CERTIFICATE):
        jobs = [job for job in undone if concerns(job, mesh)]
        failed = [job for job in jobs if job in workflow.scheduler.failed]
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


def delete_outputs(jobs):
    for job in jobs:
        for path in job.output:
            Path(path).unlink(missing_ok=True)


def run_over_done_cases(failures, targets):
    """Run the rules of this file over the cases that are done."""
    records = [
        {"case": case, "res": res, "mesher": mesher, "failure": failure}
        for (case, res, mesher), failure in failures.items()
    ]
    with tempfile.TemporaryDirectory() as folder:
        settings, known = Path(folder, "config.json"), Path(folder, "failures.json")
        settings.write_text(json.dumps(config, default=str))
        known.write_text(json.dumps(records))
        command = [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            str(workflow.main_snakefile),
            "--cores",
            "1",
        ]
        command += [
            "--configfile",
            str(settings),
            "--nolock",
            "--no-hooks",
            "--quiet",
            "all",
        ]
        command += ["--allowed-rules", *OVER_ALL_CASES, "--", *targets]
        subprocess.run(
            command, env={**os.environ, "CORTET_FAILURES": str(known)}, check=False
        )


onstart:
    # a table of an earlier run must not pass for this one's, should this one be killed
    delete_outputs(
        job
        for job in workflow.dag.needrun_jobs()
        if job.rule.name in OVER_ALL_CASES
    )


onerror:
    failures = failures_of_run()
    lost = [
        mesh for mesh, failure in failures.items() if failure["state"] == "failed"
    ]
    delete_outputs(
        job
        for job in workflow.dag.needrun_jobs()
        if any(concerns(job, mesh) for mesh in lost)
    )
    targets = [
        path
        for job in workflow.dag.jobs
        if job.rule.name in OVER_ALL_CASES
        for path in job.output
    ]
    if failures and targets:
        run_over_done_cases(failures, targets)


rule dataset_description:
    """What BIDS wants to know of a folder of derivatives."""
    output:
        description=f"{OUT}/dataset_description.json",
        ignore=f"{OUT}/.bidsignore",
    log:
        "logs/dataset_description.log",
    benchmark:
        "benchmarks/dataset_description.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        version=cortet.__version__,
    script:
        "../scripts/dataset_description.py"


rule cohort_quality:
    """One row per mesh: quality, fidelity, topology, verdict; a JSON file explains the columns."""
    input:
        done(CERTIFICATE, even_uncertified=True),
    output:
        table=report(
            f"{OUT}/cohort/cohort_quality.tsv",
            caption="../reports/cohort_quality.rst",
            category="Cohort",
            labels={"table": "quality"},
        ),
        sidecar=f"{OUT}/cohort/cohort_quality.json",
    log:
        "logs/cohort_quality.log",
    benchmark:
        "benchmarks/cohort_quality.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        cases=list(CASES.values()),
        version=stage_version("tables"),
    script:
        "../scripts/cohort_quality.py"


rule cohort_summary:
    """One row per cell size and mesher, as Table 1 of the CORTET paper."""
    input:
        done(CERTIFICATE, even_uncertified=True),
    output:
        table=report(
            f"{OUT}/cohort/cohort_summary.tsv",
            caption="../reports/cohort_summary.rst",
            category="Cohort",
            labels={"table": "summary"},
        ),
        sidecar=f"{OUT}/cohort/cohort_summary.json",
    log:
        "logs/cohort_summary.log",
    benchmark:
        "benchmarks/cohort_summary.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        cases=list(CASES.values()),
        version=stage_version("tables"),
    script:
        "../scripts/cohort_summary.py"


rule cohort_figure:
    """Element count, mean and worst q against gestational age."""
    input:
        table=rules.cohort_quality.output.table,
    output:
        report(
            f"{COHORT_FIGURE}.svg",
            caption="../reports/cohort_figure.rst",
            category="Cohort",
            labels={"figure": "quality"},
        ),
        multiext(COHORT_FIGURE, ".pdf", ".png"),
    log:
        "logs/cohort_figure.log",
    benchmark:
        "benchmarks/cohort_figure.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        stage=CONFIG.stage("figures"),
    script:
        "../scripts/cohort_figure.py"


rule cohort_status:
    """Every case with its stage, state, reason and log."""
    input:
        certificates=done(CERTIFICATE, even_uncertified=True),
        solver_files=[
            path
            for pattern in SOLVER_FILES
            for path in done(pattern, even_uncertified=False)
        ],
    output:
        table=report(
            f"{COHORT_STATUS}.tsv",
            caption="../reports/cohort_status.rst",
            category="Cohort",
            labels={"table": "status"},
        ),
        sidecar=f"{COHORT_STATUS}.json",
    log:
        "logs/cohort_status.log",
    benchmark:
        "benchmarks/cohort_status.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        meshes=status_of_all(),
    script:
        "../scripts/cohort_status.py"


COHORT_FILES = [
    *rules.cohort_quality.output,
    *rules.cohort_summary.output,
    *rules.cohort_figure.output,
    *rules.cohort_status.output,
]
