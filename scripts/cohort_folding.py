"""Table and figure of all folds of the cohort."""

from _job import start

job = start(snakemake)

from cortet.report.cohort_folding import write_cohort_folding

write_cohort_folding(job.params.runs, job.params.failed, job.output)
