"""All cases on one page."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.cohort_page import write_cohort_page

given = job.input
write_cohort_page(
    Path(given.status),
    (Path(given.quality[0]), Path(given.quality[1])) if given.quality else None,
    job.output.page,
    meshes=job.params.meshes,
    figure=Path(given.figure) if given.figure else None,
    maps=dict(zip(job.params.hemispheres, map(Path, given.maps), strict=True)),
    folding=(Path(given.folding[0]), Path(given.folding[1])) if given.folding else None,
    folds=job.params.folds,
    tissues=Path(given.tissues) if given.tissues else None,
    dataset=job.params.dataset,
)
