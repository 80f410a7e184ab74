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
        mesh_log("fold", desc="Folded"),
    benchmark:
        mesh_benchmark("fold", desc="Folded")
    conda:
        "../envs/cortet.yaml"
    # two threads that wait for each other after every loop are no gain on a small mesh
    threads: lambda wildcards: 1 if tets(wildcards) < 2e5 else 2
    resources:
        mem_mb=megabytes("fold"),
        runtime=minutes("fold"),
    params:
        arguments=partial(arguments_of, "fold"),
        version=version_of("simulation.fold"),
    script:
        "../scripts/fold.py"


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
            labels={"case": "{case}", "figure": "numbers"},
        ),
        picture=report(
            fold_file("folded.png"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case}", "figure": "before and after"},
        ),
        film=report(
            fold_file("folding.gif"),
            caption="../reports/folded.rst",
            category="Folding",
            labels={"case": "{case}", "figure": "film"},
        ),
    log:
        mesh_log("fold_figures", desc="Folded"),
    benchmark:
        mesh_benchmark("fold_figures", desc="Folded")
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
