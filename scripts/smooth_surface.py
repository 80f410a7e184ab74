"""Smooth one surface by its age."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages.smooth_surface import smooth_surface

surface, report = smooth_surface(gifti.read_surface(snakemake.input.surface), **parameters())
gifti.write_surface(surface, snakemake.output.surface)
write_json(asdict(report), snakemake.output.report)
