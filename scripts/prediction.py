"""Table and figure of the experiment on prediction."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.study.prediction_tables import write_prediction

write_prediction([Path(path) for path in job.input.records], job.output)
