"""S5, the last stage: the mesh as solvers want it, and the verdict on it, with every number beside its limit."""

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
from cortet.measure.certify import certify, with_contacts
from cortet.measure.electrodes import with_electrodes
from cortet.stages import STAGES


def report_of(path: str) -> dict[str, Any]:
    """A report of a stage that worked from the same input; the certificate says itself whose it is."""
    report = json.loads(Path(path).read_text(encoding="utf-8"))
    require_same_input(path, report, job.params.input_sha256)
    return {key: value for key, value in report.items() if key not in ABOUT}


*before, last = (stage for stage in job.params.line if stage != "certify")
reports = dict(zip(before, map(report_of, job.input.reports), strict=True))
of_inner = map(report_of, job.input.inner_reports)
for stage in before if job.params.inner else ():
    if STAGES[stage].each_surface:
        reports[stage]["inner"] = {name: next(of_inner) for name in job.params.inner}
state, made = job.through(job.state())
report, inner, layers = made[last], state.surface.inner, job.params.layers
mesh, contacts = with_electrodes(state.mesh, job.contacts(state.surface), inner, layers)
if reports.get("repair", {}).get("repaired"):  # the file lacks what repair made
    native = gifti.read_surface(job.input.gated)
else:
    native = placed(gifti.read_surface(job.input.source, finite=False), job.params.to_mm)
certificate = certify(
    mesh,
    state.surface,
    Certify(**job.params.limits),
    cell_size=int(job.wildcards.res) / 1000,
    native=native,
    case=job.wildcards.case,
    source=job.input.source,
    parameters=job.params.line,
    reports={**reports, last: report},
    layers=layers,
)
certificate = with_contacts(certificate, mesh, contacts)
vtu.write(mesh, job.output.mesh)
write_json(job.record(report), job.output.report)
write_json(job.record(asdict(certificate.quality)), job.output.quality)
write_json(asdict(certificate), job.output.certificate)
