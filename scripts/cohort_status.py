"""Every case with its stage, state, reason and log."""

from pathlib import Path

from _job import snakemake

from cortet.printed import write_view
from cortet.status import write_status

table, sidecar, view = map(Path, snakemake.output)
write_status(snakemake.params.meshes, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="What became of every case")
