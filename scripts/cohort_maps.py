"""Means over the cases of one hemisphere on the common mesh."""

from _job import start

job = start(snakemake)

from cortet.report.cohort_maps import write_maps

write_maps(list(zip(job.params.cases, job.input, strict=True)), *job.output)
