"""Element quality of one mesh."""

from dataclasses import asdict

from _job import snakemake

from cortet.formats import vtu
from cortet.formats.atomic import write_json
from cortet.quality import summarise

write_json(asdict(summarise(vtu.read(snakemake.input.mesh))), snakemake.output.record)
