"""What BIDS wants to know of a folder of derivatives."""

from pathlib import Path

from _job import snakemake

from cortet.bids import write_dataset_description

write_dataset_description(Path(snakemake.output.description), Path(snakemake.output.ignore))
