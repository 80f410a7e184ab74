"""Compare the kinds of prediction."""

from pathlib import Path

from prediction_tables import write_prediction

write_prediction([*map(Path, snakemake.input)], snakemake.output)
