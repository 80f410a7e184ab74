"""S1 to S6: from the surface to the mesh in the order its solver wants.

Each stage measures the mesh that it made, while it has it in memory.
"""


rule generate:
    """S1: fill the surface with tetrahedra."""
    input:
        surface=PLAN.meshed_surface,
        inner=PLAN.inner_surfaces,
        fields=PLAN.size_field,
    output:
        mesh=intermediate(LAYOUT.mesh("Generated")),
        report=LAYOUT.mesh("Generated", "tetmesh.json"),
        quality=LAYOUT.mesh("Generated", "quality.json"),
    wildcard_constraints:
        mesher="|".join({*CONFIG.generate.meshers, *OWN}),
    params:
        **recorded("generate"),
        arguments=partial(PLAN.arguments, "generate"),
        version=versions("stages.generate", "measure.quality"),
    script:
        "../scripts/generate.py"


rule transfer:
    """S2: carry the fields of the surface to the nodes; on request write the mesh for openCARP and meshtool."""
    input:
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
            mesh=PLAN.mesh_before(stage.name),
            surface=PLAN.meshed_surface if "surface" in stage.takes else [],
            inner=PLAN.inner_surfaces if "surface" in stage.takes else [],
            fields=PLAN.fields if is_last else [],
        output:
            mesh=LAYOUT.mesh(stage.label) if is_last else intermediate(LAYOUT.mesh(stage.label)),
            report=LAYOUT.mesh(stage.label, "tetmesh.json"),
            quality=LAYOUT.mesh(stage.label, "quality.json"),
        params:
            **recorded(stage.name),
            arguments=partial(PLAN.arguments, stage.name),
            version=versions(f"stages.{stage.name}", "measure.quality"),
        script:
            "../scripts/mesh_stage.py"
