"""Every case with its stage, state, reason and log."""

from _job import start

job = start(snakemake)

from cortet.cohort.status import COLUMNS, status_rows
from cortet.report.table_files import Table, write

write(Table("What became of every case", COLUMNS), status_rows(job.params.meshes), *job.output)
