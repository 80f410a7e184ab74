"""How far the predictions of one kind lie apart under the variants."""

import json
from pathlib import Path

from prediction_spread import checked, maps_of, spread_views, spreads
from prediction_tables import predicted_surfaces
from series import read_series

from cortet.formats.gifti import write_fields
from cortet.report.figures import save

given, output, params = snakemake.input, snakemake.output, snakemake.params
files = dict(zip(params.ages, map(Path, given.surfaces), strict=True))
series = read_series(files, [*map(Path, given.spheres)], params.hemi)
folders = [Path(record).parent for record in given.records]
found = spreads(series, [*map(predicted_surfaces, folders)])
which = {"series": snakemake.wildcards.name, "kind": snakemake.wildcards.kind}
record = {**which, "runs": [folder.name for folder in folders], "ages": checked(series, found)}
Path(output.record).write_text(json.dumps(record), encoding="utf-8")
write_fields(maps_of(found), output.maps)
save(spread_views(series, found, params.hemi), Path(output.picture))
