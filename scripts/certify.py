"""Verdict on one mesh, with every number beside its limit."""

import json
from dataclasses import asdict
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.measure.certify import certify

stages = [step for step in job.params.line if step != "certify"]
reports = [json.loads(Path(path).read_text(encoding="utf-8")) for path in job.input.reports]
certificate = certify(
    vtu.read(job.input.mesh),
    gifti.read_nested(job.input.surface, job.input.inner),
    **job.arguments,
    case=job.wildcards.case,
    source=job.input.source,
    parameters=job.params.line,
    # the certificate says itself whose it is
    reports={
        stage: {key: value for key, value in report.items() if key != "origin"}
        for stage, report in zip(stages, reports, strict=True)
    },
)
write_json(asdict(certificate), job.output.certificate)
