"""Which meshes take part in the experiments, and the names of their records."""

import json

from cortet.cohort.selection import chosen, folded
from cortet.study.ablated import ABLATED

EXPERIMENTS = CONFIG.experiments
# meshers whose failure is that of the case
OWN_MESHERS = list(
    dict.fromkeys(
        m for m in [*CONFIG.generate.meshers, *EXPERIMENTS.ablation.meshers] if m not in PLAN.compared_meshers
    )
)


def cases_of(section, choose=chosen):
    """The cases of an experiment; those with inner surfaces, which the meshers compared do not know, take no part."""
    try:
        return choose([case for case in CASES.values() if not case.inner], section)
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


# Quality records are kept as path -> origin, so that a table can also say whose record is missing.


def record_of(desc, mesh, setting=""):
    """The quality record of one mesh after a stage, by the label of the stage."""
    case, res, mesher = mesh
    path = file_of(LAYOUT.mesh(desc, "quality.json"), case, res, mesher, setting)
    return {path: PLAN.origin_of_mesh(desc, case.name, res, mesher, setting)}


def records_of(mesh):
    """Quality records of one mesh, after each stage that the ablation looks at, in the settings that are run on it."""
    settings = PLAN.settings_on(mesh[2])
    return {
        path: origin
        for stage, desc in LABELS.items()
        for name in ([""] if stage in SHARED else settings)
        if desc in ABLATED and SETTINGS[name].enabled(stage)
        for path, origin in record_of(desc, mesh, name).items()
    }


def records_of_all(meshes):
    return {path: origin for mesh in meshes for path, origin in records_of(mesh).items()}


def last_records(meshes):
    """Quality records of the last mesh of every setting, by its own mesher, of some cases and cell sizes."""
    return {
        path: origin
        for case, res in meshes
        for name, mesher in MESHER_OF.items()
        for path, origin in record_of("Solver", (case, res, mesher), name).items()
    }


def baseline_succeeded(case, res, mesher):
    """Whether a mesher that is only compared with made a mesh; asking makes it try."""
    if MISSING:  # the run has ended: what is there is there
        path = file_of(LAYOUT.mesh("Generated", "tetmesh.json"), case, res, mesher)
    else:
        path = checkpoints.baseline.get(folder=case.folder, case=case.name, res=res, mesher=mesher).output["report"]
    return Path(path).exists() and "failure" not in json.loads(Path(path).read_text())


def ablation_reports():
    """What S1 reported of every mesh; with these as inputs the meshers run at once, not one after the other."""
    meshes = ablated([*OWN_MESHERS, *PLAN.compared_meshers])
    return [file_of(LAYOUT.mesh("Generated", "tetmesh.json"), *mesh) for mesh in meshes]


# by setting, the mesher whose meshes stand for it
MESHER_OF = {name: setting.generate.meshers[0] for name, setting in SETTINGS.items()}
RESOLUTION_RECORDS = last_records(
    (case, round(1000 * size))
    for case in cases_of(EXPERIMENTS.resolution.cases)
    for size in EXPERIMENTS.resolution.cell_size
)
MEASURES_RECORDS = last_records((case, RESOLUTIONS[0]) for case in cases_of(EXPERIMENTS.measures.cases))
AGES = {case.name: case.scan_age for case in CASES.values()}


def records_at(res):
    """Records that the pooled quality takes at one cell size."""
    meshers = dict.fromkeys(MESHER_OF.values())
    return records_of_all(mesh for mesh in ablated(meshers) if mesh[1] == int(res))


def existing_files(paths):
    """Those of the files that no failed job has left out."""
    return [path for path in paths if path not in MISSING]


def missing_records(records):
    """Whose the records are that failed jobs have left out, and why they are missing."""
    return [{"origin": origin, "reason": MISSING[path]} for path, origin in records.items() if path in MISSING]


def series():
    """The brains of the developmental series by age: both hemispheres where the sheet has them."""
    chosen_brains = {(case.participant, case.session) for case in cases_of(EXPERIMENTS.series.cases)}
    brains = {}
    for case in CASES.values():
        mesh = file_of(LAYOUT.mesh("Solver"), case, RESOLUTIONS[0], MESHER_OF[""])
        if (case.participant, case.session) in chosen_brains and mesh not in MISSING:
            name = f"sub-{case.participant}" + (f", ses-{case.session}" if case.session else "")
            empty = {"name": name, "age": case.scan_age, "meshes": {}}
            brain = brains.setdefault((case.participant, case.session), empty)
            brain["meshes"][case.hemi or "n/a"] = mesh
    # those of unknown age last
    return sorted(
        brains.values(), key=lambda brain: (brain["age"] is None, brain["age"] or 0, list(brain["meshes"].values()))
    )


def realisation_of(wildcards):
    """Configuration of the line that makes a realisation of a mesh, with what the sheet says of the case."""
    wildcards = dict(wildcards.items())
    case = CASES[wildcards["case"]]
    own = {
        "generate": {
            "cell_size": [int(wildcards["res"]) / 1000],
            "meshers": [wildcards["mesher"]],
            "seed": int(wildcards["seed"]),
        },
        "gate": {
            "unit": case.unit or CONFIG.gate.unit,
            "affine": str(case.affine) if case.affine else CONFIG.gate.affine,
        },
        "resample": {"template": CONFIG.resample.template_of(case.hemi)},
    }
    sections = {name: getattr(CONFIG, name, None) for name in (*STAGES, "regions", "certify")}
    return {
        "setting": CONFIG.setting,
        **{
            name: section.model_dump(mode="json") | own.get(name, {})
            for name, section in sections.items()
            if section is not None
        },
    }


def convergence_runs():
    """Records and surfaces of all runs of the experiment, by case, cell size, mesher and seed."""
    experiment = EXPERIMENTS.convergence
    return {
        (case.name, size, mesher, seed): [
            LAYOUT.convergence(name).format(
                folder=case.folder, case=case.name, res=round(1000 * size), mesher=mesher, seed=seed
            )
            for name in ("record.json", "fold.tsv", "start.surf.gii", "folded.surf.gii")
        ]
        for case in cases_of(experiment.cases, folded)
        for size in experiment.cell_size
        for mesher in experiment.meshers
        for seed in experiment.seeds
    }
