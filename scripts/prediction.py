"""Table and figure of the experiment on prediction."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.study.prediction_tables import write_prediction

write_prediction([*map(Path, job.input.records)], [*map(Path, job.input.spreads)], job.output)
