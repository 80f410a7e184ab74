"""Fold meshes: the simulation that they are made for."""


rule fold:
    """Grow the cortex until the end, or until an element inverts; goes on where a killed job was.

    Frames and checkpoint lie beside the outputs; declared, Snakemake would delete them before it starts a job again.
    """
    input:
        mesh=mesh_file("Solver"),
    output:
        verdict=fold_file("verdict.json"),
        table=fold_file("fold.tsv"),
        sidecar=fold_file("fold.json"),
        series=fold_file("fold.pvd"),
    log:
        mesh_log("fold", desc="Folded{variant}"),
    benchmark:
        mesh_benchmark("fold", desc="Folded{variant}")
    conda:
        "../envs/cortet.yaml"
    # two threads that wait for each other after every loop are no gain on a small mesh
    threads: lambda wildcards: 1 if tets(wildcards) < 2e5 else 2
    resources:
        mem_mb=megabytes("fold"),
        runtime=minutes("fold"),
        gpu=gpus,
    params:
        arguments=lambda wildcards: arguments_of("fold", wildcards) | variant_of(wildcards),
        version=version_of("simulation.fold"),
    script:
        "../scripts/fold.py"


rule convergence_run:
    """Mesh a surface in one realisation, fold the mesh, and carry the surface along."""
    input:
        surface=surface_of,
        fields=existing_fields_of,
        sphere=sphere_of,
        template=template_of,
    output:
        record=convergence_file("record.json"),
        table=convergence_file("fold.tsv"),
        start=convergence_file("start.surf.gii"),
        folded=convergence_file("folded.surf.gii"),
    log:
        run_log("convergence/{folder}/{case}_res-{res}um_desc-{mesher}_seed-{seed}"),
    benchmark:
        run_benchmark("convergence/{folder}/{case}_res-{res}um_desc-{mesher}_seed-{seed}")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("fold"),
        runtime=minutes("fold"),
        gpu=gpus,
    params:
        arguments=partial(arguments_of, "fold"),
        line=realisation_of,
        origin=lambda wildcards: {
            "case": wildcards.case,
            "mesher": wildcards.mesher,
            "seed": int(wildcards.seed),
            "cell_size_mm": int(wildcards.res) / 1000,
        },
        input_sha256=lambda wildcards: content(all_paths_of(wildcards)),
        paths=all_paths_of,
        files=field_paths_of,
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
    log:
        run_log("convergence"),
    benchmark:
        run_benchmark("convergence")
    conda:
        "../envs/cortet.yaml"
    params:
        version=[version_of("report.convergence"), version_of("report.table_files")],
    script:
        "../scripts/convergence.py"


rule fold_figures:
    """Its numbers against age, the surface before and after, and a film."""
    input:
        table=rules.fold.output.table,
        series=rules.fold.output.series,
    output:
        numbers=report(
            fold_file("folding.svg"),
            caption="../reports/folding.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "numbers"},
        ),
        picture=report(
            fold_file("folded.png"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "before and after"},
        ),
        film=report(
            fold_file("folding.gif"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case} {variant}", "figure": "film"},
        ),
    log:
        mesh_log("fold_figures", desc="Folded{variant}"),
    benchmark:
        mesh_benchmark("fold_figures", desc="Folded{variant}")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("fold_figures"),
        runtime=minutes("fold_figures"),
    params:
        hemisphere=lambda wildcards: CASES[wildcards.case].hemi,
        version=version_of("report.fold_figures"),
    script:
        "../scripts/fold_figures.py"


rule cohort_folding:
    """All folds of the cohort, those that stopped included: a table, and their curves over real brains."""
    input:
        lambda _: [
            str(Path(verdict).with_name(name))
            for verdict in existing_files(fold_runs())
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
    log:
        run_log("cohort_folding"),
    benchmark:
        run_benchmark("cohort_folding")
    conda:
        "../envs/cortet.yaml"
    params:
        runs=lambda _: [
            {**run, "folder": str(Path(verdict).parent)}
            for verdict, run in fold_runs().items()
            if verdict not in MISSING
        ],
        failed=lambda _: [
            {**run, "reason": MISSING[verdict]} for verdict, run in fold_runs().items() if verdict in MISSING
        ],
        version=version_of("report.cohort_folding"),
    script:
        "../scripts/cohort_folding.py"
