"""From the sheet's surfaces to those that are meshed; inner surfaces take the same stages."""


rule phantom:
    """A synthetic cortex of the case's age, and the sphere that it is made of."""
    output:
        surface=LAYOUT.surface("phantom"),
        sphere=LAYOUT.surface("phantom", "sphere.surf.gii"),
    log:
        LAYOUT.log("phantom", CASE),
    benchmark:
        took("phantom", CASE)
    resources:
        **asked("phantom"),
    params:
        made_from=made_from("phantom"),
        arguments=JOBS.phantom_arguments,
        version=version_of("phantoms"),
    script:
        "../scripts/phantom.py"


rule phantom_inner:
    """A synthetic white surface within the cortex."""
    input:
        surface=LAYOUT.surface("phantom"),
    output:
        surface=LAYOUT.each_surface("phantom"),
    log:
        LAYOUT.log("phantom_inner", SURFACE),
    benchmark:
        took("phantom_inner", SURFACE)
    wildcard_constraints:
        region="_inner-white",
    resources:
        **asked("phantom_inner"),
    params:
        made_from=made_from("phantom_inner"),
        arguments={"thickness": CONFIG.phantom.thickness},
        version=version_of("phantoms"),
    script:
        "../scripts/phantom_inner.py"


rule fields:
    """The per-vertex fields of a case on the vertices that the gate let in; S1 does not depend on them."""
    input:
        surface=by_content(SOURCES.surface),
        fields=by_content(existing_of(SOURCES.field_paths)),
        sphere=by_content(SOURCES.sphere),
        template=by_content(SOURCES.template),
    output:
        surface=LAYOUT.surface("fields"),
    log:
        LAYOUT.log("fields", CASE),
    benchmark:
        took("fields", CASE)
    resources:
        **asked("fields"),
    params:
        made_from=made_from("fields"),
        steps=derived(partial(JOBS.steps, ("resample", "repair", "gate"))),
        stages=partial(JOBS.made_from, "gate"),
        to_mm=SOURCES.placement,
        input_sha256=lambda wildcards: content(SOURCES.all_paths(wildcards)),
        paths=derived(SOURCES.all_paths),
        files=derived(SOURCES.field_paths),
    script:
        "../scripts/surface.py"


rule resample:
    """Put a surface that has a sphere onto the mesh that all cases share."""
    input:
        surface=by_content(SOURCES.surface),
        sphere=by_content(SOURCES.sphere),
        template=by_content(SOURCES.template),
    output:
        **surface_of("resampled"),
    log:
        LAYOUT.log("resample", SURFACE),
    benchmark:
        took("resample", SURFACE)
    resources:
        **asked("resample"),
    params:
        **stage_params("resample"),
        column=derived(SOURCES.column),
        to_mm=SOURCES.placement,
        hemi=hemisphere,
    script:
        "../scripts/surface.py"


rule gate:
    """Repair a surface where there is one right answer, and let it in if it can be meshed; refuse any other."""
    input:
        surface=by_content(INPUTS.first_surface),
    output:
        **surface_of("gated"),
        repair=LAYOUT.each_surface("repaired", "white.json") if CONFIG.enabled("repair") else [],
    log:
        LAYOUT.log("gate", SURFACE),
    benchmark:
        took("gate", SURFACE)
    resources:
        **asked("gate"),
    params:
        **stage_params("repair", "gate"),
        column=derived(SOURCES.column),
        to_mm=lambda wildcards: None if SOURCES.is_resampled(wildcards) else SOURCES.placement(wildcards),
        hemi=hemisphere,
    script:
        "../scripts/surface.py"


rule smooth_surface:
    """Smooth a surface as much as it asks for and its limits allow."""
    input:
        surface=LAYOUT.each_surface("gated"),
    output:
        **surface_of("smoothed"),
    log:
        LAYOUT.log("smooth_surface", SURFACE),
    benchmark:
        took("smooth_surface", SURFACE)
    resources:
        **asked("smooth_surface"),
    params:
        **stage_params("smooth_surface"),
    script:
        "../scripts/surface.py"


rule separate:
    """Move inner surfaces away from the one around them; the output is one of them, the report is about all."""
    input:
        surface=INPUTS.meshed_surface,
        inner=INPUTS.inner_before_separating,
    output:
        surface=LAYOUT.separated(),
        report=LAYOUT.separated("white.json"),
    log:
        LAYOUT.log("separate", (*SURFACE, "res")),
    benchmark:
        took("separate", (*SURFACE, "res"))
    resources:
        **asked("separate"),
    params:
        **stage_params("separate"),
        inner=derived(inner_of),
    script:
        "../scripts/separate.py"
