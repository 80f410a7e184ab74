"""The page of one mesh, and the small picture that leads to it."""

import gc
from pathlib import Path

from _job import start

job = start(snakemake)
gc.disable()  # to look for garbage among what VTK and Matplotlib load takes a tenth of this job, and finds little

from cortet.formats import gifti, vtu
from cortet.formats.atomic import atomic_path
from cortet.formats.certificates import OF_SOLVERS, OF_UNCERTIFIED
from cortet.formats.placement import placed
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.report.case_page import Checked, about, write_case_page
from cortet.report.pictures import thumbnail
from cortet.report.records import read_certificate

given, params = job.input, job.params
certificate = read_certificate(given.certificate)
exported = certificate["certified"] or params.exported["uncertified"]
label, what = (OF_SOLVERS, "the result") if certificate["certified"] else (OF_UNCERTIFIED, "not certified")
names = [(name.format(label=label), form) for name, form in params.exported["names"]]
mesh = vtu.read(given.mesh)
page = Checked(
    mesh,
    placed(gifti.read_surface(given.surface, finite=False), params.to_mm),
    gifti.read_nested(given.meshed, given.inner),
    certificate,
    files=[
        *((name, f"{name} ({what}, {form})") for name, form in names if exported),
        (Path(given.certificate).name, "certificate (JSON)"),
        (Path(given.mesh).name, "mesh of the last stage (VTU)"),
    ],
    tissues=read_tsv(Path(given.tissues[0])).to_dict("records") if given.tissues else [],
    slices=Path(given.tissues[1]) if given.tissues else None,
)
write_case_page(page, job.output.page, facts=about(params.about), cohort=params.cohort)
with atomic_path(job.output.thumbnail) as small:
    small.write_bytes(thumbnail(boundary_surface(mesh)[0], params.about["hemi"]))
