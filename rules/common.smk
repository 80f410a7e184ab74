"""The sheet and the configuration as the rules see them; the names of all files."""

import json
import os
import re
from functools import partial
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from cortet import __version__
from cortet.cohort.bids import Places, descriptions
from cortet.cohort.receipts import content
from cortet.cohort.sheet import PHANTOM, ageless_notice, folded, read_sheet
from cortet.config import load, read, version_of
from cortet.errors import CortetError
from cortet.formats import FORMATS
from cortet.mesh import OUTERMOST
from cortet.meshers import BASELINES, MESHERS
from cortet.stages import MESH_STAGES, STAGES
from cortet.cohort.resources import cost, expected_tets, expected_volume_ml, memory_to_ask_mb, minutes_to_ask

# what rules/failures.smk hands over: (case, res, mesher) of the meshes that failed, and how; reasons why files that the
# experiments measure are missing
FAILURES = {tuple(record["mesh"]): record["failure"] for record in config.pop("failures", [])}
MISSING = config.pop("missing", {})

try:
    if workflow.is_main_process:
        for file in workflow.configfiles:  # Snakemake takes the last of two values of a key in silence
            read(Path(file))
    CONFIG = load(config)
    # by the name that files carry: the line's own setting carries none, others are run beside it
    SETTINGS = {"": CONFIG} | {
        name.capitalize(): load({**config, "setting": name})
        for name in CONFIG.experiments.settings
        if name != CONFIG.setting
    }
    for setting in SETTINGS.values():
        setting.require_programs()
    for notice in CONFIG.notices():
        logger.warning(notice)
    # read here and never an input of a rule: a new row then runs one new case
    SHEET = read_sheet(CONFIG.cohort.sheet, CONFIG.cohort.fields)
except CortetError as error:
    raise WorkflowError(str(error)) from None

# scripts/_job.py keeps to it; no parameter of a rule, since another limit makes no other result
os.environ.update(CORTET_TIME_LIMIT=str(CONFIG.time_limit or 0))

OUT = CONFIG.output.as_posix()
# what BIDS URIs begin with; no parameter either, it changes no result
RAW = str(CONFIG.cohort.dataset or CONFIG.cohort.sheet.parent)
os.environ.update(CORTET_OUTPUT=OUT, CORTET_RAW=RAW)
# the first stage reads the files of the sheet
REPAIRS = CONFIG.enabled("repair")
CASES = {case.name: case for case in SHEET if case.include}
for notice in ageless_notice(list(CASES.values())):
    logger.warning(notice)
try:
    CONFIG.require_nesting(any(case.inner for case in CASES.values()))
except CortetError as error:
    raise WorkflowError(f"the sheet has inner surfaces: {error}") from None
# meshers of other projects, for comparison: where one fails, its report says so and the run goes on
COMPARED_MESHERS = [
    mesher
    for mesher in CONFIG.experiments.ablation.meshers
    if mesher in BASELINES and mesher not in CONFIG.generate.meshers
]
RESOLUTIONS = [round(1000 * size) for size in CONFIG.generate.cell_size]

# what the names of meshes call the result of each stage; stages whose mesh is the same in every setting
LABELS = {name: stage.label for name, stage in MESH_STAGES.items()}
SHARED = [name for name, stage in MESH_STAGES.items() if stage.shared_by_settings]


def exported_suffix(form):
    """End of the name of an exported file; the stages' own files end in tetmesh.vtu."""
    return f"{'boundary' if form.is_surface else 'sets' if form.name == 'vtu' else 'tetmesh'}{form.suffix}"


SOLVERS = {exported_suffix(form): name for name, form in FORMATS.items()}
# rules that take every mesh that is done
OVER_ALL_CASES = (
    *("cohort_quality", "cohort_summary", "cohort_stages", "cohort_figure", "cohort_status", "cohort_page", "citation"),
    "cohort_maps",
    *("cohort_folding", "convergence"),
    *("table_ablation", "table_resolution", "table_measures", "figure_pooled_quality", "figure_series", "methods"),
)


wildcard_constraints:
    folder=r"sub-[A-Za-z0-9]+(/ses-[A-Za-z0-9]+)?",
    case=r"sub-[A-Za-z0-9]+(_ses-[A-Za-z0-9]+)?(_hemi-[LR])?",
    res=r"[1-9][0-9]*",
    seed=r"[0-9]+",
    inner=r"[A-Za-z][A-Za-z0-9]*",
    variant=f"({'|'.join(name.capitalize() for name in CONFIG.fold.variants)})?",
    mesher=r"[a-z0-9]+",
    setting="|".join(["", *SETTINGS]),  # an empty expression alone would be none
    suffix="|".join(map(re.escape, SOLVERS)),


def bids(suffix, datatype, **entities):
    """Pattern of an output file: OUT/{folder}/DATATYPE/{case}_KEY-VALUE..._SUFFIX."""
    name = "_".join(["{case}", *(f"{key}-{value}" for key, value in entities.items()), suffix])
    return f"{OUT}/{{folder}}/{datatype}/{name}"


def surface_file(desc, suffix="white.surf.gii"):
    return bids(suffix, "anat", desc=desc)


def inner_file(desc, suffix="white.surf.gii", **entities):
    """File of an inner surface, by the name of the region inside it."""
    return bids(suffix, "anat", **entities, inner="{inner}", desc=desc)


def mesh_file(desc, suffix="tetmesh.vtu"):
    """File of a stage's mesh: its name tells mesher, setting where it matters, and stage."""
    setting = "" if desc in [LABELS[stage] for stage in SHARED] else "{setting}"
    return bids(suffix, "mesh", res="{res}um", desc=f"{{mesher}}{setting}{desc}")


def intermediate(files):
    """Output that only later stages read."""
    return files if CONFIG.keep_intermediates else temp(files)


def fold_file(name):
    """File of a simulation: a run has a folder of its own."""
    return f"{OUT}/{{folder}}/simulation/{{case}}_res-{{res}}um_desc-{{mesher}}{{setting}}Folded{{variant}}/{name}"


def convergence_file(name):
    """File of a fold of the experiment on convergence: a realisation of a mesh has a folder of its own."""
    return f"{OUT}/{{folder}}/convergence/{{case}}_res-{{res}}um_desc-{{mesher}}_seed-{{seed}}/{name}"


def run_log(name, suffix="log"):
    """Log of a job, or with suffix `tsv` its benchmark: seconds and memory."""
    return f"{OUT}/{'logs' if suffix == 'log' else 'benchmarks'}/{name}.{suffix}"


def surface_log(rule, suffix="log"):
    """Log or benchmark of a job on a surface, named as the files they are about."""
    return run_log(f"{rule}/{{folder}}/{{case}}", suffix)


def mesh_log(rule, suffix="log", desc=""):
    setting = "" if rule in (*SHARED, "baseline", "quality") else "{setting}"
    return run_log(f"{rule}/{{folder}}/{{case}}_res-{{res}}um_desc-{{mesher}}{setting}{desc}", suffix)


run_benchmark = partial(run_log, suffix="tsv")
surface_benchmark = partial(surface_log, suffix="tsv")
mesh_benchmark = partial(mesh_log, suffix="tsv")


def inner_log(rule, suffix="log"):
    """Log or benchmark of a job on an inner surface, for one cell size where that matters."""
    res = "_res-{res}um" if rule == "separate" else ""
    return run_log(f"{rule}/{{folder}}/{{case}}{res}_inner-{{inner}}", suffix)


def file_of(pattern, case, res, mesher, setting=""):
    """A file of a pattern for one mesh."""
    return pattern.format(folder=case.folder, case=case.name, res=res, mesher=mesher, setting=setting, variant="")


def each_case(pattern):
    """Files of a pattern for all included cases, cell sizes and meshers, keyed by (case, res, mesher)."""
    return {
        (case.name, res, mesher): file_of(pattern, case, res, mesher)
        for case in CASES.values()
        for res in RESOLUTIONS
        for mesher in CONFIG.generate.meshers
    }


def settings_on(mesher):
    """Settings, as files name them, that are run on the meshes of a mesher: those that have it, else all."""
    own = [name for name, setting in SETTINGS.items() if mesher in setting.generate.meshers]
    return own or list(SETTINGS)


def setting_of(wildcards):
    """Configuration of the setting that a file was made in."""
    return SETTINGS[wildcards.get("setting", "")]


def mesh_before(stage):
    """File of the last enabled stage before `stage`: a bypassed stage does not occur."""

    def file(wildcards):
        meshes = [other.name for other in setting_of(wildcards).line() if other.gives == "mesh"]
        earlier = [name for name in meshes if list(LABELS).index(name) < list(LABELS).index(stage)]
        return mesh_file(LABELS[earlier[-1]]).format(**{"setting": "", **wildcards})

    return file


def facts_of(wildcards):
    """What is known of the surface or mesh that a job is about, as `Config.arguments` wants it."""
    case = CASES[wildcards.case]
    facts = {"source": str(case.surface), "gestational_age": case.scan_age, "hemisphere": case.hemi}
    facts["placement"] = placement_of(wildcards)
    facts["nested"] = bool(case.inner)
    facts["sphere_file"] = str(case.sphere)
    if "res" in wildcards.keys():
        facts |= {"cell_size": int(wildcards.res) / 1000, "mesher": wildcards.get("mesher")}
    if "inner" in wildcards.keys():
        facts["source"] = str(case.inner.get(wildcards.inner))
    return facts


def config_of(step, wildcards):
    """Configuration of the setting that a job works in; stages that all settings share work in that of the line."""
    return CONFIG if step in SHARED else setting_of(wildcards)


def placement_of(wildcards):
    """Matrix that takes the coordinates of a case to mm; None where they are."""
    case = CASES[wildcards.case]
    try:
        return None if case.is_phantom else CONFIG.placement(case.unit, case.affine)
    except CortetError as error:
        raise WorkflowError(f"{case.name}: {error}") from None


def is_resampled(wildcards):
    """Whether the line of a case begins with its resampling onto the common mesh."""
    return CONFIG.enabled("resample") and CASES[wildcards.case].sphere is not None


def placement_after_resampling(wildcards):
    """As `placement_of`, for the stage that is the first one where a case has no sphere."""
    return None if is_resampled(wildcards) else placement_of(wildcards)


def arguments_of(step, wildcards):
    """Keyword arguments of a stage or another step: with its VERSION, they decide whether it runs again."""
    return config_of(step, wildcards).arguments(step, facts_of(wildcards))


def space_of(wildcards):
    """The surface in whose space all files of a case are."""
    case = CASES[wildcards.case]
    return surface_file("phantom").format(**wildcards) if case.is_phantom else str(case.surface)


def paths_of(wildcards):
    """The user's files that the surfaces of a case are made from, by their columns in the sheet."""
    case = CASES[wildcards.case]
    named = {"surface": case.surface} | {f"inner_{name}": path for name, path in case.inner.items()}
    if is_resampled(wildcards):
        named |= {"sphere": case.sphere, "template": CONFIG.template(case.hemi)}
    return {name: str(path) for name, path in named.items() if path not in (None, PHANTOM)}


def given_surfaces_of(wildcards):
    """The user's surfaces of a case by region; nothing of a phantom."""
    case = CASES[wildcards.case]
    named = {OUTERMOST: case.surface, **case.inner}
    return {region: str(path) for region, path in named.items() if path != PHANTOM}


def field_paths_of(wildcards):
    """The files of the fields of a case, by name."""
    return {name: str(path) for name, path in CASES[wildcards.case].fields.items()}


def all_paths_of(wildcards):
    """All files of a case, by their columns in the sheet."""
    return paths_of(wildcards) | {f"field_{name}": path for name, path in field_paths_of(wildcards).items()}


def input_sha256_of(wildcards):
    """Hashes of `paths_of`: with another content of a file, whatever its time, everything of the case runs again."""
    return content(paths_of(wildcards))


def origin_of(stage, wildcards):
    """Whose record a job writes; `stage` is the one that made the mesh or surface, by its label."""
    if "mesher" in wildcards.keys():
        setting = wildcards.get("setting", "")
        return origin_of_mesh(stage, wildcards.case, wildcards.res, wildcards.mesher, setting)
    inner = {"inner": wildcards.inner} if "inner" in wildcards.keys() else {}
    return {"case": wildcards.case, "stage": stage, **inner}


def origin_of_mesh(stage, case, res, mesher, setting=""):
    """Whose record one of a mesh is; `stage` is the one that made the mesh, `case` a name, the rest as in `file_of`."""
    shared = stage in [LABELS[name] for name in SHARED]
    return {
        "case": case,
        "stage": stage,
        "cell_size_mm": int(res) / 1000,
        "mesher": mesher,
        "setting": None if shared else SETTINGS[setting].setting,
    }


def is_aged(wildcards):
    """Whether the age of a case is known."""
    return CASES[wildcards.case].scan_age is not None


def last_of_surface(wildcards):
    """Label of the last stage that changes the surface of a case, or each of its inner ones, by itself."""
    line = CONFIG.line(aged=is_aged(wildcards))
    return [stage.label for stage in line if stage.gives == "surface"][-1]


def meshed_surface(wildcards):
    """The surface that is meshed, and that every later stage measures against."""
    return surface_file(last_of_surface(wildcards))


# the inner surfaces as S1 meshes them
INNER_SURFACE = inner_file(STAGES["separate"].label, res="{res}um")


def inner_before_separating(wildcards):
    """The inner surfaces of a case as they are before `separate`, which depends on the cell size."""
    return inner_of(inner_file(last_of_surface(wildcards)))(wildcards)


def inner_of(pattern):
    """Files of a pattern for the inner surfaces of a case, as an input function; none where it has none."""

    def files(wildcards):
        inner = CASES[wildcards.case].inner
        return [pattern.format(**{**wildcards, "inner": name}) for name in inner]

    return files


def inner_source(wildcards):
    """File of the sheet for one inner surface of a case."""
    path = CASES[wildcards.case].inner.get(wildcards.inner)
    if path == PHANTOM:
        return inner_file("phantom").format(**wildcards)
    return existing(path) if path else []


def tets(wildcards):
    """Tetrahedra to expect: from the volume that the gate found, before it has run from the age; 0 on a surface."""
    if "mesher" not in wildcards.keys():
        return 0
    case = CASES[wildcards.case]
    try:
        gated = Path(surface_file("gated", "white.json").format(**wildcards)).read_text(encoding="utf-8")
        volume = json.loads(gated)["volume_ml"]
    except (OSError, ValueError):
        volume = expected_volume_ml(case.scan_age, whole=case.hemi is None)
    return expected_tets(volume, int(wildcards.res) / 1000, wildcards.mesher)


def cost_of(rule, wildcards):
    return cost(rule, wildcards.get("mesher", ""))


def megabytes(rule):
    """Memory that a job asks for, as a function of its wildcards and of how often it was killed."""
    return lambda wildcards, attempt: memory_to_ask_mb(cost_of(rule, wildcards).memory_mb(tets(wildcards)), attempt)


def minutes(rule):
    return lambda wildcards: minutes_to_ask(cost_of(rule, wildcards).cpu_seconds(tets(wildcards)))


def existing(path):
    """The file if it is there: a missing one is for the job to complain about, so that other cases go on."""
    return str(path) if os.path.isfile(path) else []


def existing_fields_of(wildcards):
    """The files of the fields of a case that are there; the job complains about the others."""
    return [path for path in field_paths_of(wildcards).values() if os.path.isfile(path)]


def surface_of(wildcards):
    case = CASES[wildcards.case]
    return surface_file("phantom") if case.is_phantom else existing(case.surface)


def sphere_of(wildcards):
    """The sphere of a case that is resampled; nothing of others, and where the file is missing."""
    if not is_resampled(wildcards):
        return []
    sphere = CASES[wildcards.case].sphere
    return surface_file("phantom", "sphere.surf.gii") if sphere == PHANTOM else existing(sphere)


def template_of(wildcards):
    """The common sphere that a case is resampled to; nothing where that is the icosphere."""
    template = CONFIG.template(CASES[wildcards.case].hemi) if is_resampled(wildcards) else None
    return [] if template is None else existing(template)


def first_surface(wildcards):
    """The surface with which the line begins, on the common mesh where it has a sphere."""
    return surface_file(STAGES["resample"].label) if is_resampled(wildcards) else surface_of(wildcards)


def first_inner_surface(wildcards):
    """The same of an inner surface."""
    return inner_file(STAGES["resample"].label) if is_resampled(wildcards) else inner_source(wildcards)


def fields_of(wildcards):
    """The file of the case's fields; nothing when it has none."""
    return surface_file("fields") if CASES[wildcards.case].fields else []


def size_field_of(wildcards):
    """The same where S1 follows one of them; nothing where it does not, and other fields do not make it run again."""
    return fields_of(wildcards) if CONFIG.generate.size_field else []


CERTIFICATE = mesh_file("Solver", "certificate.json")
CASE_PAGE, COHORT_PAGE = mesh_file("Solver", "report.html"), f"{OUT}/cohort/index.html"
SOLVER_FILES = [mesh_file("Solver", suffix) for suffix, solver in SOLVERS.items() if solver in CONFIG.export.formats]


def reports_of(wildcards):
    """What the stages of a setting reported, by stage."""
    inner = CASES[wildcards.case].inner

    def report(stage):
        if stage.nested:
            return inner_file(stage.label, "white.json", res="{res}um")
        if stage.gives == "surface":
            return surface_file(stage.label, "white.json")
        return mesh_file(stage.label, "tetmesh.json")

    line = setting_of(wildcards).line(nested=bool(inner), registered=is_resampled(wildcards), aged=is_aged(wildcards))
    files = {stage.name: report(stage) for stage in line}
    # each report of `separate` is about all inner surfaces
    first = {"inner": next(iter(inner), "")}
    return {stage: path.format(**{**wildcards, **first}) for stage, path in files.items()}


def inner_reports_of(stage):
    """What a stage reported of the inner surfaces of a case, as an input function; nothing where it has not run."""

    def files(wildcards):
        runs = setting_of(wildcards).line(registered=is_resampled(wildcards))
        pattern = inner_file(STAGES[stage].label, "white.json")
        return inner_of(pattern)(wildcards) if STAGES[stage] in runs else []

    return files


def recorded_line(wildcards):
    """Arguments and versions of the stages of a setting and of the certificate, for the certificate."""
    steps = [*reports_of(wildcards), "certify"]
    return {step: config_of(step, wildcards).record(step, facts_of(wildcards)) for step in steps}


def solver_files():
    """Solver files of all cases with their certificates: one that was deleted is made again."""
    return [path for pattern in (*SOLVER_FILES, CERTIFICATE) for path in each_case(pattern).values()]


def quality_records():
    measured = [LABELS[stage] for stage in CONFIG.quality.stages if CONFIG.enabled(stage)]
    return [path for desc in measured for path in each_case(mesh_file(desc, "quality.json")).values()]


try:
    FOLDED = {case.name for case in folded(list(CASES.values()), CONFIG.fold.cases)}
except CortetError as error:
    raise WorkflowError(f"fold.cases: {error}") from None


def fold_runs():
    """Runs that the configuration asks for, as the table of all of them has it, by their verdict."""
    return {
        file_of(fold_file("verdict.json"), CASES[case], res, mesher).replace(
            "Folded/", f"Folded{variant.capitalize()}/"
        ): {
            "case": case,
            "variant": variant or None,
            "cell_size_mm": res / 1000,
            "mesher": mesher,
            "hemisphere": CASES[case].hemi,
        }
        for case, res, mesher in each_case(CERTIFICATE)
        for variant in ["", *CONFIG.fold.variants]
        if case in FOLDED
    }


def fold_files():
    """What is drawn of the runs that the configuration asks for."""
    names = ("folding.svg", "folded.png", "folding.gif")
    return [str(Path(verdict).with_name(name)) for verdict in fold_runs() for name in names]


def variant_of(wildcards):
    """What differs in a variant from the other runs of its case."""
    return CONFIG.fold.variants.get(wildcards.variant.lower(), {})


def gpus(wildcards):
    """GPUs that a fold asks for."""
    changed = variant_of(wildcards) if "variant" in wildcards.keys() else {}
    return int(changed.get("device", CONFIG.fold.device) == "cuda")


def is_measured(mesh, failures):
    """Whether a mesh got as far as its certificate: it did not fail, or only in what comes after."""
    return mesh not in failures or failures[mesh]["stage"] in (
        "export",
        "case_page",
        "case_maps",
        "fold",
        "fold_figures",
        "convergence_run",
    )


def unmeasured():
    """Why cases have no certificate, by their names."""
    return {mesh[0]: failure["reason"] for mesh, failure in FAILURES.items() if not is_measured(mesh, FAILURES)}


def mapped(hemi):
    """Cases of a hemisphere that are put onto the common mesh."""
    return [name for name, case in CASES.items() if case.hemi == hemi and CONFIG.enabled("resample") and case.sphere]


def maps_of(hemi):
    """Maps of the cases of a hemisphere that are done, at the first cell size and by the first mesher, by case."""
    first = RESOLUTIONS[0], CONFIG.generate.meshers[0]
    meshes = [(name, *first) for name in mapped(hemi)]
    files = each_case(mesh_file("Solver", "maps.surf.gii"))
    return {mesh[0]: files[mesh] for mesh in meshes if is_measured(mesh, FAILURES)}


def mapped_hemispheres():
    """Hemispheres of which there are maps."""
    return [hemi for hemi in "LR" if maps_of(hemi)]


def measured_certificates():
    return [path for mesh, path in each_case(CERTIFICATE).items() if is_measured(mesh, FAILURES)]


def failure_of(wildcards):
    """What kept the mesh of a page from its certificate; nothing when it has one."""
    mesh = (wildcards.case, int(wildcards.res), wildcards.mesher)
    return None if wildcards.setting or is_measured(mesh, FAILURES) else FAILURES[mesh]


def shown_on_page(wildcards):
    """Inputs of the page of a mesh: of one that failed, the input surface if it is there."""
    if failure_of(wildcards):
        case = CASES[wildcards.case]
        phantom = Path(surface_file("phantom").format(**wildcards))
        return {"surface": existing(phantom if case.is_phantom else case.surface)}
    return {
        "surface": surface_of(wildcards),
        "meshed": meshed_surface(wildcards),
        "mesh": mesh_file("Solver"),
        "certificate": CERTIFICATE,
    }


def beside(path, page):
    """Address of a file as seen from a page."""
    return Path(os.path.relpath(path, Path(page).parent)).as_posix()


def stage_records():
    """Quality records of the meshes that got as far as their certificate, stage by stage."""
    measured = [LABELS[stage] for stage in CONFIG.quality.stages if CONFIG.enabled(stage)]
    records = [each_case(mesh_file(desc, "quality.json")) for desc in measured]
    return [record[mesh] for mesh in each_case(CERTIFICATE) if is_measured(mesh, FAILURES) for record in records]


def status_of_all():
    """Parameter of the status table: excluded rows, failures, and where the certificates of the others are."""
    excluded = [
        {"case": case.name, "state": "excluded", "reason": case.exclude_reason} for case in SHEET if not case.include
    ]
    meshes = []
    for mesh, certificate in each_case(CERTIFICATE).items():
        name, res, mesher = mesh
        failure = FAILURES.get(mesh, {})
        known = {"certificate": certificate} if is_measured(mesh, FAILURES) else {}
        meshes.append(
            {
                "case": name,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                **failure,
                **known,
            }
        )
    return meshes + excluded
