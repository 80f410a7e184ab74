"""Let one surface in, or refuse it."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.errors import InputError
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages.gate import gate

if not snakemake.input:
    raise InputError("no such file", file=parameters()["source"], remedy="mend the column surface of the cohort sheet")
surface, report = gate(gifti.read_surface(snakemake.input.surface), **parameters())
gifti.write_surface(surface, snakemake.output.surface)
write_json(asdict(report), snakemake.output.report)
