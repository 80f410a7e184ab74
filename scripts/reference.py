"""Element quality of one reference mesh."""

from dataclasses import asdict

from _job import snakemake

from cortet.formats import braingrowth
from cortet.formats.atomic import write_json
from cortet.quality import summarise

write_json(asdict(summarise(braingrowth.read(snakemake.input.mesh))), snakemake.output.record)
