"""One row per mesh and measured stage."""

from pathlib import Path

from _job import snakemake

from cortet.experiments import write_stages
from cortet.printed import write_view

table, sidecar, view = map(Path, snakemake.output)
write_stages(map(Path, snakemake.input), table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Every mesh, stage by stage")
