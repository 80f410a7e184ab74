"""Table, figure and sentence of the experiment on convergence."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.study.convergence import write_convergence

write_convergence([Path(path).parent for path in job.input if path.endswith("record.json")], job.output)
