"""Element count, mean and worst q against gestational age."""

from pathlib import Path

from _job import snakemake

from cortet.figures import cohort_figure, save

save(cohort_figure(Path(snakemake.input.table), limit=snakemake.params.limit), *snakemake.output)
