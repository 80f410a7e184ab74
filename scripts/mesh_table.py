"""One of the tables with one row per mesh."""

from _job import snakemake

from cortet.mesh_tables import write_mesh_table

write_mesh_table(
    snakemake.params.table,
    snakemake.input.records,
    snakemake.params.missing,
    snakemake.output,
    setting=snakemake.params.setting,
    ages=snakemake.params.ages,
)
