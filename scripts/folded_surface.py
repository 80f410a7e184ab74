"""The folded cortex of a week on the vertices of its own surface, and what is measured there."""

from dataclasses import replace
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.folded_surface import write_surfaces
from cortet.folding.measures import MEASURES
from cortet.formats import gifti, vtu
from cortet.formats.placement import placed
from cortet.solver_files.surface_map import surface_map

source = Path(job.input.surface)
native = replace(gifti.read_surface(source, finite=False), point_data={})
found = surface_map(
    vtu.read(job.input.mesh),
    gifti.read_surface(job.input.meshed),
    placed(native, job.params.to_mm),
    renumbered=job.params.resampled,
)
files = {name: Path(job.output[name]) for name in ("surface", *MEASURES)}
folder = Path(job.input.series).parent
write_surfaces(folder, job.params.week, found, files, like=source, hemi=job.params.hemisphere)
