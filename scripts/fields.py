"""The per-vertex fields of a case on the vertices that the gate lets in."""

from _job import parameters, snakemake

from cortet.fields import with_fields
from cortet.formats import gifti
from cortet.stages.gate import gate

surface = with_fields(gifti.read_surface(snakemake.input.surface), snakemake.params.files)
surface, _ = gate(surface, **parameters())
gifti.write_surface(surface, snakemake.output.surface)
