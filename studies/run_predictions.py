"""Compare the kinds of prediction."""

from pathlib import Path

from prediction_tables import write_prediction

write_prediction([*map(Path, snakemake.input.records)], [*map(Path, snakemake.input.spreads)], snakemake.output)
