"""cortet: certified tetrahedral meshes of a cohort of cortical surfaces.

`snakemake --cores 2` makes everything the configuration asks for; profiles/default is loaded by itself.
"""

from pathlib import Path

from snakemake.utils import min_version

min_version("9.0")


# what the command line and its --configfile say
GIVEN = dict(config)


if Path("config.yaml").exists():

    configfile: "config.yaml"


include: "rules/common.smk"
include: "rules/surface.smk"
include: "rules/mesh.smk"
include: "rules/quality.smk"
include: "rules/cohort.smk"
include: "rules/folding.smk"
include: "rules/paper.smk"
include: "rules/end.smk"


localrules:
    all,
    meshes,
    participants,
    cohort,


rule all:
    """Everything: meshes with their records and pages, solver files, cohort tables and figures."""
    default_target: True
    input:
        lambda _: PLAN.solver_files(),
        lambda _: PLAN.quality_records(PLAN.meshes()),
        COHORT_FILES,
        lambda _: FOLDS.files(),


rule meshes:
    """Certified solver files of every case, without cohort tables and figures."""
    input:
        lambda _: PLAN.solver_files(),


rule participants:
    """Everything on single cases: solver files, certificates, pages, records, folding."""
    input:
        lambda _: CHOSEN.files_of_cases(),
        lambda _: Folds(CHOSEN).files(),


rule cohort:
    """Cohort tables and figures, a page per case and one on all."""
    input:
        COHORT_FILES,
