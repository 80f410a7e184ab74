"""Log, benchmark, environment, memory and minutes of every rule that has a script; and when it runs again.

What is there is used only if it was made with what is asked for now: its receipt says so (cortet.cohort.receipts). A job
runs again, too, if a file is gone that a record among its outputs lists (cortet.formats.ownership): the files of some
formats are several. One that was changed is left, and said.
Snakemake compares parameters with those it remembers, in the folder where it was started, and only with those.
"""

from functools import cache
from itertools import chain

from cortet.cohort.receipts import is_current, receipt_path
from cortet.cohort.resources import cost
from cortet.formats.ownership import changed_of, is_whole
from snakemake.iocontainers import InputFiles, OutputFiles
from snakemake.resources import Resources

#: rules that write files beside their outputs, and a record of all
EXPORTS = ("export", "ten_nodes")


@cache
def say_changed(path):
    """Warn, once, of a file that is not as its job wrote it."""
    logger.warning(f"{path} was changed after cortet wrote it: delete it, and it is made again")


def rerun_without_receipt(step):
    """An input function of a rule that names no file. It makes a job run again whose receipt is missing or says otherwise.

    Input functions are called for each job of a run before Snakemake decides which of them run; to those that must it
    adds here, as it does itself for files that a killed run left incomplete.
    """

    def no_files(wildcards):
        if workflow.is_main_process and not workflow.touch:
            log = Path(step.expand_log(wildcards)[0])
            parameters, _ = step.expand_params(wildcards, InputFiles(), OutputFiles(), None)
            outputs = step.expand_output(wildcards)[0]
            records = [Path(output) for output in outputs if step.name in EXPORTS and output.endswith(".json")]
            current = is_current(receipt_path(Path(OUT), log), dict(parameters.items()))
            if not current or not all(map(is_whole, records)):
                workflow.dag.forcefiles.update(outputs)
            else:
                for path in chain.from_iterable(map(changed_of, records)):
                    say_changed(path)
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
