"""One table, figure or page over all cases."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.cohort.failures import with_failures
from cortet.report.over_all import OverAll, plan_of_run

plan, _ = plan_of_run(Path(job.input.receipt).parents[2])
OverAll(with_failures(plan, ended=False))[snakemake.rule].write()
