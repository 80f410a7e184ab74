"""Fold one mesh; an inverted element is a result, not a failure."""

import logging
from pathlib import Path

from _job import parameters, snakemake

from cortet.formats import vtu
from cortet.simulation.fold import fold
from cortet.simulation.progress import status
from cortet.simulation.run import Settings

verdict = fold(
    vtu.read(snakemake.input.mesh),
    Path(snakemake.output.verdict).parent,
    Settings(**parameters()),
    lambda *progress: logging.getLogger("cortet").info("%s", status(*progress)),
)
logging.getLogger("cortet").info("%s", verdict.reason)
