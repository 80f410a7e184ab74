"""One of the stages that make a mesh, but for the last one."""

from dataclasses import asdict, replace

from _job import start

job = start(snakemake)

from cortet.formats import carp, gifti, vtu
from cortet.formats.atomic import write_json
from cortet.measure.quality import summarise
from cortet.meshes import TetMesh, TriSurface
from cortet.stages import STAGES

stage = STAGES[snakemake.rule]
given: dict[str, TetMesh | TriSurface] = {}
if "mesh" in stage.takes:
    given["mesh"] = vtu.read(job.input.mesh)
if "surface" in stage.takes:
    given["surface"] = gifti.read_nested(job.input.surface, job.input.inner, job.input.get("fields"))
mesh, report = stage.run(*(given[kind] for kind in stage.takes), **job.arguments)
vtu.write(mesh, job.output.mesh)
if files := job.output.get("carp"):
    carp.write(replace(mesh, point_data={}), files[0])
write_json(job.record(asdict(report)), job.output.report)
write_json(job.record(asdict(summarise(mesh))), job.output.quality)
