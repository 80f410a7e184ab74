"""The page of one mesh; of one that failed, what failed and why."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.errors import CortetError
from cortet.formats import gifti, vtu
from cortet.formats.placement import placed
from cortet.formats.tsv import read_tsv
from cortet.report.case_page import about, write_case_page, write_failure_page

given, params, page = job.input, job.params, Path(job.output.page)
shown = {"facts": about(params.about), "cohort": params.cohort}
if params.failure is None:
    certificate = json.loads(Path(given.certificate).read_text(encoding="utf-8"))
    exported = certificate["certified"] or params.exported["uncertified"]
    write_case_page(
        vtu.read(given.mesh),
        placed(gifti.read_surface(given.surface, finite=False), params.to_mm),
        certificate,
        page,
        tissues=read_tsv(Path(given.tissues[0])).to_dict("records") if given.get("tissues") else [],
        slices=Path(given.tissues[1]) if given.get("tissues") else None,
        meshed=gifti.read_nested(given.meshed, given.get("inner", [])),
        files=[
            (Path(given.certificate).name, "certificate (JSON)"),
            (Path(given.mesh).name, "mesh (VTU, for ParaView)"),
            *((name, f"for solvers: {form}") for name, form in params.exported["files"] if exported),
        ],
        **shown,
    )
else:
    surface, trouble = None, "There is no such file."
    if given.surface:
        try:
            surface = gifti.read_surface(given.surface, finite=False)
        except CortetError as error:
            trouble = f"It cannot be drawn: {error}"
    write_failure_page(job.wildcards.case, params.failure, page, surface=surface, trouble=trouble, **shown)
