"""One row per cell size and mesher, as Table 1 of the CORTET paper."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.cohort_tables import write_summary
from cortet.report.table_files import write_view

table, sidecar, view = map(Path, job.output)
write_summary([Path(path) for path in job.input], job.params.cases, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Element quality per cell size and mesher")
