"""A paragraph for the methods section of a paper."""

from _job import snakemake

from cortet.methods import write_methods

write_methods(snakemake.input, snakemake.params.sheet, snakemake.params.failures, *snakemake.output)
