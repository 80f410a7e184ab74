"""One row per mesh: quality, fidelity, topology, verdict."""

from pathlib import Path

from _job import snakemake

from cortet.tables import write_quality

table, sidecar = map(Path, snakemake.output)
write_quality([Path(path) for path in snakemake.input], snakemake.params.cases, table=table, sidecar=sidecar)
