"""Tables, figures and the page over all cases (cortet.over_all).

Their inputs are functions: every job of a cluster reads these rules, and should not list the files of all cases.
"""


rule cohort_tables:
    """Quality, stages, tissues and states of all cases."""
    input:
        **of_all("cohort_tables"),
    output:
        in_report("cohort_tables"),
    log:
        LAYOUT.log("cohort_tables", ()),
    localrule: True
    params:
        facts=facts_of("cohort_tables"),
        version=versions("report.cohort_tables", "report.table_files"),
    script:
        "../scripts/over_all.py"


rule cohort_page:
    """The page of all cases with its figure, means on the common mesh, and the methods paragraph."""
    input:
        **of_all("cohort_page"),
    output:
        in_report("cohort_page"),
    log:
        LAYOUT.log("cohort_page", ()),
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        facts=facts_of("cohort_page"),
        version=versions("report.pages", "report.figures", "report.cohort_maps", "report.methods"),
    script:
        "../scripts/over_all.py"


#: files that a whole run makes over all cases, and a page for each case
COHORT_FILES = [
    *RESULTS["cohort_tables"].files,
    *RESULTS["cohort_page"].files,
    *PLAN.each_case(LAYOUT.case_page).values(),
]
