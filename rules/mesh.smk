"""S1 to S6: from the surface to the mesh in the order its solver wants.

Each stage measures the mesh that it made, while it has it in memory. What is farther down the line has a higher priority,
here and in the files that follow: the first cases are done while the last ones wait.
"""


rule generate:
    """S1: fill the surface with tetrahedra."""
    input:
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        fields=INPUTS.fields if CONFIG.generate.size_field else [],  # other fields do not make S1 run again
        electrodes=by_content(existing_of(SOURCES.electrode_paths)),
    output:
        **mesh_of("generate"),
    log:
        LAYOUT.log("generate", SHARED_MESH),
    benchmark:
        took("generate", SHARED_MESH)
    wildcard_constraints:
        mesher="|".join({*CONFIG.generate.meshers, *OWN}),
    priority: 1
    resources:
        **asked("generate"),
    params:
        **stage_params("generate"),
        paths=derived(SOURCES.electrode_paths),
        to_mm=derived(SOURCES.placement),
    script:
        "../scripts/mesh_stage.py"


rule transfer:
    """S2: carry the fields of the surface to the nodes, and write the mesh for openCARP and meshtool."""
    input:
        mesh=partial(INPUTS.mesh_before, "transfer"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        fields=INPUTS.fields,
    output:
        **mesh_of("transfer"),
        carp=intermediate(multiext(LAYOUT.mesh("Transferred", "tetmesh"), ".pts", ".elem", ".lon")),
    log:
        LAYOUT.log("transfer", SHARED_MESH),
    benchmark:
        took("transfer", SHARED_MESH)
    priority: 1
    resources:
        **asked("transfer"),
    params:
        **stage_params("transfer"),
        names_of_fields=names_of("fields"),
    script:
        "../scripts/mesh_stage.py"


rule relocate:
    """S3: Gmsh moves interior nodes, so that elements get better on average."""
    input:
        mesh=partial(INPUTS.mesh_before, "relocate"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
    output:
        **mesh_of("relocate"),
    log:
        LAYOUT.log("relocate", MESH),
    benchmark:
        took("relocate", MESH)
    priority: 1
    resources:
        **asked("relocate"),
    params:
        **stage_params("relocate"),
    script:
        "../scripts/mesh_stage.py"


rule clean:
    """S4: move vertices until the worst elements are good."""
    input:
        mesh=partial(INPUTS.mesh_before, "clean"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
    output:
        **mesh_of("clean"),
    log:
        LAYOUT.log("clean", MESH),
    benchmark:
        took("clean", MESH)
    priority: 1
    resources:
        **asked("clean"),
    params:
        **stage_params("clean"),
    script:
        "../scripts/mesh_stage.py"


rule reconnect:
    """S4+: swap faces and edges of elements that moving cannot improve."""
    input:
        mesh=partial(INPUTS.mesh_before, "reconnect"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
    output:
        **mesh_of("reconnect"),
    log:
        LAYOUT.log("reconnect", MESH),
    benchmark:
        took("reconnect", MESH)
    priority: 1
    resources:
        **asked("reconnect"),
    params:
        **stage_params("reconnect"),
    script:
        "../scripts/mesh_stage.py"


rule smooth_boundary:
    """Smooth the boundary, as the published chain does."""
    input:
        mesh=partial(INPUTS.mesh_before, "smooth_boundary"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
    output:
        **mesh_of("smooth_boundary"),
    log:
        LAYOUT.log("smooth_boundary", MESH),
    benchmark:
        took("smooth_boundary", MESH)
    priority: 1
    resources:
        **asked("smooth_boundary"),
    params:
        **stage_params("smooth_boundary"),
    script:
        "../scripts/mesh_stage.py"


rule snap:
    """S6: put the boundary onto the surface."""
    input:
        mesh=partial(INPUTS.mesh_before, "snap"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
    output:
        **mesh_of("snap"),
    log:
        LAYOUT.log("snap", MESH),
    benchmark:
        took("snap", MESH)
    priority: 1
    resources:
        **asked("snap"),
    params:
        **stage_params("snap"),
    script:
        "../scripts/mesh_stage.py"


rule solver_ready:
    """S5: order nodes and elements as solvers want them, bring the fields of the surface along, and certify the mesh.

    A mesh that is not certified is a result, not a failure.
    """
    input:
        mesh=partial(INPUTS.mesh_before, "solver_ready"),
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_surfaces,
        fields=INPUTS.fields,
        source=by_content(SOURCES.surface),
        electrodes=by_content(existing_of(SOURCES.electrode_paths)),
        gated=LAYOUT.surface("gated"),
        reports=lambda wildcards: [one.path for one in JOBS.reports(wildcards)[:-1]],  # the last one is its own
    output:
        **mesh_of("solver_ready"),
        certificate=LAYOUT.certificate,
    log:
        LAYOUT.log("solver_ready", MESH),
    benchmark:
        took("solver_ready", MESH)
    priority: 1
    resources:
        **asked("solver_ready"),
    params:
        **stage_params("solver_ready"),
        names_of_fields=names_of("fields"),
        limits=lambda wildcards: INPUTS.setting(wildcards).certify.values(),
        layers=CONFIG.export.layers,
        paths=derived(SOURCES.electrode_paths),
        line=JOBS.recorded_line,
        of_reports=derived(JOBS.of_reports),
        to_mm=SOURCES.placement,
        inner=names_of("inner"),
    script:
        "../scripts/solver_ready.py"
