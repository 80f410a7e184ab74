"""One row per mesh and measured stage."""

from _job import start

job = start(snakemake)

from cortet.report.records import write_stages

write_stages(job.input, job.output)
