"""Compare folds by week with real fetuses."""

from pathlib import Path

from late import write_late

write_late([*map(Path, snakemake.input)], snakemake.output)
