"""Element count, mean and worst q against gestational age."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.figures import cohort_figure, save

save(cohort_figure(Path(job.input.table), limit=job.params.limit), *job.output)
