"""How far the predictions of one kind lie apart under the variants."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.longitudinal import read_series
from cortet.folding.prediction_spread import checked, maps_of, spread_views, spreads
from cortet.folding.prediction_tables import predicted_surfaces
from cortet.formats.atomic import write_json
from cortet.formats.gifti import write_fields
from cortet.report.figures import save

files = dict(zip(job.params.ages, map(Path, job.input.surfaces), strict=True))
hemisphere = job.params.hemisphere
series = read_series(files, [*map(Path, job.input.spheres)], job.params.placement, hemisphere)
found = spreads(series, [predicted_surfaces(Path(record).parent) for record in job.input.records])
write_json(
    {
        "series": job.wildcards.case,
        "kind": job.wildcards.kind,
        "runs": [Path(record).parent.name for record in job.input.records],
        "ages": checked(series, found),
    },
    job.output.record,
)
write_fields(maps_of(found), job.output.maps)
save(spread_views(series, found, hemisphere), Path(job.output.picture))
