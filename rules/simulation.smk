"""Fold meshes: the simulation that they are made for."""


rule fold:
    """Grow the cortex until the end, or until an element inverts; goes on where a killed job was.

    Frames and checkpoint lie beside the outputs; declared, Snakemake would delete them before it starts a job again.
    """
    input:
        mesh=LAYOUT.mesh("Solver"),
    output:
        verdict=LAYOUT.fold("verdict.json"),
        table=LAYOUT.fold("fold.tsv"),
        sidecar=LAYOUT.fold("fold.json"),
        series=LAYOUT.fold("fold.pvd"),
    # two threads that wait for each other after every loop are no gain on a small mesh
    threads: lambda wildcards: 1 if PLAN.tets(wildcards) < 2e5 else 2
    resources:
        gpu=PLAN.gpus,
    params:
        arguments=lambda wildcards: PLAN.arguments("fold", wildcards) | PLAN.variant(wildcards),
        version=version_of("simulation.fold"),
    script:
        "../scripts/fold.py"


rule convergence_run:
    """Mesh a surface in one realisation, fold the mesh, and carry the surface along."""
    input:
        surface=PLAN.surface,
        fields=PLAN.existing_fields,
        sphere=PLAN.sphere,
        template=PLAN.template,
    output:
        record=LAYOUT.convergence("record.json"),
        table=LAYOUT.convergence("fold.tsv"),
        start=LAYOUT.convergence("start.surf.gii"),
        folded=LAYOUT.convergence("folded.surf.gii"),
    resources:
        gpu=PLAN.gpus,
    params:
        arguments=partial(PLAN.arguments, "fold"),
        line=realisation_of,
        origin=lambda wildcards: {
            "case": wildcards.case,
            "mesher": wildcards.mesher,
            "seed": int(wildcards.seed),
            "cell_size_mm": int(wildcards.res) / 1000,
        },
        input_sha256=lambda wildcards: content(PLAN.all_paths(wildcards)),
        paths=PLAN.all_paths,
        files=PLAN.field_paths,
        age=lambda wildcards: CASES[wildcards.case].scan_age,
        version=[version_of("simulation.fold"), *(version_of(f"stages.{stage.name}") for stage in CONFIG.line())],
    script:
        "../scripts/convergence_run.py"


rule convergence:
    """Which cell size a fold needs: its numbers and the places of its folds against the cell size."""
    input:
        existing_files([path for files in convergence_runs().values() for path in files]),
    output:
        report(
            f"{OUT}/cohort/table-convergence.html",
            caption="../reports/table_convergence.rst",
            category="Folding",
            labels={"table": "convergence"},
        ),
        report(
            f"{OUT}/cohort/figure-convergence.svg",
            caption="../reports/table_convergence.rst",
            category="Folding",
            labels={"figure": "convergence"},
        ),
        multiext(f"{OUT}/cohort/table-convergence", ".tsv", ".json", ".tex", ".md"),
        multiext(f"{OUT}/cohort/figure-convergence", ".pdf", ".png"),
        f"{OUT}/cohort/convergence.txt",
    params:
        version=[version_of("study.convergence"), version_of("report.table_files")],
    script:
        "../scripts/convergence.py"


rule prediction_run:
    """Predict the later surfaces of a series from its first one, and compare them with the real ones."""
    input:
        surfaces=lambda wildcards: PLAN.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: PLAN.spheres_of_series(wildcards.case),
        labels=lambda wildcards: existing(PLAN.labels_of_series(wildcards.case)),
    output:
        record=LAYOUT.prediction("record.json"),
    threads: 1
    resources:
        gpu=PLAN.gpus,
    params:
        arguments=lambda wildcards: PLAN.arguments("fold", wildcards)
        | {key: value for key, value in PLAN.changed(wildcards).items() if key not in ("cell_size", "seed")},
        line=lambda wildcards: realisation_of(
            {
                "case": wildcards.case,
                "res": round(1000 * PLAN.changed(wildcards).get("cell_size", EXPERIMENTS.prediction.cell_size)),
                "mesher": MESHER_OF[""],
                "seed": PLAN.changed(wildcards).get("seed", CONFIG.generate.seed),
            }
        ),
        options=EXPERIMENTS.prediction.model_dump(mode="json", include={"until", "rounds", "smoothing", "seed"}),
        ages=lambda wildcards: list(PLAN.prediction_series()[wildcards.case]),
        files=lambda wildcards: PLAN.labels_of_series(wildcards.case),
        origin=lambda wildcards: {"case": wildcards.case, "kind": wildcards.kind, "variant": wildcards.changed.lower()},
        input_sha256=lambda wildcards: content(
            {
                path: path
                for path in PLAN.surfaces_of_series(wildcards.case)
                + PLAN.spheres_of_series(wildcards.case)
                + list(filter(None, [PLAN.labels_of_series(wildcards.case)]))
            }
        ),
        version=[
            version_of("simulation.fold"),
            version_of("study.prediction"),
            version_of("study.prediction_tables"),
            *(version_of(f"stages.{stage.name}") for stage in CONFIG.line()),
        ],
    script:
        "../scripts/prediction_run.py"


rule prediction_views:
    """Predicted brains beside the real ones, and where they are too shallow or too deep."""
    input:
        record=LAYOUT.prediction("record.json", changed=""),
        surfaces=lambda wildcards: PLAN.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: PLAN.spheres_of_series(wildcards.case),
    output:
        picture=report(
            LAYOUT.prediction("predicted.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "predicted and real"},
        ),
        errors=report(
            LAYOUT.prediction("errors.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "error of depth"},
        ),
    params:
        placement=CONFIG.placement(),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        ages=lambda wildcards: list(PLAN.prediction_series()[wildcards.case]),
        input_sha256=lambda wildcards: content({path: path for path in PLAN.surfaces_of_series(wildcards.case)}),
        version=[version_of("study.prediction_tables")],
    script:
        "../scripts/prediction_views.py"


rule prediction_spread:
    """How far predictions lie apart under other cells, stiffness and thickness, and whether the truth is among them."""
    input:
        records=lambda wildcards: existing_files(PLAN.varied_predictions(wildcards)),
        surfaces=lambda wildcards: PLAN.surfaces_of_series(wildcards.case),
        spheres=lambda wildcards: PLAN.spheres_of_series(wildcards.case),
    output:
        record=LAYOUT.prediction("spread.json", changed=""),
        maps=LAYOUT.prediction("spread.shape.gii", changed=""),
        picture=report(
            LAYOUT.prediction("spread.png", changed=""),
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"case": "{case} {kind}", "figure": "how sure"},
        ),
    params:
        placement=CONFIG.placement(),
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        ages=lambda wildcards: list(PLAN.prediction_series()[wildcards.case]),
        input_sha256=lambda wildcards: content({path: path for path in PLAN.surfaces_of_series(wildcards.case)}),
        version=[version_of("study.prediction_spread")],
    script:
        "../scripts/prediction_spread.py"


rule prediction:
    """Predictions of later brains beside the real ones."""
    input:
        records=existing_files(PLAN.prediction_files("record.json")),
        spreads=existing_files(PLAN.prediction_spreads()),
        pictures=[
            str(Path(record).with_name(name))
            for record in existing_files(PLAN.prediction_files("record.json"))
            for name in ("predicted.png", "errors.png")
        ],
    output:
        report(
            f"{OUT}/cohort/table-prediction.html",
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"table": "prediction"},
        ),
        report(
            f"{OUT}/cohort/figure-prediction.svg",
            caption="../reports/table_prediction.rst",
            category="Folding",
            labels={"figure": "prediction"},
        ),
        multiext(f"{OUT}/cohort/table-prediction", ".tsv", ".json", ".tex", ".md"),
        multiext(f"{OUT}/cohort/figure-prediction", ".pdf", ".png"),
    params:
        version=[version_of("study.prediction_tables"), version_of("report.table_files")],
    script:
        "../scripts/prediction.py"


rule fold_figures:
    """Its numbers against age, the brain every four weeks beside real ones, and a film."""
    input:
        table=rules.fold.output.table,
        series=rules.fold.output.series,
        real=lambda wildcards: [path for path in PLAN.real_surfaces(wildcards).values() if existing(path)],
    output:
        numbers=report(
            LAYOUT.fold("folding.svg"),
            caption="../reports/folding.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "numbers"},
        ),
        picture=report(
            LAYOUT.fold("folded.png"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "by age"},
        ),
        film=report(
            LAYOUT.fold("folding.gif"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "film"},
        ),
    params:
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        files=PLAN.real_surfaces,
        input_sha256=lambda wildcards: content(PLAN.real_surfaces(wildcards)),
        version=version_of("report.fold_figures"),
    script:
        "../scripts/fold_figures.py"


rule cohort_folding:
    """All folds of the cohort, those that stopped included: a table, and their curves over real brains."""
    input:
        lambda _: [
            str(Path(verdict).with_name(name))
            for verdict in existing_files(PLAN.fold_runs())
            for name in ("verdict.json", "fold.tsv")
        ],
    output:
        table=f"{OUT}/cohort/cohort_folding.tsv",
        sidecar=f"{OUT}/cohort/cohort_folding.json",
        figure=report(
            f"{OUT}/cohort/cohort_folding.svg",
            caption="../reports/cohort_folding.rst",
            category="Folding",
            labels={"figure": "all folds"},
        ),
        print=multiext(f"{OUT}/cohort/cohort_folding", ".pdf", ".png"),
    params:
        runs=lambda _: [
            {**run, "folder": str(Path(verdict).parent)}
            for verdict, run in PLAN.fold_runs().items()
            if verdict not in MISSING
        ],
        failed=lambda _: [
            {**run, "reason": MISSING[verdict]} for verdict, run in PLAN.fold_runs().items() if verdict in MISSING
        ],
        version=version_of("report.cohort_folding"),
    script:
        "../scripts/cohort_folding.py"
