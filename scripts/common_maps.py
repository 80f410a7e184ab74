"""The folded cortex of a week on the common mesh, and its means over parcels."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.biomarkers import write_common
from cortet.stages.resample import Resample, common_sphere

settings, _ = Resample.split(job.params.resample)
write_common(
    Path(job.input.folded),
    dict(zip(job.params.measures, map(Path, job.input.maps), strict=True)),
    Path(job.input.sphere),
    common_sphere(settings),
    Path(job.input.parcels) if job.input.parcels else None,
    {name: Path(job.output[name]) for name in ("surface", "maps", "parcels")},
    hemi=job.params.hemisphere,
)
