"""One surface of a case through the stages of a rule, which may refuse it, with its fields where they are asked for."""

from _job import start

job = start(snakemake)

from cortet.cohort.user_files import missing_surface, require_hemisphere
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.solver_files.fields import with_fields
from cortet.stages import STAGES
from cortet.stages.stage import State

given, params = job.input, job.params
if column := params.get("column"):  # the user's own file
    named = next(iter(params.steps.values()))["about"]
    if not given.surface:
        raise missing_surface(named["source"], column=column)
    if "resample" in params.steps and not given.sphere:
        raise missing_surface(named["sphere_file"], column="sphere")
    for file in (given.surface, *([given.sphere] if given.get("sphere") else [])):
        require_hemisphere(file, params.hemi)
    gifti.require_anatomical(given.surface)
surface = gifti.read_surface(given.surface, finite="repair" not in params.steps)
surface = placed(with_fields(surface, params.get("files", {})), params.get("to_mm"))
sphere = gifti.read_surface(given.sphere) if given.get("sphere") else None
state, reports = job.through(State(surface, sphere))
job.require_unchanged_input()
gifti.write_surface(state.surface, job.output.surface)
if job.output.get("report"):
    for stage, report in reports.items():
        record = job.record(report)
        record["origin"] = {**record["origin"], "stage": STAGES[stage].label}
        write_json(record, job.output.repair if stage == "repair" else job.output.report)
