"""Table 1 of the paper: what each stage does to the quality."""

from _job import snakemake

from cortet.experiments import write_ablation

write_ablation(
    [*snakemake.input.records, *snakemake.input.baselines],
    snakemake.input.made,
    snakemake.params.missing,
    snakemake.input.references,
    snakemake.output,
    setting=snakemake.params.setting,
)
