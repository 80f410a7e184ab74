"""S1 to S6: from the surface to the mesh in the order its solver wants.

Each stage measures the mesh that it made, while it has it in memory.
"""


rule generate:
    """S1: fill the surface with tetrahedra."""
    input:
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        fields=size_field_of,
    output:
        mesh=intermediate(mesh_file("Generated")),
        report=mesh_file("Generated", "tetmesh.json"),
        quality=mesh_file("Generated", "quality.json"),
    log:
        mesh_log("generate"),
    benchmark:
        mesh_benchmark("generate")
    wildcard_constraints:
        mesher="|".join({*CONFIG.generate.meshers, *MESHERS}),
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("generate"),
        runtime=minutes("generate"),
    params:
        arguments=partial(arguments_of, "generate"),
        version=[version_of("stages.generate"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["generate"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/generate.py"


rule transfer:
    """S2: carry the fields of the surface to the nodes; write the mesh for openCARP and meshtool."""
    input:
        mesh=mesh_before("transfer"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        fields=fields_of,
    output:
        mesh=intermediate(mesh_file("Transferred")),
        report=mesh_file("Transferred", "tetmesh.json"),
        quality=mesh_file("Transferred", "quality.json"),
        carp=intermediate(multiext(mesh_file("Transferred", "tetmesh"), ".pts", ".elem", ".lon")),
    log:
        mesh_log("transfer"),
    benchmark:
        mesh_benchmark("transfer")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("transfer"),
        runtime=minutes("transfer"),
    params:
        arguments=partial(arguments_of, "transfer"),
        version=[version_of("stages.transfer"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["transfer"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/transfer.py"


rule relocate:
    """S3: move nodes to better places (Gmsh)."""
    input:
        mesh=mesh_before("relocate"),
    output:
        mesh=intermediate(mesh_file("Relocated")),
        report=mesh_file("Relocated", "tetmesh.json"),
        quality=mesh_file("Relocated", "quality.json"),
    log:
        mesh_log("relocate"),
    benchmark:
        mesh_benchmark("relocate")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("relocate"),
        runtime=minutes("relocate"),
    params:
        arguments=partial(arguments_of, "relocate"),
        version=[version_of("stages.relocate"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["relocate"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"


rule clean:
    """S4: move vertices until the worst tetrahedra are good."""
    input:
        mesh=mesh_before("clean"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
    output:
        mesh=intermediate(mesh_file("Cleaned")),
        report=mesh_file("Cleaned", "tetmesh.json"),
        quality=mesh_file("Cleaned", "quality.json"),
    log:
        mesh_log("clean"),
    benchmark:
        mesh_benchmark("clean")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("clean"),
        runtime=minutes("clean"),
    params:
        arguments=partial(arguments_of, "clean"),
        version=[version_of("stages.clean"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["clean"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"


rule reconnect:
    """S4+: reconnect tetrahedra that moving vertices cannot improve."""
    input:
        mesh=mesh_before("reconnect"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
    output:
        mesh=intermediate(mesh_file("Reconnected")),
        report=mesh_file("Reconnected", "tetmesh.json"),
        quality=mesh_file("Reconnected", "quality.json"),
    log:
        mesh_log("reconnect"),
    benchmark:
        mesh_benchmark("reconnect")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("reconnect"),
        runtime=minutes("reconnect"),
    params:
        arguments=partial(arguments_of, "reconnect"),
        version=[version_of("stages.reconnect"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["reconnect"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"


rule smooth_boundary:
    """Smooth the boundary, which the elements below follow, and clean these again."""
    input:
        mesh=mesh_before("smooth_boundary"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
    output:
        mesh=intermediate(mesh_file("BoundarySmoothed")),
        report=mesh_file("BoundarySmoothed", "tetmesh.json"),
        quality=mesh_file("BoundarySmoothed", "quality.json"),
    log:
        mesh_log("smooth_boundary"),
    benchmark:
        mesh_benchmark("smooth_boundary")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("smooth_boundary"),
        runtime=minutes("smooth_boundary"),
    params:
        arguments=partial(arguments_of, "smooth_boundary"),
        version=[version_of("stages.smooth_boundary"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["smooth_boundary"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"


rule snap:
    """S6: put the boundary back onto the surface."""
    input:
        mesh=mesh_before("snap"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
    output:
        mesh=intermediate(mesh_file("Snapped")),
        report=mesh_file("Snapped", "tetmesh.json"),
        quality=mesh_file("Snapped", "quality.json"),
    log:
        mesh_log("snap"),
    benchmark:
        mesh_benchmark("snap")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("snap"),
        runtime=minutes("snap"),
    params:
        arguments=partial(arguments_of, "snap"),
        version=[version_of("stages.snap"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["snap"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"


rule solver_ready:
    """S5: order nodes and elements as solvers want them; carry the fields onto the final positions."""
    input:
        mesh=mesh_before("solver_ready"),
        surface=meshed_surface,
        inner=inner_of(INNER_SURFACE),
        fields=fields_of,
    output:
        mesh=mesh_file("Solver"),
        report=mesh_file("Solver", "tetmesh.json"),
        quality=mesh_file("Solver", "quality.json"),
    log:
        mesh_log("solver_ready"),
    benchmark:
        mesh_benchmark("solver_ready")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("solver_ready"),
        runtime=minutes("solver_ready"),
    params:
        arguments=partial(arguments_of, "solver_ready"),
        version=[version_of("stages.solver_ready"), version_of("measure.quality")],
        origin=partial(origin_of, LABELS["solver_ready"]),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/mesh_stage.py"
