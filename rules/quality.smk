"""Measure, certify, export."""

CERTIFICATE = mesh_file("Solver", "certificate.json")
SOLVER_FILES = [
    mesh_file("Solver", f"tetmesh{SUFFIXES[name]}") for name in CONFIG.export.formats
]


def solver_files():
    return [path for pattern in SOLVER_FILES for path in each_case(pattern).values()]


def quality_records():
    measured = [
        STAGES[stage] for stage in CONFIG.quality.stages if CONFIG.enabled(stage)
    ]
    return [
        path
        for desc in measured
        for path in each_case(mesh_file(desc, "quality.json")).values()
    ]


rule quality:
    """Element quality of the mesh of any stage."""
    input:
        mesh=mesh_file("{stage}"),
    output:
        record=mesh_file("{stage}", "quality.json"),
    log:
        mesh_log("quality", desc="{stage}"),
    benchmark:
        mesh_benchmark("quality", desc="{stage}")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes(1000),
        runtime=minutes(5),
    params:
        stage=CONFIG.stage("quality"),
    script:
        "../scripts/quality.py"


rule certify:
    """Verdict on the last mesh, with every number beside its limit."""
    input:
        mesh=mesh_file("Solver"),
        surface=MESHED_SURFACE,
        source=surface_of,
        reports=[
            surface_file("gated", "white.json"),
            *(
                [surface_file("smoothed", "white.json")]
                if CONFIG.enabled("smooth_surface")
                else []
            ),
            *(
                mesh_file(desc, "tetmesh.json")
                for stage, desc in STAGES.items()
                if CONFIG.enabled(stage)
            ),
        ],
    output:
        certificate=CERTIFICATE,
    log:
        mesh_log("certify"),
    benchmark:
        mesh_benchmark("certify")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes(1500),
        runtime=minutes(5),
    params:
        stage=CONFIG.stage("certify"),
    script:
        "../scripts/certify.py"


rule export:
    """The mesh as a solver reads it, verified as written; refused for a mesh that is not certified."""
    input:
        mesh=mesh_file("Solver"),
        certificate=CERTIFICATE,
    output:
        mesh=mesh_file("Solver", "tetmesh.{suffix}"),
    log:
        mesh_log("export", desc="{suffix}"),
    benchmark:
        mesh_benchmark("export", desc="{suffix}")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes(1000),
        runtime=minutes(5),
    params:
        stage=CONFIG.stage("export"),
    script:
        "../scripts/export.py"
