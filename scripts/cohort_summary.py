"""One row per cell size and mesher, as Table 1 of the CORTET paper."""

from pathlib import Path

from _job import snakemake

from cortet.tables import write_summary

table, sidecar = map(Path, snakemake.output)
write_summary([Path(path) for path in snakemake.input], snakemake.params.cases, table=table, sidecar=sidecar)
