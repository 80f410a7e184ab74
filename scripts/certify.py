"""Verdict on one mesh, with every number beside its limit."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from _job import start

job = start(snakemake)

from cortet.cohort.bids import ABOUT
from cortet.cohort.user_files import require_same_input
from cortet.config.sections import Certify
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.measure.certify import certify


def report_of(path: str) -> dict[str, Any]:
    """A report of a stage that worked from the same input; the certificate says itself whose it is."""
    report = json.loads(Path(path).read_text(encoding="utf-8"))
    require_same_input(path, report, job.params.input_sha256)
    return {key: value for key, value in report.items() if key not in ABOUT}


stages = [step for step in job.params.line if step != "certify"]
reports = dict(zip(stages, map(report_of, job.input.reports), strict=True))
for stage, files in {"repair": job.input.inner_repairs, "resample": job.input.inner_resamplings}.items():
    if files:
        reports[stage]["inner"] = dict(zip(job.params.inner, map(report_of, files), strict=True))
certificate = certify(
    vtu.read(job.input.mesh),
    gifti.read_nested(job.input.surface, job.input.inner),
    Certify(**job.params.limits),
    cell_size=int(job.wildcards.res) / 1000,
    native=placed(gifti.read_surface(job.input.source, finite=False), job.params.to_mm),
    case=job.wildcards.case,
    source=job.input.source,
    parameters=job.params.line,
    reports=reports,
    layers=job.params.layers,
)
write_json(asdict(certificate), job.output.certificate)
