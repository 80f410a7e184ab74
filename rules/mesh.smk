"""S1 to S6: from the surface to the mesh in the order its solver wants.

Each stage measures the mesh that it made, while it has it in memory. What is farther down the line has a higher priority,
here and in the files that follow: the first cases are done while the last ones wait.
"""


rule generate:
    """S1: fill the surface with tetrahedra."""
    input:
        receipt=receipt("generate"),
        surface=PLAN.meshed_surface,
        inner=PLAN.inner_surfaces,
        fields=PLAN.size_field,
    output:
        mesh=intermediate(LAYOUT.mesh("Generated")),
        report=LAYOUT.mesh("Generated", "tetmesh.json"),
        quality=LAYOUT.mesh("Generated", "quality.json"),
    log:
        LAYOUT.log("generate", of_mesh("generate")),
    benchmark:
        took("generate", of_mesh("generate"))
    wildcard_constraints:
        mesher="|".join({*CONFIG.generate.meshers, *OWN}),
    priority: 1
    resources:
        **asked("generate"),
    params:
        **recorded("generate"),
        arguments=partial(PLAN.arguments, "generate"),
        version=versions("stages.generate", "measure.quality"),
    script:
        "../scripts/generate.py"


rule transfer:
    """S2: carry the fields of the surface to the nodes; on request write the mesh for openCARP and meshtool."""
    input:
        receipt=receipt("transfer"),
        mesh=PLAN.mesh_before("transfer"),
        surface=PLAN.meshed_surface,
        inner=PLAN.inner_surfaces,
        fields=PLAN.fields,
    output:
        mesh=intermediate(LAYOUT.mesh("Transferred")),
        report=LAYOUT.mesh("Transferred", "tetmesh.json"),
        quality=LAYOUT.mesh("Transferred", "quality.json"),
        carp=(
            intermediate(multiext(LAYOUT.mesh("Transferred", "tetmesh"), ".pts", ".elem", ".lon"))
            if CONFIG.write_carp
            else []
        ),
    log:
        LAYOUT.log("transfer", of_mesh("transfer")),
    benchmark:
        took("transfer", of_mesh("transfer"))
    priority: 1
    resources:
        **asked("transfer"),
    params:
        **recorded("transfer"),
        arguments=partial(PLAN.arguments, "transfer"),
        version=versions("stages.transfer", "measure.quality"),
    script:
        "../scripts/transfer.py"


# S3 to S6: each a rule of its own, which makes a mesh out of the one before it
for stage in (STAGES[name] for name in LABELS if name not in ("generate", "transfer")):
    is_last = stage.name == "solver_ready"

    rule:
        """A mesh out of the one before it, and with it the fields at the end of the line."""
        name:
            stage.name
        input:
            receipt=receipt(stage.name),
            mesh=PLAN.mesh_before(stage.name),
            surface=PLAN.meshed_surface if "surface" in stage.takes else [],
            inner=PLAN.inner_surfaces if "surface" in stage.takes else [],
            fields=PLAN.fields if is_last else [],
        output:
            mesh=LAYOUT.mesh(stage.label) if is_last else intermediate(LAYOUT.mesh(stage.label)),
            report=LAYOUT.mesh(stage.label, "tetmesh.json"),
            quality=LAYOUT.mesh(stage.label, "quality.json"),
        log:
            LAYOUT.log(stage.name, of_mesh(stage.name)),
        benchmark:
            took(stage.name, of_mesh(stage.name))
        priority: 1
        resources:
            **asked(stage.name),
        params:
            **recorded(stage.name),
            arguments=partial(PLAN.arguments, stage.name),
            version=versions(f"stages.{stage.name}", "measure.quality"),
        script:
            "../scripts/mesh_stage.py"
