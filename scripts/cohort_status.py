"""Every case with its stage, state, reason and log."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.cohort.status import write_status
from cortet.report.table_files import write_view

table, sidecar, view = map(Path, job.output)
write_status(job.params.meshes, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="What became of every case")
