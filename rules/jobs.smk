"""Log, benchmark, environment, memory and minutes of every rule that has a script; and when it runs again.

What is there is used only if it was made with what is asked for now: its receipt says so (cortet.cohort.receipts).
Snakemake compares parameters with those it remembers, in the folder where it was started, and only with those.
"""

from cortet.cohort.receipts import is_current, receipt_path
from cortet.cohort.resources import cost
from snakemake.iocontainers import InputFiles, OutputFiles
from snakemake.resources import Resources


def rerun_without_receipt(step):
    """An input function of a rule that names no file. It makes a job run again whose receipt is missing or says otherwise.

    Input functions are called for each job of a run before Snakemake decides which of them run; to those that must it
    adds here, as it does itself for files that a killed run left incomplete.
    """

    def no_files(wildcards):
        if workflow.is_main_process and not workflow.touch:
            log = Path(step.expand_log(wildcards)[0])
            parameters, _ = step.expand_params(wildcards, InputFiles(), OutputFiles(), None)
            if not is_current(receipt_path(Path(OUT), log), dict(parameters.items())):
                workflow.dag.forcefiles.update(step.expand_output(wildcards)[0])
        return []

    return no_files


for step in workflow.rules:
    if not step.norun:
        wildcards = sorted(step.wildcard_names)
        step.log_modifier = step.benchmark_modifier = step.output_modifier
        step.set_log(LAYOUT.log(step.name, wildcards))
        step.benchmark = LAYOUT.log(step.name, wildcards, kind="tsv")
        step.conda_env = "../envs/cortet.yaml"
        step.set_input(receipt=rerun_without_receipt(step))
        if "case" in wildcards and "mem_mb" not in step.resources:
            cost(step.name)  # an error here and now for a rule that nobody has measured
            asked = {"mem_mb": partial(PLAN.megabytes, step.name), "runtime": partial(PLAN.minutes, step.name)}
            step.resources.update(Resources.from_mapping(asked))
