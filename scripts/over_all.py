"""One table, figure or page over all cases."""

from _job import start

job = start(snakemake)

from cortet.cohort.failures import with_failures
from cortet.report.over_all import OverAll, plan_of

OverAll(with_failures(plan_of(snakemake.config), ended=False))[snakemake.rule].write()
