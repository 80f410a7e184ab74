"""Compare realisations of several cell sizes."""

from pathlib import Path

from convergence import write_convergence

write_convergence([Path(record).parent for record in snakemake.input], snakemake.output)
