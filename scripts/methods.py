"""A paragraph for the methods section of a paper."""

from _job import start

job = start(snakemake)

from cortet.report.methods import write_methods

write_methods(job.input, job.params.sheet, job.params.failures, *job.output)
