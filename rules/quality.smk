"""Show, export."""


rule case_page:
    """A page on one mesh for a browser. One that failed has a page of its own kind (cortet.over_all)."""
    input:
        surface=by_content(SOURCES.surface),
        meshed=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        mesh=LAST_MESH,
        made=LAST_REPORT,
        certificate=CERTIFICATE,
        tissues=INPUTS.tissues,
    output:
        page=LAYOUT.case_page,
        thumbnail=LAYOUT.thumbnail,
    log:
        LAYOUT.log("case_page", MESH),
    benchmark:
        took("case_page", MESH)
    priority: 2
    resources:
        **asked("case_page"),
    params:
        made_from=made_from("case_page"),
        about=JOBS.page_facts,
        input_sha256=SOURCES.input_sha256,
        to_mm=SOURCES.placement,
        cohort=derived(lambda wildcards: beside(LAYOUT.cohort_page, LAYOUT.case_page.format(**wildcards))),
        exported=JOBS.exported,
        names_of_volumes=names_of("volumes"),
        version=[version_of("report.pages"), version_of("report.render")],
    script:
        "../scripts/case_page.py"


rule case_maps:
    """A case at the vertices of the common mesh, with its fields and its distance to the mesh."""
    input:
        resampled=LAYOUT.surface("resampled"),
        meshed=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        fields=INPUTS.fields,
        mesh=LAST_MESH,
        made=LAST_REPORT,
    output:
        maps=LAYOUT.mesh("Solver", "maps.surf.gii"),
    log:
        LAYOUT.log("case_maps", MESH),
    benchmark:
        took("case_maps", MESH)
    priority: 2
    resources:
        **asked("case_maps"),
    params:
        made_from=made_from("case_maps"),
        version=version_of("report.cohort_maps"),
        names_of_fields=names_of("fields"),
    script:
        "../scripts/case_maps.py"


rule volumes:
    """What the volumes of a case hold inside each tetrahedron; the table of their labels, and slices with the mesh in them."""
    input:
        mesh=LAST_MESH,
        made=LAST_REPORT,
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        volumes=by_content(existing_of(SOURCES.volume_paths)),
    output:
        mesh=intermediate(LAYOUT.mesh(LABELS["solver_ready"], "volumes.vtu")),
        table=LAYOUT.mesh("Solver", "volumes.tsv"),
        sidecar=LAYOUT.mesh("Solver", "volumes.json"),
        picture=LAYOUT.mesh("Solver", "slices.png"),
    log:
        LAYOUT.log("volumes", MESH),
    benchmark:
        took("volumes", MESH)
    priority: 2
    resources:
        **asked("volumes"),
    params:
        made_from=made_from("volumes"),
        version=versions("solver_files.volumes", "report.slices"),
        volumes=derived(lambda wildcards: dict(CASES[wildcards.case].volumes)),
        names_of_volumes=names_of("volumes"),
        paths=derived(SOURCES.volume_paths),
        input_sha256=lambda wildcards: content(SOURCES.volume_paths(wildcards)),
        fields=lambda wildcards: content(SOURCES.field_paths(wildcards)),  # which the mesh carries along
    script:
        "../scripts/volumes.py"


rule export:
    """The mesh as a solver reads it, with its sets and a sidecar, verified as written; refused when it is not certified."""
    input:
        mesh=mesh_with_volumes,
        made=LAST_REPORT,
        certificate=CERTIFICATE,
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        fields=by_content(existing_of(SOURCES.field_paths)),
    output:
        mesh=LAYOUT.mesh("{label}", "{suffix}"),
        sidecar=LAYOUT.mesh("{label}", "{suffix}.json"),
    log:
        LAYOUT.log("export", (*MESH, "label", "suffix")),
    benchmark:
        took("export", (*MESH, "label", "suffix"))
    priority: 2
    resources:
        **asked("export"),
    params:
        made_from=made_from("export"),
        certified_from=derived(JOBS.certified_from),
        arguments=lambda wildcards: CONFIG.export_arguments(EXPORTED[wildcards.suffix]),
        version=version_of("solver_files.export"),
        sets=lambda wildcards: CONFIG.export.sets(SOURCES.kind_of_surface(wildcards)),
        inner=names_of("inner"),
        given=derived(SOURCES.given_surfaces),
        age=lambda wildcards: CASES[wildcards.case].scan_age,
        volumes=derived(lambda wildcards: dict(CASES[wildcards.case].volumes)),
        names_of_volumes=names_of("volumes"),
        input_sha256=lambda wildcards: content(SOURCES.field_paths(wildcards)),
        paths=derived(SOURCES.field_paths),
    script:
        "../scripts/export.py"


if CONFIG.export.ten_nodes:

    rule ten_nodes:
        """The mesh with elements of ten nodes that follow the surface, for solvers; refused when it is not certified."""
        input:
            mesh=mesh_with_volumes,
            made=LAST_REPORT,
            certificate=CERTIFICATE,
            surface=INPUTS.meshed_surface,
            inner=INPUTS.inner_surfaces,
            fields=by_content(existing_of(SOURCES.field_paths)),
        output:
            LAYOUT.ten_node_files(CONFIG.export.ten_nodes),
        log:
            LAYOUT.log("ten_nodes", (*MESH, "label")),
        benchmark:
            took("ten_nodes", (*MESH, "label"))
        priority: 2
        resources:
            **asked("ten_nodes"),
        params:
            made_from=made_from("ten_nodes"),
            certified_from=derived(JOBS.certified_from),
            version=versions("solver_files.ten_nodes", "solver_files.export"),
            max_boundary_distance=CONFIG.certify.max_boundary_distance,
            sets=lambda wildcards: CONFIG.export.sets(SOURCES.kind_of_surface(wildcards)),
            volumes=derived(lambda wildcards: dict(CASES[wildcards.case].volumes)),
            names_of_volumes=names_of("volumes"),
            input_sha256=lambda wildcards: content(SOURCES.field_paths(wildcards)),
            paths=derived(SOURCES.field_paths),
        script:
            "../scripts/ten_nodes.py"


if CONFIG.export.uncertified:

    checkpoint verdict:
        """The verdict on a mesh, on which the names of its files for solvers depend where any mesh is exported."""
        input:
            LAYOUT.certificate,
        output:
            report=LAYOUT.log("verdict", MESH, kind="txt"),
        log:
            LAYOUT.log("verdict", MESH),
        localrule: True
        run:
            told = certificate_of(input[0]).get("verdict", "its certificate was edited")
            for file in (output.report, log[0]):
                Path(file).write_text(f"{told}\n", encoding="utf-8")
