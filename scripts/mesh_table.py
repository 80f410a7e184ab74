"""One of the tables with one row per mesh."""

from _job import start

job = start(snakemake)

from cortet.study.mesh_tables import write_mesh_table

write_mesh_table(job.params.table, job.input.records, job.params.missing, job.output, ages=job.params.ages)
