"""One row per mesh: quality, fidelity, topology, verdict."""

from pathlib import Path

from _job import snakemake

from cortet.printed import write_view
from cortet.tables import write_quality

table, sidecar, view = map(Path, snakemake.output)
write_quality([Path(path) for path in snakemake.input], snakemake.params.cases, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Quality, fidelity and topology of every mesh")
