"""Write one mesh with elements of ten nodes, in every format that is asked for, if it is certified."""

from pathlib import Path

from _job import start

job = start(snakemake)

from _exported import certificate_as_planned, read_made

from cortet.formats.certificates import OF_UNCERTIFIED
from cortet.geometry.quadratic import quadratic
from cortet.solver_files.export import require_certified, with_sets
from cortet.solver_files.meshed import Origin
from cortet.solver_files.ten_nodes import write_ten_nodes

job.require_unchanged_input()
mesh, surface, named = read_made(job.input, job.params)
mesh, _ = with_sets(mesh, surface, Origin(fields=job.params.paths), **named)
certificate = certificate_as_planned(job.input, job.params)
targets = [Path(file) for file in job.output[:-1]]
require_certified(mesh, certificate, targets[0], uncertified=job.wildcards.label == OF_UNCERTIFIED)
curved = quadratic(mesh, surface, max_boundary_distance=job.params.max_boundary_distance)
for target in sorted(targets, key=lambda path: path.suffix == ".xdmf"):  # its record, which is kept, lists two files
    write_ten_nodes(mesh, curved, target)
