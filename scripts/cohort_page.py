"""All cases on one page."""

from pathlib import Path

from _job import snakemake

from cortet.cohort_page import write_cohort_page

given = snakemake.input
write_cohort_page(
    Path(given.status),
    (Path(given.quality[0]), Path(given.quality[1])) if given.quality else None,
    snakemake.output.page,
    meshes=snakemake.params.meshes,
    figure=Path(given.figure) if given.figure else None,
)
