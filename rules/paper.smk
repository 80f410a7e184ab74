"""Meshes of other meshers, and reference meshes, for the experiments of the CORTET paper.

None of this is part of `all`; ask for `tables` or `figures`.
"""

from cortet.paper.experiments import Experiments

EXPERIMENTS = Experiments(States(PLAN))


rule tables:
    """Tables of the paper's experiments."""
    input:
        **of_all("tables"),
        cohort=ancient(COHORT_FILES),
    output:
        in_report("tables"),
    log:
        LAYOUT.log("tables", ()),
    localrule: True
    params:
        facts=facts_of("tables"),
        version=versions("paper.ablation", "paper.mesh_tables", "report.table_files"),
    script:
        "../scripts/over_all.py"


rule figures:
    """Figures of the paper's experiments."""
    input:
        **of_all("figures"),
        cohort=ancient(COHORT_FILES),
    output:
        in_report("figures"),
    log:
        LAYOUT.log("figures", ()),
    resources:
        mem_mb=8000,
        runtime=50,
    params:
        facts=facts_of("figures"),
        version=versions("paper.pooled_quality", "paper.series", "report.figures", "report.render"),
    script:
        "../scripts/over_all.py"


checkpoint baseline:
    """S1 by a mesher of another project; where it fails, the mesh is empty and its records say why."""
    input:
        surface=INPUTS.meshed_surface,
    output:
        mesh=LAYOUT.mesh("Generated"),
        report=LAYOUT.mesh("Generated", "tetmesh.json"),
        quality=LAYOUT.mesh("Generated", "quality.json"),
    log:
        LAYOUT.log("baseline", SHARED_MESH),
    benchmark:
        took("baseline", SHARED_MESH)
    wildcard_constraints:
        mesher="|".join(EXPERIMENTS.compared_meshers) or "none",
    resources:
        mem_mb=partial(JOBS.megabytes, "generate"),
        runtime=CONFIG.experiments.ablation.time_limit + 5,
    params:
        **recorded(LABELS["generate"]),
        time_limit=CONFIG.experiments.ablation.time_limit,
        version=versions("meshers.baselines", "measure.quality"),
    script:
        "../scripts/baseline.py"


rule reference:
    """Element quality of a reference mesh."""
    input:
        mesh=lambda wildcards: str(EXPERIMENTS.references()[wildcards.reference]),
    output:
        record=f"{OUT}/cohort/reference-{{reference}}_quality.json",
    log:
        LAYOUT.log("reference", ("reference",)),
    resources:
        mem_mb=2000,
        runtime=5,
    params:
        version=version_of("measure.quality"),
        origin=lambda wildcards: {"reference": wildcards.reference},
        input_sha256=lambda wildcards: content({"mesh": EXPERIMENTS.references()[wildcards.reference]}),
        roots=ROOTS,
    script:
        "../scripts/reference.py"
