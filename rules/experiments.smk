"""The experiments of the CORTET paper on this cohort: other settings and meshers on its surfaces, tables and figures.

None of this is part of `all`; ask for `tables`, `figures` or `report`.
"""


checkpoint baseline:
    """S1 by a mesher to compare with, as it comes; where it fails, the mesh is empty and the report says why."""
    input:
        surface=MESHED_SURFACE,
    output:
        mesh=mesh_file("Generated"),
        report=mesh_file("Generated", "tetmesh.json"),
    log:
        mesh_log("baseline"),
    benchmark:
        mesh_benchmark("baseline")
    wildcard_constraints:
        mesher="|".join(BASELINES) or "none",
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes(4000),
        runtime=EXPERIMENTS.ablation.time_limit + 5,
    params:
        stage=lambda wildcards: {
            "mesher": wildcards.mesher,
            "cell_size": int(wildcards.res) / 1000,
            "time_limit": EXPERIMENTS.ablation.time_limit,
            "version": stage_version("baselines"),
        },
    script:
        "../scripts/baseline.py"


rule reference:
    """Element quality of a reference mesh."""
    input:
        mesh=lambda wildcards: str(REFERENCES[wildcards.reference]),
    output:
        record=f"{OUT}/cohort/reference-{{reference}}_quality.json",
    log:
        "logs/reference/{reference}.log",
    benchmark:
        "benchmarks/reference/{reference}.tsv"
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        version=stage_version("quality"),
    script:
        "../scripts/reference.py"


rule table_ablation:
    """Table 1 of the paper: what each stage does to the quality."""
    input:
        records=records_of_all(ablated(OWN_MESHERS)),
        baselines=lambda _: records_of_all(mesh for mesh in ablated(BASELINES) if is_made(*mesh)),
        made=ablation_reports(),
        references=expand(rules.reference.output.record, reference=REFERENCES),
    output:
        report(
            f"{OUT}/cohort/table-ablation.html",
            caption="../reports/table_ablation.rst",
            category="Tables",
            labels={"table": "1, stage ablation"},
        ),
        multiext(f"{OUT}/cohort/table-ablation", ".tsv", ".json", ".tex", ".md"),
    log:
        "logs/table_ablation.log",
    benchmark:
        "benchmarks/table_ablation.tsv"
    conda:
        "../envs/cortet.yaml"
    params:
        missing=missing_records(),
        setting=CONFIG.setting,
        version=[stage_version("experiments"), stage_version("printed")],
    script:
        "../scripts/table_ablation.py"


TABLES = [*rules.table_ablation.output]
