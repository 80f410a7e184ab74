"""Which meshes take part in the experiments, and the names of their records."""

import json

from cortet.cohort import chosen
from cortet.experiments import ABLATED

EXPERIMENTS = CONFIG.experiments
# meshers whose failure is that of the case
OWN_MESHERS = list(
    dict.fromkeys(m for m in [*CONFIG.generate.meshers, *EXPERIMENTS.ablation.meshers] if m not in BASELINES)
)


def cases_of(section):
    try:
        return chosen(list(CASES.values()), section)
    except CortetError as error:
        raise WorkflowError(str(error)) from None


ABLATION_CASES = {
    **{res: cases_of(EXPERIMENTS.ablation.cases) for res in RESOLUTIONS},
    **{round(1000 * size): cases_of(which) for size, which in EXPERIMENTS.ablation.further.items()},
}
REFERENCES = {path.stem: path for path in EXPERIMENTS.reference_meshes}


def ablated(meshers):
    """Case, cell size and mesher of every mesh that the ablation takes from some meshers."""
    return [(case, res, mesher) for res, cases in ABLATION_CASES.items() for case in cases for mesher in meshers]


def records_of(mesh):
    """Quality records of one mesh, after each stage that the ablation looks at, in each setting."""
    desc_of = {desc: stage for stage, desc in STAGES.items() if desc in ABLATED}
    return [
        file_of(mesh_file(desc, "quality.json"), *mesh, name)
        for desc, stage in desc_of.items()
        for name, setting in ({"": CONFIG} if stage in IN_EVERY_SETTING else SETTINGS).items()
        if setting.enabled(stage)
    ]


def is_made(case, res, mesher):
    """Whether a mesher that is only compared with made a mesh; asking makes it try."""
    if MISSING:  # the run has ended: what is there is there
        path = file_of(mesh_file("Generated", "tetmesh.json"), case, res, mesher)
    else:
        path = checkpoints.baseline.get(folder=case.folder, case=case.name, res=res, mesher=mesher).output["report"]
    return Path(path).exists() and "failure" not in json.loads(Path(path).read_text())


def records_of_all(meshes):
    return [path for mesh in meshes for path in records_of(mesh) if path not in MISSING]


def ablation_reports():
    """What S1 reported of every mesh; with these as inputs the meshers run at once, not one after the other."""
    meshes = ablated([*OWN_MESHERS, *BASELINES])
    reports = [file_of(mesh_file("Generated", "tetmesh.json"), *mesh) for mesh in meshes]
    return [path for path in reports if path not in MISSING]


def missing_records():
    """Reasons why records are missing that failed jobs should have made, by file."""
    meshes = ablated([*OWN_MESHERS, *BASELINES])
    return {path: MISSING[path] for mesh in meshes for path in records_of(mesh) if path in MISSING}
