"""What BIDS wants to know of a folder of derivatives."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.cohort.bids import write_dataset_description, write_descriptions, write_readme

write_dataset_description(Path(job.output.description), Path(job.output.ignore), job.params.links)
write_descriptions(job.params.meanings, Path(job.output.descriptions))
write_readme(Path(job.output.description).with_name("README.md"))
