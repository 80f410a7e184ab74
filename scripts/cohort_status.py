"""Every case with its stage, state, reason and log."""

from pathlib import Path

from _job import snakemake

from cortet.status import write_status

write_status(snakemake.params.meshes, Path(snakemake.output.table), Path(snakemake.output.sidecar))
