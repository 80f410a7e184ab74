"""Fold one mesh; an inverted element is a result, not a failure."""

import logging
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.formats import vtu
from cortet.simulation.fold import fold
from cortet.simulation.journal import per_percent
from cortet.simulation.state import Settings

verdict = fold(
    vtu.read(job.input.mesh),
    Path(job.output.verdict).parent,
    Settings(**job.arguments),
    per_percent(logging.getLogger("cortet").info),
)
logging.getLogger("cortet").info("%s", verdict.reason)
