"""Tables and figures over all cases.

Their inputs are functions: every job of a cluster reads these rules, and should not list the files of all cases.
"""


localrules:
    dataset_description,
    cohort_quality,
    cohort_summary,
    cohort_stages,
    cohort_tissues,
    cohort_figure,
    cohort_status,
    cohort_page,
    citation,


rule dataset_description:
    """What BIDS wants to know of a folder of derivatives."""
    output:
        description=f"{OUT}/dataset_description.json",
        ignore=f"{OUT}/.bidsignore",
        descriptions=f"{OUT}/descriptions.tsv",
    params:
        version=__version__,
        links=lambda _: Places(Path(OUT), Path(RAW)).links(path for case in CASES.values() for path in case.files),
        meanings=lambda _: descriptions(SETTINGS),
    script:
        "../scripts/dataset_description.py"


rule cohort_quality:
    """One row per mesh: quality, fidelity, topology, verdict; a JSON file explains the columns."""
    input:
        lambda _: PLAN.measured_certificates(),
    output:
        table=f"{OUT}/cohort/cohort_quality.tsv",
        sidecar=f"{OUT}/cohort/cohort_quality.json",
        view=report(
            f"{OUT}/cohort/cohort_quality.html",
            caption="../reports/cohort_quality.rst",
            category="Cohort",
            labels={"result": "table: quality"},
        ),
    params:
        cases=list(CASES.values()),
        version=[version_of("report.cohort_tables"), version_of("report.table_files")],
    script:
        "../scripts/cohort_quality.py"


rule cohort_summary:
    """One row per cell size and mesher, as Table 1 of the CORTET paper."""
    input:
        lambda _: PLAN.measured_certificates(),
    output:
        table=f"{OUT}/cohort/cohort_summary.tsv",
        sidecar=f"{OUT}/cohort/cohort_summary.json",
        view=report(
            f"{OUT}/cohort/cohort_summary.html",
            caption="../reports/cohort_summary.rst",
            category="Cohort",
            labels={"result": "table: summary"},
        ),
    params:
        cases=list(CASES.values()),
        version=[version_of("report.cohort_tables"), version_of("report.table_files")],
    script:
        "../scripts/cohort_summary.py"


rule cohort_stages:
    """One row per mesh and measured stage."""
    input:
        lambda _: PLAN.stage_records(),
    output:
        table=f"{OUT}/cohort/cohort_stages.tsv",
        sidecar=f"{OUT}/cohort/cohort_stages.json",
        view=report(
            f"{OUT}/cohort/cohort_stages.html",
            caption="../reports/cohort_stages.rst",
            category="Cohort",
            labels={"result": "table: stages"},
        ),
    params:
        version=[version_of("report.records"), version_of("report.table_files")],
    script:
        "../scripts/cohort_stages.py"


rule cohort_tissues:
    """One row per mesh and label of the volumes of its case."""
    input:
        lambda _: list(PLAN.tissue_tables().values()),
    output:
        table=f"{OUT}/cohort/cohort_tissues.tsv",
        sidecar=f"{OUT}/cohort/cohort_tissues.json",
        view=report(
            f"{OUT}/cohort/cohort_tissues.html",
            caption="../reports/cohort_tissues.rst",
            category="Cohort",
            labels={"result": "table: tissues"},
        ),
    params:
        meshes=lambda _: [PLAN.described(mesh) for mesh in PLAN.tissue_tables()],
        version=[version_of("report.cohort_tissues"), version_of("report.table_files")],
    script:
        "../scripts/cohort_tissues.py"


rule cohort_figure:
    """Element count, mean and worst q against gestational age."""
    input:
        table=rules.cohort_quality.output.table,
    output:
        report(
            f"{OUT}/cohort/figure-cohort.svg",
            caption="../reports/cohort_figure.rst",
            category="Cohort",
            labels={"result": "figure: quality against age"},
        ),
        multiext(f"{OUT}/cohort/figure-cohort", ".pdf", ".png"),
    params:
        limit=CONFIG.certify.q_max,
        version=version_of("report.figures"),
    script:
        "../scripts/cohort_figure.py"


rule cohort_status:
    """Every case with its stage, state, reason and log."""
    input:
        certificates=lambda _: PLAN.measured_certificates(),
        solver_files=lambda _: PLAN.exported_files(),
    output:
        table=f"{OUT}/cohort/cohort_status.tsv",
        sidecar=f"{OUT}/cohort/cohort_status.json",
        view=report(
            f"{OUT}/cohort/cohort_status.html",
            caption="../reports/cohort_status.rst",
            category="Cohort",
            labels={"result": "table: status"},
        ),
    params:
        meshes=lambda _: PLAN.status(),
        version=[version_of("cohort.status"), version_of("report.table_files")],
    script:
        "../scripts/cohort_status.py"


rule citation:
    """What a paper says of the run, with references, as fMRIPrep leaves it."""
    input:
        lambda _: PLAN.measured_certificates(),
    output:
        multiext(f"{OUT}/logs/CITATION", ".md", ".bib", ".tex", ".html"),
    params:
        sheet=SHEET,
        failures=lambda _: PLAN.unmeasured(),
        version=[version_of("report.methods"), version_of("report.citation")],
    script:
        "../scripts/citation.py"


rule cohort_page:
    """All cases on one page for a browser, with their key numbers, failures and outliers first."""
    input:
        status=rules.cohort_status.output.table,
        quality=lambda _: [*rules.cohort_quality.output[:2]] if PLAN.measured_certificates() else [],
        figure=lambda _: rules.cohort_figure.output[0] if PLAN.measured_certificates() else [],
        maps=lambda _: expand(rules.cohort_maps.output.picture, hemi=PLAN.mapped_hemispheres()),
        tissues=lambda _: rules.cohort_tissues.output.table if PLAN.tissue_tables() else [],
        thumbnails=lambda _: list(PLAN.thumbnails().values()),
        folding=lambda _: [rules.cohort_folding.output.table, rules.cohort_folding.output.figure] if FOLDED else [],
    output:
        page=LAYOUT.cohort_page,
    params:
        meshes=lambda _: PLAN.listed_on_page(),
        hemispheres=lambda _: PLAN.mapped_hemispheres(),
        dataset=CONFIG.cohort.dataset.resolve().name if CONFIG.cohort.dataset else "",
        folds=lambda _: [
            {**run, "folder": beside(Path(verdict).parent, LAYOUT.cohort_page)}
            for verdict, run in PLAN.fold_runs().items()
        ],
        version=version_of("report.pages"),
    script:
        "../scripts/cohort_page.py"


rule cohort_maps:
    """Means over the cases of a hemisphere on the common mesh: surface, fields, distance to the boundary."""
    input:
        lambda wildcards: list(PLAN.maps(wildcards.hemi).values()),
    output:
        surface=f"{OUT}/cohort/hemi-{{hemi}}_desc-mean_white.surf.gii",
        maps=f"{OUT}/cohort/hemi-{{hemi}}_desc-mean_maps.shape.gii",
        sidecar=f"{OUT}/cohort/hemi-{{hemi}}_desc-mean_maps.json",
        picture=report(
            f"{OUT}/cohort/figure-maps_hemi-{{hemi}}.png",
            caption="../reports/cohort_maps.rst",
            category="Cohort",
            labels={"result": "maps on the common mesh"},
        ),
    wildcard_constraints:
        hemi="[LR]",
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        cases=lambda wildcards: list(PLAN.maps(wildcards.hemi)),
        version=[version_of("report.cohort_maps"), version_of("report.render")],
    script:
        "../scripts/cohort_maps.py"


COHORT_FILES = [
    *rules.cohort_quality.output,
    *rules.cohort_summary.output,
    *rules.cohort_stages.output,
    *(rules.cohort_tissues.output if PLAN.has_volumes else []),
    *rules.cohort_figure.output,
    *rules.cohort_status.output,
    *rules.cohort_page.output,
    *rules.citation.output,
    *expand(rules.cohort_maps.output, hemi=[hemi for hemi in "LR" if PLAN.mapped(hemi)]),
    *PLAN.each_case(LAYOUT.case_page).values(),
]
