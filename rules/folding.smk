"""Fold meshes: the simulation that they are made for."""

from cortet.folding.plan import Folds

FOLDS = Folds(PLAN)


wildcard_constraints:
    seed="[0-9]+",
    kind="[a-z]+",
    week="[0-9]+([.][0-9]+)?",
    variant=f"({'|'.join(name.capitalize() for name in CONFIG.fold.variants)})?",
    changed=f"({'|'.join(name.capitalize() for name in CONFIG.experiments.prediction.variants)})?",


rule fold:
    """Grow the cortex until the end, or until an element inverts; goes on where a killed job was.

    Frames and checkpoint lie beside the outputs; declared, Snakemake would delete them before it starts a job again.
    """
    input:
        mesh=LAYOUT.mesh("Solver"),
    output:
        verdict=FOLDS.fold("verdict.json"),
        table=FOLDS.fold("fold.tsv"),
        sidecar=FOLDS.fold("fold.json"),
        series=FOLDS.fold("fold.pvd"),
    # two threads that wait for each other after every loop gain nothing on a small mesh
    log:
        LAYOUT.log("fold", (*MESH, "variant")),
    benchmark:
        took("fold", (*MESH, "variant"))
    priority: 3
    threads: lambda wildcards: 1 if PLAN.tets(wildcards) < 2e5 else 2
    resources:
        **asked("fold"),
    params:
        arguments=lambda wildcards: PLAN.arguments("fold", wildcards) | FOLDS.variant(wildcards),
        version=version_of("folding.fold"),
    script:
        "../scripts/fold.py"


rule folded_surface:
    """The folded cortex of a week on the vertices of its own surface, and what is measured there."""
    input:
        series=rules.fold.output.series,
        mesh=LAYOUT.mesh("Solver"),
        meshed=PLAN.meshed_surface,
        surface=PLAN.surface,
    output:
        **FOLDS.surfaces(),
    log:
        LAYOUT.log("folded_surface", (*MESH, "variant", "week")),
    benchmark:
        took("folded_surface", (*MESH, "variant", "week"))
    priority: 3
    resources:
        **asked("folded_surface"),
    params:
        week=lambda wildcards: float(wildcards.week),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        to_mm=PLAN.placement,
        resampled=PLAN.is_resampled,
        input_sha256=PLAN.input_sha256,
        version=versions("folding.fold", "folding.folded_surface"),
    script:
        "../scripts/folded_surface.py"


rule common_maps:
    """The folded cortex of a week on the common mesh, and its means over parcels."""
    input:
        folded=FOLDS.surfaces()["surface"],
        maps=[FOLDS.surfaces()[measure] for measure in CONFIG.biomarkers.measures],
        surface=PLAN.surface,
        sphere=PLAN.sphere,
        template=PLAN.template,
        parcels=FOLDS.parcels,
    output:
        **FOLDS.common(),
    log:
        LAYOUT.log("common_maps", (*MESH, "variant", "week")),
    benchmark:
        took("common_maps", (*MESH, "variant", "week"))
    priority: 3
    resources:
        **asked("common_maps"),
    params:
        measures=CONFIG.biomarkers.measures,
        resample=partial(PLAN.arguments, "resample"),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        input_sha256=lambda wildcards: content({"parcels": path} if (path := FOLDS.parcels(wildcards)) else {}),
        version=versions("folding.biomarkers"),
    script:
        "../scripts/common_maps.py"


rule convergence_run:
    """Mesh a surface in one realisation, fold the mesh, and carry the surface along."""
    input:
        surface=PLAN.surface,
        fields=PLAN.existing_fields,
        sphere=PLAN.sphere,
        template=PLAN.template,
    output:
        record=FOLDS.convergence("record.json"),
        table=FOLDS.convergence("fold.tsv"),
        start=FOLDS.convergence("start.surf.gii"),
        folded=FOLDS.convergence("folded.surf.gii"),
    log:
        LAYOUT.log("convergence_run", (*SHARED_MESH, "seed")),
    benchmark:
        took("convergence_run", (*SHARED_MESH, "seed"))
    priority: 3
    resources:
        **asked("convergence_run"),
    params:
        arguments=partial(PLAN.arguments, "fold"),
        line=FOLDS.realisation,
        origin=lambda wildcards: {
            "case": wildcards.case,
            "mesher": wildcards.mesher,
            "seed": int(wildcards.seed),
            "cell_size_mm": int(wildcards.res) / 1000,
        },
        input_sha256=lambda wildcards: content(PLAN.all_paths(wildcards)),
        paths=derived(PLAN.all_paths),
        files=derived(PLAN.field_paths),
        roots=ROOTS,
        age=lambda wildcards: CASES[wildcards.case].scan_age,
        version=[version_of("folding.fold"), *(version_of(f"stages.{stage.name}") for stage in CONFIG.line())],
    script:
        "../scripts/convergence_run.py"


rule prediction_run:
    """Predict the later surfaces of a series from its first one, and compare them with the real ones."""
    input:
        surfaces=lambda wildcards: FOLDS.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: FOLDS.spheres_of_series(wildcards.case),
        labels=lambda wildcards: existing(FOLDS.labels_of_series(wildcards.case)),
    output:
        record=FOLDS.prediction("record.json"),
    log:
        LAYOUT.log("prediction_run", (*SURFACE, "kind", "changed")),
    benchmark:
        took("prediction_run", (*SURFACE, "kind", "changed"))
    priority: 3
    threads: 1
    resources:
        **asked("prediction_run"),
    params:
        arguments=lambda wildcards: PLAN.arguments("fold", wildcards)
        | {key: value for key, value in FOLDS.changed(wildcards).items() if key not in ("cell_size", "seed")},
        line=FOLDS.predicted_realisation,
        options=CONFIG.experiments.prediction.model_dump(mode="json", include={"until", "rounds", "smoothing", "seed"}),
        ages=lambda wildcards: list(FOLDS.prediction_series()[wildcards.case]),
        files=derived(lambda wildcards: FOLDS.labels_of_series(wildcards.case)),
        roots=ROOTS,
        origin=lambda wildcards: {"case": wildcards.case, "kind": wildcards.kind, "variant": wildcards.changed.lower()},
        input_sha256=FOLDS.series_sha256,
        version=[
            version_of("folding.fold"),
            version_of("folding.prediction"),
            version_of("folding.prediction_tables"),
            *(version_of(f"stages.{stage.name}") for stage in CONFIG.line()),
        ],
    script:
        "../scripts/prediction_run.py"


rule prediction_views:
    """Predicted brains beside the real ones, and where they are too shallow or too deep."""
    input:
        record=FOLDS.prediction("record.json", changed=""),
        surfaces=lambda wildcards: FOLDS.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: FOLDS.spheres_of_series(wildcards.case),
    output:
        picture=report(
            FOLDS.prediction("predicted.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "predicted and real"},
        ),
        errors=report(
            FOLDS.prediction("errors.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "error of depth"},
        ),
    log:
        LAYOUT.log("prediction_views", (*SURFACE, "kind")),
    benchmark:
        took("prediction_views", (*SURFACE, "kind"))
    priority: 3
    resources:
        **asked("prediction_views"),
    params:
        placement=CONFIG.placement(),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        ages=lambda wildcards: list(FOLDS.prediction_series()[wildcards.case]),
        input_sha256=FOLDS.series_sha256,
        version=[version_of("folding.prediction_tables")],
    script:
        "../scripts/prediction_views.py"


rule prediction_spread:
    """How far predictions lie apart under other cells, stiffness and thickness, and whether the truth is among them."""
    input:
        records=FOLDS.varied_predictions,
        surfaces=lambda wildcards: FOLDS.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: FOLDS.spheres_of_series(wildcards.case),
    output:
        record=FOLDS.prediction("spread.json", changed=""),
        maps=FOLDS.prediction("spread.shape.gii", changed=""),
        picture=report(
            FOLDS.prediction("spread.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "how sure"},
        ),
    log:
        LAYOUT.log("prediction_spread", (*SURFACE, "kind")),
    benchmark:
        took("prediction_spread", (*SURFACE, "kind"))
    priority: 3
    resources:
        **asked("prediction_spread"),
    params:
        placement=CONFIG.placement(),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        ages=lambda wildcards: list(FOLDS.prediction_series()[wildcards.case]),
        input_sha256=FOLDS.series_sha256,
        version=[version_of("folding.prediction_spread")],
    script:
        "../scripts/prediction_spread.py"


rule fold_figures:
    """Its numbers against age, the brain every four weeks beside real ones, and a film."""
    input:
        table=rules.fold.output.table,
        series=rules.fold.output.series,
        real=lambda wildcards: [path for path in FOLDS.real_surfaces(wildcards).values() if existing(path)],
        maps=lambda wildcards: [path for files in FOLDS.pictured(wildcards).values() for path in files],
    output:
        numbers=report(
            FOLDS.fold("folding.svg"),
            caption="../reports/folding.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "numbers"},
        ),
        picture=report(
            FOLDS.fold("folded.png"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "by age"},
        ),
        film=report(
            FOLDS.fold("folding.gif"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "film"},
        ),
    log:
        LAYOUT.log("fold_figures", (*MESH, "variant")),
    benchmark:
        took("fold_figures", (*MESH, "variant"))
    priority: 3
    resources:
        **asked("fold_figures"),
    params:
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        files=derived(FOLDS.real_surfaces),
        maps=derived(FOLDS.pictured),
        weeks=lambda wildcards: list(FOLDS.pictured(wildcards)),
        measure=CONFIG.fold.picture,
        input_sha256=lambda wildcards: content(FOLDS.real_surfaces(wildcards)),
        version=version_of("folding.fold_figures"),
    script:
        "../scripts/fold_figures.py"
