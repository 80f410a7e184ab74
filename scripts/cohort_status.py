"""Every case with its stage, state, reason and log."""

from pathlib import Path

from _job import snakemake

from cortet.status import write_status

table, sidecar = map(Path, snakemake.output)
write_status(snakemake.params.meshes, table=table, sidecar=sidecar)
