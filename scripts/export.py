"""Write one mesh for a solver, if it is certified."""

import json
from pathlib import Path

from _job import parameters, snakemake

from cortet.export import export
from cortet.formats import vtu

certificate = json.loads(Path(snakemake.input.certificate).read_text())
export(vtu.read(snakemake.input.mesh), Path(snakemake.output.mesh), certificate=certificate, **parameters())
