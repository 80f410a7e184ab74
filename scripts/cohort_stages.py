"""One row per mesh and measured stage."""

from pathlib import Path

from _job import snakemake

from cortet.experiments import write_stages

table, sidecar = map(Path, snakemake.output)
write_stages(map(Path, snakemake.input), table=table, sidecar=sidecar)
