"""The page of one mesh, of one that failed what failed and why; and the small picture that leads to it."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.errors import CortetError
from cortet.formats import gifti, vtu
from cortet.formats.atomic import atomic_path
from cortet.formats.placement import placed
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.meshes import TriSurface
from cortet.report.case_page import about, write_case_page, write_failure_page
from cortet.report.pictures import thumbnail

given, params, page = job.input, job.params, Path(job.output.page)
drawn: TriSurface | None
shown = {"facts": about(params.about), "cohort": params.cohort}
if params.failure is None:
    certificate = json.loads(Path(given.certificate).read_text(encoding="utf-8"))
    exported = certificate["certified"] or params.exported["uncertified"]
    mesh = vtu.read(given.mesh)
    drawn = boundary_surface(mesh)[0]
    write_case_page(
        mesh,
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
    drawn = surface
    write_failure_page(job.wildcards.case, params.failure, page, surface=surface, trouble=trouble, **shown)
with atomic_path(job.output.thumbnail) as small:
    small.write_bytes(thumbnail(drawn, params.about["hemi"]))
