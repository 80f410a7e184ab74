"""Snakemake's report on the tables and figures, which it makes in a run of its own."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from _job import start

job = start(snakemake)

from cortet.formats import child
from cortet.formats.atomic import atomic_path

with TemporaryDirectory() as folder:
    config, archive = Path(folder) / "config.json", Path(folder) / "report.zip"  # Snakemake names its root by the file
    config.write_text(json.dumps(job.params.config, default=str))
    command = [sys.executable, "-m", "snakemake", "--nolock", "--no-hooks", "--snakefile", job.params.snakefile]
    targets = ["cohort", "tables", "figures"]
    command += ["--configfile", str(config), "--report", str(archive), "--", *targets]
    subprocess.run(command, check=True, preexec_fn=child.end_with_parent)
    with atomic_path(job.output.archive) as complete:
        shutil.copy(archive, complete)
