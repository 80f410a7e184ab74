"""One row per mesh: quality, fidelity, topology, verdict."""

from _job import start

job = start(snakemake)

from cortet.report.cohort_tables import write_quality

write_quality(job.input, job.params.cases, job.output)
