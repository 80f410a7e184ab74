"""Tables, figures or pages over all cases."""

from _job import start

job = start(snakemake)

from cortet.cohort.states import read_states
from cortet.over_all import plan_of, results

results(read_states(plan_of(snakemake.config), ended=False))[snakemake.rule].write()
