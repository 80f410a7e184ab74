"""What a paper says of the run, with references."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.citation import write_citation
from cortet.report.methods import methods_text

certificates = [json.loads(Path(name).read_text(encoding="utf-8")) for name in job.input]
write_citation(methods_text(certificates, job.params.sheet, job.params.failures), certificates, *job.output)
