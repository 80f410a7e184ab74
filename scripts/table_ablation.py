"""Table 1 of the paper: what each stage does to the quality."""

from _job import start

job = start(snakemake)

from cortet.study.ablation import write_ablation

write_ablation(
    [*job.input.records, *job.input.baselines],
    job.input.reports,
    job.params.missing,
    job.input.references,
    job.output,
)
