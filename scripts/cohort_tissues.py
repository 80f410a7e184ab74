"""One row per mesh and label of its volumes."""

from _job import start

job = start(snakemake)

from cortet.report.cohort_tissues import write_tissues

write_tissues(job.input, job.params.meshes, job.output)
