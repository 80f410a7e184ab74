"""What BIDS wants to know of a folder of derivatives."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.cohort.bids import Places, write_dataset_description, write_descriptions

description = Path(job.output.description)
places = Places(description.parent, Path(job.params.raw))
write_dataset_description(description, Path(job.output.ignore), places, map(Path, job.params.files))
write_descriptions(job.params.meanings, Path(job.output.descriptions))
