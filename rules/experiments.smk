"""The experiments of the CORTET paper on this cohort: other settings and meshers on its surfaces, tables and figures.

None of this is part of `all`; ask for `tables`, `figures` or `report`.
"""


checkpoint baseline:
    """S1 by a mesher of another project; where it fails, the mesh is empty and the report says why."""
    input:
        surface=PLAN.meshed_surface,
    output:
        mesh=LAYOUT.mesh("Generated"),
        report=LAYOUT.mesh("Generated", "tetmesh.json"),
    wildcard_constraints:
        mesher="|".join(PLAN.compared_meshers) or "none",
    resources:
        mem_mb=partial(PLAN.megabytes, "generate"),
        runtime=EXPERIMENTS.ablation.time_limit + 5,
    params:
        arguments=lambda wildcards: {
            "mesher": wildcards.mesher,
            "cell_size": int(wildcards.res) / 1000,
            "time_limit": EXPERIMENTS.ablation.time_limit,
        },
        version=version_of("meshers.baselines"),
        origin=partial(PLAN.origin, LABELS["generate"]),
        input_sha256=PLAN.input_sha256,
    script:
        "../scripts/baseline.py"


rule quality:
    """Element quality of a mesh of another project's mesher that did not fail."""
    input:
        mesh=LAYOUT.mesh("Generated"),
    output:
        record=LAYOUT.mesh("Generated", "quality.json"),
    wildcard_constraints:
        mesher="|".join(PLAN.compared_meshers) or "none",
    params:
        version=version_of("measure.quality"),
        origin=partial(PLAN.origin, LABELS["generate"]),
        input_sha256=PLAN.input_sha256,
    script:
        "../scripts/quality.py"


rule reference:
    """Element quality of a reference mesh."""
    input:
        mesh=lambda wildcards: str(REFERENCES[wildcards.reference]),
    output:
        record=f"{OUT}/cohort/reference-{{reference}}_quality.json",
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        version=version_of("measure.quality"),
        origin=lambda wildcards: {"reference": wildcards.reference},
    script:
        "../scripts/reference.py"


rule table_ablation:
    """Table 1 of the paper: what each stage does to the quality."""
    input:
        records=lambda _: existing_files(records_of_all(ablated(OWN_MESHERS))),
        baselines=lambda _: existing_files(
            records_of_all(mesh for mesh in ablated(PLAN.compared_meshers) if baseline_succeeded(*mesh))
        ),
        reports=lambda _: existing_files(ablation_reports()),
        references=expand(rules.reference.output.record, reference=REFERENCES),
    output:
        report(
            f"{OUT}/cohort/table-ablation.html",
            caption="../reports/table_ablation.rst",
            category="Tables",
            labels={"table": "1, stage ablation"},
        ),
        multiext(f"{OUT}/cohort/table-ablation", ".tsv", ".json", ".tex", ".md"),
    params:
        missing=lambda _: missing_records(records_of_all(ablated([*OWN_MESHERS, *PLAN.compared_meshers]))),
        version=[version_of("study.ablation"), version_of("report.table_files")],
    script:
        "../scripts/table_ablation.py"


rule table_resolution:
    """Table 2 of the paper: element count and quality against the cell size."""
    input:
        records=existing_files(RESOLUTION_RECORDS),
    output:
        report(
            f"{OUT}/cohort/table-resolution.html",
            caption="../reports/table_resolution.rst",
            category="Tables",
            labels={"table": "2, cell size"},
        ),
        multiext(f"{OUT}/cohort/table-resolution", ".tsv", ".json", ".tex", ".md"),
    params:
        table="resolution",
        missing=missing_records(RESOLUTION_RECORDS),
        ages=AGES,
        version=[version_of("study.mesh_tables"), version_of("report.table_files")],
    script:
        "../scripts/mesh_table.py"


rule table_measures:
    """Worst element by three further measures of the literature."""
    input:
        records=existing_files(MEASURES_RECORDS),
    output:
        report(
            f"{OUT}/cohort/table-measures.html",
            caption="../reports/table_measures.rst",
            category="Tables",
            labels={"table": "other measures"},
        ),
        multiext(f"{OUT}/cohort/table-measures", ".tsv", ".json", ".tex", ".md"),
    params:
        table="measures",
        missing=missing_records(MEASURES_RECORDS),
        ages=AGES,
        version=[version_of("study.mesh_tables"), version_of("report.table_files")],
    script:
        "../scripts/mesh_table.py"


rule figure_pooled_quality:
    """Pooled per-element quality after each stage (Fig. 2 of the paper)."""
    input:
        lambda wildcards: existing_files(records_at(wildcards.res)),
    output:
        report(
            f"{OUT}/cohort/figure-pooled-quality_res-{{res}}um.svg",
            caption="../reports/figure_pooled_quality.rst",
            category="Figures",
            labels={"figure": "pooled quality, h = {res} µm"},
        ),
        multiext(f"{OUT}/cohort/figure-pooled-quality_res-{{res}}um", ".pdf", ".png"),
    params:
        arguments=lambda wildcards: {
            "settings": {SETTINGS[name].setting: mesher for name, mesher in MESHER_OF.items()},
            "limit": CONFIG.certify.q_max,
        },
        version=[version_of("report.figures"), version_of("study.pooled_quality")],
        meshes=lambda wildcards: len(ABLATION_CASES[int(wildcards.res)]),
    script:
        "../scripts/pooled_quality_figure.py"


rule figure_series:
    """Meshes of several ages side by side."""
    input:
        [mesh for brain in series() for mesh in brain["meshes"].values()],
    output:
        report(
            f"{OUT}/cohort/figure-series.svg",
            caption="../reports/figure_series.rst",
            category="Figures",
            labels={"figure": "developmental series"},
        ),
        multiext(f"{OUT}/cohort/figure-series", ".pdf", ".png"),
    resources:
        mem_mb=8000,
        runtime=30,
    params:
        brains=series(),
        h=RESOLUTIONS[0] / 1000,
        version=[version_of("study.series"), version_of("report.render")],
    script:
        "../scripts/series_figure.py"


rule methods:
    """A paragraph for the methods section: parameters, versions, numbers and exclusions."""
    input:
        lambda _: PLAN.measured_certificates(),
    output:
        text=f"{OUT}/cohort/methods.md",
        view=report(
            f"{OUT}/cohort/methods.html",
            caption="../reports/methods.rst",
            category="Methods",
            labels={"text": "methods paragraph"},
        ),
    params:
        sheet=SHEET,
        failures=lambda _: PLAN.unmeasured(),
        version=version_of("report.methods"),
    script:
        "../scripts/methods.py"


TABLES = [
    *rules.table_ablation.output,
    *rules.table_resolution.output,
    *rules.table_measures.output,
    *rules.methods.output,
]
FIGURES = [
    *rules.cohort_figure.output,
    *expand(rules.figure_pooled_quality.output, res=ABLATION_CASES),
    *rules.figure_series.output,
]


rule report:
    """Every table and figure by category, in one archive to open in a browser."""
    input:
        COHORT_FILES,
        TABLES,
        FIGURES,
    output:
        archive=f"{OUT}/cohort/report.zip",
    params:
        config=config,
        snakefile=str(workflow.main_snakefile),
        captions={path.name: path.read_text() for path in sorted(Path(workflow.basedir, "reports").glob("*.rst"))},
    script:
        "../scripts/report.py"
