"""Tables, figures and pages over all cases (cortet.report.over_all).

Their inputs are functions: every job of a cluster reads these rules, and should not list the files of all cases.
"""


rule dataset_description:
    """What BIDS wants to know of a folder of derivatives."""
    output:
        description=f"{OUT}/dataset_description.json",
        ignore=f"{OUT}/.bidsignore",
        descriptions=f"{OUT}/descriptions.tsv",
    log:
        LAYOUT.log("dataset_description", ()),
    localrule: True
    params:
        version=__version__,
        links=lambda _: Places(Path(OUT), Path(RAW)).links(path for case in CASES.values() for path in case.files),
        meanings=lambda _: descriptions(SETTINGS),
    script:
        "../scripts/dataset_description.py"


for result in RESULTS:

    rule:
        """A table, a figure or a page over all cases."""
        name:
            result.rule
        input:
            files=partial(made_from, result),
            reported=existing(f"{OUT}/{REPORTED}"),
        output:
            [in_report(result, path) for path in result.files],
        log:
            LAYOUT.log(result.rule, ()),
        benchmark:
            took(result.rule, ())
        localrule: result.minutes <= 20
        resources:
            mem_mb=result.memory_mb,
            runtime=result.minutes,
        params:
            **({"journal": CONFIG.figures.journal} if result.is_drawn else {}),
            facts=partial(facts_of, result),
            made_from=partial(names_of, result),
            version=versions(*result.code),
        script:
            "../scripts/over_all.py"


COHORT_FILES = [
    *OVER_ALL.of(*OF_COHORT),
    *PLAN.each_case(LAYOUT.case_page).values(),
]
