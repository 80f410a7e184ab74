"""From the sheet's surface to the one that is meshed."""


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
        mem_mb=megabytes("phantom"),
        runtime=minutes("phantom"),
    params:
        arguments=partial(arguments_of, "phantom"),
        version=version_of("phantom"),
    script:
        "../scripts/phantom.py"


rule phantom_inner:
    """A synthetic white surface within the cortex."""
    input:
        surface=surface_file("phantom"),
    output:
        surface=inner_file("phantom"),
    log:
        inner_log("phantom_inner"),
    benchmark:
        inner_log("phantom_inner", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("phantom_inner"),
        runtime=minutes("phantom_inner"),
    params:
        arguments=partial(arguments_of, "phantom_inner"),
        version=version_of("phantom"),
    script:
        "../scripts/phantom_inner.py"


rule phantom_sphere:
    """The sphere that a synthetic cortex was made of."""
    output:
        sphere=surface_file("phantom", "sphere.surf.gii"),
    log:
        surface_log("phantom_sphere"),
    benchmark:
        surface_benchmark("phantom_sphere")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("phantom_sphere"),
        runtime=minutes("phantom_sphere"),
    params:
        arguments=partial(arguments_of, "phantom"),
        version=version_of("phantom"),
    script:
        "../scripts/phantom_sphere.py"


rule resample:
    """Put a surface that has a sphere onto the mesh that all cases share."""
    input:
        surface=surface_of,
        sphere=sphere_of,
        template=template_of,
    output:
        surface=surface_file("resampled"),
        report=surface_file("resampled", "white.json"),
    log:
        surface_log("resample"),
    benchmark:
        surface_benchmark("resample")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("resample"),
        runtime=minutes("resample"),
    params:
        arguments=partial(arguments_of, "resample"),
        source=lambda wildcards: str(CASES[wildcards.case].surface),
        to_mm=placement_of,
        paths=paths_of,
        version=version_of("stages.resample"),
        origin=partial(origin_of, STAGES["resample"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/resample.py"


rule repair:
    """Repair a broken surface within limits; one without a flaw stays as it is."""
    input:
        surface=first_surface,
    output:
        surface=surface_file("repaired"),
        report=surface_file("repaired", "white.json"),
    log:
        surface_log("repair"),
    benchmark:
        surface_benchmark("repair")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("repair"),
        runtime=minutes("repair"),
    params:
        arguments=partial(arguments_of, "repair"),
        to_mm=placement_after_resampling,
        paths=paths_of,
        version=version_of("stages.repair"),
        origin=partial(origin_of, STAGES["repair"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/repair.py"


rule gate:
    """Let a surface in that can be meshed, mended where it must be; refuse any other."""
    input:
        surface=surface_file("repaired") if REPAIRS else first_surface,
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
        mem_mb=megabytes("gate"),
        runtime=minutes("gate"),
    params:
        arguments=partial(arguments_of, "gate"),
        to_mm=None if REPAIRS else placement_after_resampling,
        paths=paths_of,
        version=version_of("stages.gate"),
        origin=partial(origin_of, STAGES["gate"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/gate.py"


rule fields:
    """The per-vertex fields of a case on the vertices that the gate let in; S1 does not depend on them."""
    input:
        surface=surface_of,
        fields=existing_fields_of,
        sphere=sphere_of,
        template=template_of,
    output:
        surface=surface_file("fields"),
    log:
        surface_log("fields"),
    benchmark:
        surface_benchmark("fields")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("fields"),
        runtime=minutes("fields"),
    params:
        arguments=partial(arguments_of, "gate"),
        repair=partial(arguments_of, "repair") if REPAIRS else None,
        resample=lambda wildcards: arguments_of("resample", wildcards) if is_resampled(wildcards) else None,
        to_mm=placement_of,
        version=[version_of("stages.gate"), version_of("stages.repair"), version_of("stages.resample")],
        input_sha256=lambda wildcards: content(all_paths_of(wildcards)),
        paths=all_paths_of,
        files=field_paths_of,
    script:
        "../scripts/fields.py"


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
        mem_mb=megabytes("smooth_surface"),
        runtime=minutes("smooth_surface"),
    params:
        arguments=partial(arguments_of, "smooth_surface"),
        version=version_of("stages.smooth_surface"),
        origin=partial(origin_of, STAGES["smooth_surface"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/smooth_surface.py"


rule resample_inner:
    """Put an inner surface onto the common mesh, where its triangles are those of the outer one."""
    input:
        surface=inner_source,
        sphere=sphere_of,
        template=template_of,
    output:
        surface=inner_file("resampled"),
        report=inner_file("resampled", "white.json"),
    log:
        inner_log("resample_inner"),
    benchmark:
        inner_log("resample_inner", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("resample_inner"),
        runtime=minutes("resample_inner"),
    params:
        arguments=lambda wildcards: {**arguments_of("resample", wildcards), "inside": True},
        source=lambda wildcards: str(CASES[wildcards.case].inner.get(wildcards.inner)),
        to_mm=placement_of,
        paths=paths_of,
        version=version_of("stages.resample"),
        origin=partial(origin_of, STAGES["resample"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/resample.py"


rule repair_inner:
    """Repair an inner surface, as the outer one."""
    input:
        surface=first_inner_surface,
    output:
        surface=inner_file("repaired"),
        report=inner_file("repaired", "white.json"),
    log:
        inner_log("repair_inner"),
    benchmark:
        inner_log("repair_inner", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("repair_inner"),
        runtime=minutes("repair_inner"),
    params:
        arguments=partial(arguments_of, "repair"),
        to_mm=placement_after_resampling,
        paths=paths_of,
        version=version_of("stages.repair"),
        origin=partial(origin_of, STAGES["repair"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/repair.py"


rule gate_inner:
    """Let an inner surface in, as the gate does the outer one; of any size."""
    input:
        surface=inner_file("repaired") if REPAIRS else first_inner_surface,
    output:
        surface=inner_file("gated"),
        report=inner_file("gated", "white.json"),
    log:
        inner_log("gate_inner"),
    benchmark:
        inner_log("gate_inner", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("gate_inner"),
        runtime=minutes("gate_inner"),
    params:
        arguments=lambda wildcards: {**arguments_of("gate", wildcards), "inside": True},
        to_mm=None if REPAIRS else placement_after_resampling,
        paths=paths_of,
        version=version_of("stages.gate"),
        origin=partial(origin_of, STAGES["gate"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/gate.py"


rule smooth_inner:
    """Smooth an inner surface, as the outer one."""
    input:
        surface=inner_file("gated"),
    output:
        surface=inner_file("smoothed"),
        report=inner_file("smoothed", "white.json"),
    log:
        inner_log("smooth_inner"),
    benchmark:
        inner_log("smooth_inner", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("smooth_inner"),
        runtime=minutes("smooth_inner"),
    params:
        arguments=partial(arguments_of, "smooth_surface"),
        version=version_of("stages.smooth_surface"),
        origin=partial(origin_of, STAGES["smooth_surface"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/smooth_surface.py"


rule separate:
    """Move inner surfaces away from the one around them; the output is one of them, the report is about all."""
    input:
        surface=meshed_surface,
        inner=inner_before_separating,
    output:
        surface=INNER_SURFACE,
        report=inner_file("separated", "white.json", res="{res}um"),
    log:
        inner_log("separate"),
    benchmark:
        inner_log("separate", "tsv")
    conda:
        "../envs/cortet.yaml"
    resources:
        mem_mb=megabytes("separate"),
        runtime=minutes("separate"),
    params:
        arguments=partial(arguments_of, "separate"),
        version=version_of("stages.separate"),
        origin=partial(origin_of, STAGES["separate"].label),
        input_sha256=input_sha256_of,
        space=space_of,
    script:
        "../scripts/separate.py"
