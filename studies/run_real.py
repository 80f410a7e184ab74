"""Measure a real surface as folds are measured."""

import json
from pathlib import Path

from late import FETUS, NEWBORN, measured

from cortet.folding.fold_views import real_brain

real = snakemake.params.real
row = {"week": real["ga"], **measured(real_brain(Path(real["surface"]), real.get("hemi")))}
of = {"brain": snakemake.wildcards.name, "kind": NEWBORN if real.get("born") else FETUS}
Path(snakemake.output.record).write_text(json.dumps({"of": of, "rows": [row]}), encoding="utf-8")
