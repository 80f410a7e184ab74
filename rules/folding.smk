"""Fold meshes: the simulation that they are made for."""


wildcard_constraints:
    week="[0-9]+([.][0-9]+)?",
    variant=f"({'|'.join(name.capitalize() for name in CONFIG.fold.variants)})?",


rule fold:
    """Grow the cortex until the end, or until an element inverts; goes on where a killed job was.

    Frames and checkpoint lie beside the outputs; declared, Snakemake would delete them before it starts a job again. So a
    fold of the same mesh, which was certified again with other limits, takes seconds.
    """
    input:
        mesh=LAST_MESH,
        made=LAST_REPORT,
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
    threads: lambda wildcards: 1 if JOBS.tets(wildcards) < 2e5 else 2
    resources:
        **asked("fold"),
    params:
        made_from=made_from("fold"),
        arguments=FOLDS.arguments,
        version=version_of("folding.fold"),
    script:
        "../scripts/fold.py"


rule folded_surface:
    """The folded cortex of a week on the vertices of its own surface, and what is measured there."""
    input:
        series=rules.fold.output.series,
        mesh=LAST_MESH,
        made=LAST_REPORT,
        meshed=INPUTS.meshed_surface,
        surface=by_content(SOURCES.surface),
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
        made_from=made_from("folded_surface"),
        week=lambda wildcards: float(wildcards.week),
        hemisphere=hemisphere,
        to_mm=SOURCES.placement,
        resampled=SOURCES.is_resampled,
        input_sha256=SOURCES.input_sha256,
        version=versions("folding.fold", "folding.folded_surface"),
    script:
        "../scripts/folded_surface.py"


rule fold_figures:
    """Its numbers against age, the brain every four weeks beside real ones, and a film."""
    input:
        table=rules.fold.output.table,
        series=rules.fold.output.series,
        real=by_content(existing_of(FOLDS.real_surfaces)),
        maps=lambda wildcards: [path for files in FOLDS.pictured(wildcards).values() for path in files],
    output:
        numbers=in_fold_report("folding.svg", "folding", "numbers"),
        picture=in_fold_report("folded.png", "folded", "by age"),
        film=in_fold_report("folding.gif", "folded", "film"),
    log:
        LAYOUT.log("fold_figures", (*MESH, "variant")),
    benchmark:
        took("fold_figures", (*MESH, "variant"))
    priority: 3
    resources:
        **asked("fold_figures"),
    params:
        made_from=made_from("fold_figures"),
        hemisphere=hemisphere,
        files=derived(FOLDS.real_surfaces),
        maps=derived(FOLDS.pictured),
        weeks=lambda wildcards: list(FOLDS.pictured(wildcards)),
        measure=CONFIG.fold.picture,
        input_sha256=lambda wildcards: content(FOLDS.real_surfaces(wildcards)),
        version=version_of("folding.fold_figures"),
    script:
        "../scripts/fold_figures.py"
