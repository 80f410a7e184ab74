"""Tables, figures or pages over all cases."""

from _job import start

job = start(snakemake)

from cortet.cohort.failures import with_failures
from cortet.over_all import plan_of, results

results(with_failures(plan_of(snakemake.config), ended=False))[snakemake.rule].write()
