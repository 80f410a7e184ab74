"""One row per mesh: quality, fidelity, topology, verdict."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.cohort_tables import write_quality
from cortet.report.table_files import write_view

table, sidecar, view = map(Path, job.output)
write_quality([Path(path) for path in job.input], job.params.cases, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Quality, fidelity and topology of every mesh")
