"""One row per mesh and measured stage."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.records import write_stages
from cortet.report.table_files import write_view

table, sidecar, view = map(Path, job.output)
write_stages(job.input, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Every mesh, stage by stage")
