"""Verdict on one mesh, with every number beside its limit."""

import json
from dataclasses import asdict
from pathlib import Path

from _job import parameters, snakemake

from cortet.certify import certify
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json

line = snakemake.params.line
certificate = certify(
    vtu.read(snakemake.input.mesh),
    gifti.read_surface(snakemake.input.surface),
    **parameters(),
    case=snakemake.wildcards.case,
    source=snakemake.input.source,
    parameters=line,
    reports={
        stage: json.loads(Path(path).read_text()) for stage, path in zip(line, snakemake.input.reports, strict=True)
    },
)
write_json(asdict(certificate), snakemake.output.certificate)
