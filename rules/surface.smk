"""From the sheet's surfaces to those that are meshed. Each stage takes an inner surface by a rule of the same template."""


rule phantom:
    """A synthetic cortex of the case's age."""
    input:
        receipt=receipt("phantom"),
    output:
        surface=LAYOUT.surface("phantom"),
    log:
        LAYOUT.log("phantom", SURFACE),
    benchmark:
        took("phantom", SURFACE)
    resources:
        **asked("phantom"),
    params:
        arguments=partial(PLAN.arguments, "phantom"),
        version=version_of("phantoms"),
    script:
        "../scripts/phantom.py"


rule phantom_inner:
    """A synthetic white surface within the cortex."""
    input:
        receipt=receipt("phantom_inner"),
        surface=LAYOUT.surface("phantom"),
    output:
        surface=LAYOUT.surface("phantom", inner=True),
    log:
        LAYOUT.log("phantom_inner", INNER),
    benchmark:
        took("phantom_inner", INNER)
    resources:
        **asked("phantom_inner"),
    params:
        arguments=partial(PLAN.arguments, "phantom_inner"),
        version=version_of("phantoms"),
    script:
        "../scripts/phantom_inner.py"


rule phantom_sphere:
    """The sphere that a synthetic cortex was made of."""
    input:
        receipt=receipt("phantom_sphere"),
    output:
        sphere=LAYOUT.surface("phantom", "sphere.surf.gii"),
    log:
        LAYOUT.log("phantom_sphere", SURFACE),
    benchmark:
        took("phantom_sphere", SURFACE)
    resources:
        **asked("phantom_sphere"),
    params:
        arguments=partial(PLAN.arguments, "phantom"),
        version=version_of("phantoms"),
    script:
        "../scripts/phantom_sphere.py"


rule fields:
    """The per-vertex fields of a case on the vertices that the gate let in; S1 does not depend on them."""
    input:
        receipt=receipt("fields"),
        surface=PLAN.surface,
        fields=PLAN.existing_fields,
        sphere=PLAN.sphere,
        template=PLAN.template,
    output:
        surface=LAYOUT.surface("fields"),
    log:
        LAYOUT.log("fields", SURFACE),
    benchmark:
        took("fields", SURFACE)
    resources:
        **asked("fields"),
    params:
        arguments=partial(PLAN.arguments, "gate"),
        repair=partial(PLAN.arguments, "repair") if CONFIG.enabled("repair") else None,
        resample=lambda wildcards: PLAN.arguments("resample", wildcards) if PLAN.is_resampled(wildcards) else None,
        to_mm=PLAN.placement,
        version=versions("stages.gate", "stages.repair", "stages.resample"),
        input_sha256=lambda wildcards: content(PLAN.all_paths(wildcards)),
        paths=PLAN.all_paths,
        files=PLAN.field_paths,
    script:
        "../scripts/fields.py"


for inner in (False, True):
    of_inner = "_inner" if inner else ""

    rule:
        """Put a surface that has a sphere onto the mesh that all cases share."""
        name:
            f"resample{of_inner}"
        input:
            receipt=receipt(f"resample{of_inner}"),
            surface=PLAN.inner_source if inner else PLAN.surface,
            sphere=PLAN.sphere,
            template=PLAN.template,
        output:
            surface=LAYOUT.surface("resampled", inner=inner),
            report=LAYOUT.surface("resampled", "white.json", inner=inner),
        log:
            LAYOUT.log(f"resample{of_inner}", INNER if inner else SURFACE),
        benchmark:
            took(f"resample{of_inner}", INNER if inner else SURFACE)
        resources:
            **asked(f"resample{of_inner}"),
        params:
            **recorded("resample"),
            arguments=partial(PLAN.arguments, "resample"),
            source=PLAN.source,
            to_mm=PLAN.placement,
            hemi=PLAN.hemisphere,
            version=version_of("stages.resample"),
            paths=PLAN.paths,
        script:
            "../scripts/resample.py"

    rule:
        """Repair a broken surface within limits; one without a flaw stays as it is."""
        name:
            f"repair{of_inner}"
        input:
            receipt=receipt(f"repair{of_inner}"),
            surface=PLAN.first_surface,
        output:
            surface=LAYOUT.surface("repaired", inner=inner),
            report=LAYOUT.surface("repaired", "white.json", inner=inner),
        log:
            LAYOUT.log(f"repair{of_inner}", INNER if inner else SURFACE),
        benchmark:
            took(f"repair{of_inner}", INNER if inner else SURFACE)
        resources:
            **asked(f"repair{of_inner}"),
        params:
            **recorded("repair"),
            arguments=partial(PLAN.arguments, "repair"),
            to_mm=PLAN.placement_after_resampling,
            hemi=PLAN.hemisphere,
            version=version_of("stages.repair"),
            paths=PLAN.paths,
        script:
            "../scripts/repair.py"

    rule:
        """Let a surface in that can be meshed, mended where it must be; refuse any other."""
        name:
            f"gate{of_inner}"
        input:
            receipt=receipt(f"gate{of_inner}"),
            surface=LAYOUT.surface("repaired", inner=inner) if CONFIG.enabled("repair") else PLAN.first_surface,
        output:
            surface=LAYOUT.surface("gated", inner=inner),
            report=LAYOUT.surface("gated", "white.json", inner=inner),
        log:
            LAYOUT.log(f"gate{of_inner}", INNER if inner else SURFACE),
        benchmark:
            took(f"gate{of_inner}", INNER if inner else SURFACE)
        resources:
            **asked(f"gate{of_inner}"),
        params:
            **recorded("gate"),
            arguments=partial(PLAN.arguments, "gate"),
            to_mm=None if CONFIG.enabled("repair") else PLAN.placement_after_resampling,
            hemi=PLAN.hemisphere,
            version=version_of("stages.gate"),
            paths=PLAN.paths,
        script:
            "../scripts/gate.py"

    rule:
        """Smooth a surface as much as it asks for and its limits allow."""
        name:
            f"smooth_surface{of_inner}"
        input:
            receipt=receipt(f"smooth_surface{of_inner}"),
            surface=LAYOUT.surface("gated", inner=inner),
        output:
            surface=LAYOUT.surface("smoothed", inner=inner),
            report=LAYOUT.surface("smoothed", "white.json", inner=inner),
        log:
            LAYOUT.log(f"smooth_surface{of_inner}", INNER if inner else SURFACE),
        benchmark:
            took(f"smooth_surface{of_inner}", INNER if inner else SURFACE)
        resources:
            **asked(f"smooth_surface{of_inner}"),
        params:
            **recorded("smooth_surface"),
            arguments=partial(PLAN.arguments, "smooth_surface"),
            version=version_of("stages.smooth_surface"),
        script:
            "../scripts/smooth_surface.py"


rule separate:
    """Move inner surfaces away from the one around them; the output is one of them, the report is about all."""
    input:
        receipt=receipt("separate"),
        surface=PLAN.meshed_surface,
        inner=PLAN.inner_before_separating,
    output:
        surface=LAYOUT.separated,
        report=LAYOUT.surface("separated", "white.json", inner=True, res="{res}um"),
    log:
        LAYOUT.log("separate", (*INNER, "res")),
    benchmark:
        took("separate", (*INNER, "res"))
    resources:
        **asked("separate"),
    params:
        **recorded("separate"),
        arguments=partial(PLAN.arguments, "separate"),
        version=version_of("stages.separate"),
    script:
        "../scripts/separate.py"
