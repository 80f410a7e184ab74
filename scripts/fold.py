"""Fold one mesh; an inverted element is a result, not a failure."""

import logging
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.config.fold import Settings
from cortet.folding.fold import fold
from cortet.folding.journal import per_percent
from cortet.formats import vtu
from cortet.solver_files.meshed import why_uncertified

if why := why_uncertified(Path(job.input.mesh)):
    logging.getLogger("cortet").warning("the mesh that is folded is not certified: %s", "; ".join(why))
verdict = fold(
    vtu.read(job.input.mesh),
    Path(job.output.verdict).parent,
    Settings(**job.params.arguments),
    per_percent(logging.getLogger("cortet").info),
)
logging.getLogger("cortet").info("%s", verdict.reason)
