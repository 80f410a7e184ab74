"""All cases on one page."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.cohort_page import write_cohort_page
from cortet.report.pages import data_uri

given = job.input
thumbnails = iter(given.thumbnails)
meshes = [
    {**mesh, "thumbnail": data_uri(Path(next(thumbnails)).read_bytes(), "image/webp") if mesh["pictured"] else None}
    for mesh in job.params.meshes
]
write_cohort_page(
    Path(given.status),
    (Path(given.quality[0]), Path(given.quality[1])) if given.quality else None,
    job.output.page,
    meshes=meshes,
    figure=Path(given.figure) if given.figure else None,
    maps=dict(zip(job.params.hemispheres, map(Path, given.maps), strict=True)),
    folding=(Path(given.folding[0]), Path(given.folding[1])) if given.folding else None,
    folds=job.params.folds,
    tissues=Path(given.tissues) if given.tissues else None,
    dataset=job.params.dataset,
)
