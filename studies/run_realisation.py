"""Mesh a surface in one realisation, and fold the mesh; a fold that stops is a result, not a failure."""

import json
from dataclasses import replace
from pathlib import Path

from carried import carried

import cortet
from cortet.formats.gifti import write_surface

of, output, params = snakemake.wildcards, snakemake.output, snakemake.params
generate = {**params.settings.get("generate", {}), "meshers": [of.mesher], "seed": int(of.seed)}
made = cortet.mesh(
    params.brain["surface"],
    int(of.res) / 1000,
    ga=params.brain["ga"],
    hemi=params.brain.get("hemi"),
    fields=params.brain.get("fields"),
    settings={**params.settings, "generate": generate},
    progress=False,
)
folded = cortet.fold(made, folder=Path(output.record).parent, progress=False, **params.settings.get("fold", {}))
last = folded.at(folded.verdict["gestational_age"])
write_surface(made.surface, output.start)
write_surface(replace(made.surface, points=carried(made.surface.points, made.mesh, last.points)), output.folded)
origin = {"case": of.name, "mesher": of.mesher, "seed": int(of.seed), "cell_size_mm": int(of.res) / 1000}
Path(output.record).write_text(json.dumps({"origin": origin, **folded.verdict}), encoding="utf-8")
