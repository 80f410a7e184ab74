"""Certify, show, export."""


rule certify:
    """Verdict on the last mesh, with every number beside its limit."""
    input:
        mesh=mesh_file("Solver"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        source=surface_of,
        reports=lambda wildcards: list(reports_of(wildcards).values()),
        inner_repairs=inner_reports_of("repair"),
        inner_resamplings=inner_reports_of("resample"),
    output:
        certificate=CERTIFICATE,
    log:
        mesh_log("certify"),
    benchmark:
        mesh_benchmark("certify")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("certify"),
        runtime=minutes("certify"),
    params:
        arguments=partial(arguments_of, "certify"),
        version=version_of("measure.certify"),
        input_sha256=input_sha256_of,
        line=recorded_line,
        to_mm=placement_of,
        inner=lambda wildcards: list(CASES[wildcards.case].inner),
    script:
        "../scripts/certify.py"


rule case_page:
    """A page on one mesh for a browser; of one that failed, what failed and why."""
    input:
        unpack(shown_on_page),
    output:
        page=CASE_PAGE,
    log:
        mesh_log("case_page"),
    benchmark:
        mesh_benchmark("case_page")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("case_page"),
        runtime=minutes("case_page"),
    params:
        about=lambda wildcards: {
            "scan_age": CASES[wildcards.case].scan_age,
            "hemi": CASES[wildcards.case].hemi,
            "cell_size": int(wildcards.res) / 1000,
            "mesher": wildcards.mesher,
        },
        failure=failure_of,
        input_sha256=input_sha256_of,
        to_mm=placement_of,
        cohort=lambda wildcards: beside(COHORT_PAGE, CASE_PAGE.format(**wildcards)),
        version=[version_of("report.pages"), version_of("report.render")],
    script:
        "../scripts/case_page.py"


rule case_maps:
    """A case at the vertices of the common mesh, with its fields and its distance to the mesh."""
    input:
        resampled=surface_file("resampled"),
        meshed=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        fields=fields_of,
        mesh=mesh_file("Solver"),
    output:
        maps=mesh_file("Solver", "maps.surf.gii"),
    log:
        mesh_log("case_maps"),
    benchmark:
        mesh_benchmark("case_maps")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("case_maps"),
        runtime=minutes("case_maps"),
    params:
        version=version_of("report.cohort_maps"),
    script:
        "../scripts/case_maps.py"


rule export:
    """The mesh as a solver reads it, with its sets and a sidecar, verified as written; refused when it is not certified."""
    input:
        mesh=mesh_file("Solver"),
        certificate=CERTIFICATE,
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        fields=existing_fields_of,
    output:
        mesh=mesh_file("Solver", "{suffix}"),
        sidecar=mesh_file("Solver", "{suffix}.json"),
    log:
        mesh_log("export", desc="Solver_{suffix}"),
    benchmark:
        mesh_benchmark("export", desc="Solver_{suffix}")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("export"),
        runtime=minutes("export"),
    params:
        arguments=lambda wildcards: {
            "solver": SOLVERS[wildcards.suffix],
            "uncertified": CONFIG.export.uncertified,
            "unit": CONFIG.export.carp_unit,
            "interior": CONFIG.transfer.interior,
        },
        version=version_of("solver_files.export"),
        sets=CONFIG.export.sets,
        inner=lambda wildcards: list(CASES[wildcards.case].inner),
        given=given_surfaces_of,
        input_sha256=lambda wildcards: content(field_paths_of(wildcards)),
        paths=field_paths_of,
        units=CONFIG.export.field_units,
    script:
        "../scripts/export.py"
