"""Bring the folds of a cohort onto one mesh, and fit a model at each of its vertices."""

from pathlib import Path

from population import write_study

from cortet.cohort.sheet import read_sheet

options = dict(snakemake.params)
sheet, folds = options.pop("sheet"), Path(options.pop("folds"))
write_study(read_sheet(Path(sheet)), folds, Path(snakemake.output[0]), **options)
