"""One row per cell size and mesher, as Table 1 of the CORTET paper."""

from _job import start

job = start(snakemake)

from cortet.report.cohort_tables import write_summary

write_summary(job.input, job.params.cases, job.output)
