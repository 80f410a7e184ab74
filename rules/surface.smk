"""From the sheet's surface to the one that is meshed."""


def surface_of(wildcards):
    """Surface of the case; nothing when it is missing, so that the gate refuses this case and the others go on."""
    case = CASES[wildcards.case]
    if case.is_phantom:
        return surface_file("phantom")
    return str(case.surface) if case.surface.exists() else []


rule phantom:
    """A synthetic cortex of the case's age."""
    output:
        surface=surface_file("phantom"),
    log:
        surface_log("phantom"),
    benchmark:
        surface_benchmark("phantom")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        stage=lambda wildcards: CONFIG.stage(
            "phantom",
            gestational_age=CASES[wildcards.case].scan_age,
            hemisphere=CASES[wildcards.case].hemi,
        ),
    script:
        "../scripts/phantom.py"


rule gate:
    """Let a surface in that can be meshed, mended where it must be; refuse any other."""
    input:
        surface=surface_of,
    output:
        surface=surface_file("gated"),
        report=surface_file("gated", "white.json"),
    log:
        surface_log("gate"),
    benchmark:
        surface_benchmark("gate")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        stage=lambda wildcards: CONFIG.stage(
            "gate", source=str(CASES[wildcards.case].surface)
        ),
    script:
        "../scripts/gate.py"


rule smooth_surface:
    """Smooth the surface as much as its age asks for and its limits allow."""
    input:
        surface=surface_file("gated"),
    output:
        surface=surface_file("smoothed"),
        report=surface_file("smoothed", "white.json"),
    log:
        surface_log("smooth_surface"),
    benchmark:
        surface_benchmark("smooth_surface")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        stage=lambda wildcards: CONFIG.stage(
            "smooth_surface", gestational_age=CASES[wildcards.case].scan_age
        ),
    script:
        "../scripts/smooth_surface.py"
