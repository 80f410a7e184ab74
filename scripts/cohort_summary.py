"""One row per cell size and mesher, as Table 1 of the CORTET paper."""

from pathlib import Path

from _job import snakemake

from cortet.printed import write_view
from cortet.tables import write_summary

table, sidecar, view = map(Path, snakemake.output)
write_summary([Path(path) for path in snakemake.input], snakemake.params.cases, table=table, sidecar=sidecar)
write_view(table, sidecar, view, title="Element quality per cell size and mesher")
