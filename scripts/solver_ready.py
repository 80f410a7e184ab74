"""S5, the last stage: the mesh as solvers want it, and the verdict on it, with every number beside its limit."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from _job import start

job = start(snakemake)

from cortet.cohort.bids import ABOUT
from cortet.config.sections import Certify
from cortet.errors import StageError
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.formats.certificates import sealed
from cortet.formats.placement import placed
from cortet.measure.certify import certify, with_contacts
from cortet.measure.electrodes import with_electrodes

reports: dict[str, Any] = {}
for path, (stage, rule, inner, made_from) in zip(job.input.reports, job.params.of_reports, strict=True):
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if content.get("made_from") != made_from:
        what = "was made from other surfaces or settings, or by another version of cortet, than this run"
        raise StageError(what, file=path, remedy=f"run again with `--forcerun {rule}`")
    report = {key: value for key, value in content.items() if key not in ABOUT}
    if inner:
        reports[stage].setdefault("inner", {})[inner] = report
    else:
        reports[stage] = report
state, made = job.through(job.state())
inner, layers = state.surface.inner, job.params.layers
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
    reports=reports | made,
    layers=layers,
)
certificate = with_contacts(certificate, mesh, contacts)
vtu.write(mesh, job.output.mesh)
write_json(job.record(made["solver_ready"]), job.output.report)
write_json(job.record(asdict(certificate.quality)), job.output.quality)
of_run = {"made_from": job.params.made_from, "input_sha256": job.params.input_sha256}
write_json(sealed(asdict(certificate) | of_run), job.output.certificate)
