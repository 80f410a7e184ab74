"""The line of stages: what each is called, what it depends on, and in which order they run.

A stage calls a pure function on arrays, `cortet.stages.<name>.<name>`. Every job of the workflow loads this list, so a
stage loads its module when it runs.
"""

from __future__ import annotations

import shutil
from dataclasses import replace

from cortet.config.stages import Config
from cortet.errors import InputError
from cortet.meshers import MESHERS
from cortet.meshers.cgal import installed_backend
from cortet.stages.stage import About, Result, Stage, State, Values
from cortet.version import version_of


def _resample(state: State, config: Config, about: About) -> Result:
    from cortet.stages.resample import resample

    assert state.sphere is not None  # `registered`
    template = config.resample.template_of(about.hemi)
    return state.with_surface(
        *resample(
            state.surface,
            state.sphere,
            config.resample.with_keys(template=template),
            sphere_file=about.sphere_file,
            inside=about.inside,
        )
    )


def _repair(state: State, config: Config, about: About) -> Result:
    from cortet.stages.repair import repair, repaired_before

    allowed = config.gate.allow_genus
    made, report = repair(state.surface, config.repair, source=about.source, allow_genus=allowed)
    return state.with_surface(made, report if report.repaired else repaired_before(about.source) or report)


def _gate(state: State, config: Config, about: About) -> Result:
    from cortet.stages.gate import gate

    return state.with_surface(
        *gate(
            state.surface,
            config.gate,
            source=about.source,
            inside=about.inside,
            gestational_age=about.gestational_age,
            hemi=about.hemi,
            to_mm=about.to_mm,
        )
    )


def _smooth_surface(state: State, config: Config, about: About) -> Result:
    from cortet.stages.smooth_surface import smooth_surface

    return state.with_surface(
        *smooth_surface(state.surface, config.smooth_surface, gestational_age=about.gestational_age)
    )


def _separate(state: State, config: Config, about: About) -> Result:
    from cortet.stages.separate import separate

    assert about.cell_size is not None
    try:
        made, report = separate(state.surface, config.regions, cell_size=about.cell_size)
    except InputError as error:
        compared = " and ".join([about.source, *about.inner.values()]) if about.source else None
        raise InputError(error.what, file=error.file or compared, remedy=error.remedy) from error
    return replace(state, surface=made), report


def _generate(state: State, config: Config, about: About) -> Result:
    from cortet.stages.generate import generate

    return state.with_mesh(
        *generate(
            state.surface,
            config.generate,
            cell_size=about.cell_size,
            mesher=about.mesher,
            elements_across=config.regions.elements_across,
            contacts=about.contacts,
        )
    )


def _transfer(state: State, config: Config, _: About) -> Result:
    from cortet.stages.transfer import transfer

    return state.with_mesh(*transfer(state.mesh, state.surface, config.transfer))


def _relocate(state: State, config: Config, _: About) -> Result:
    from cortet.stages.relocate import relocate

    return state.with_mesh(*relocate(state.mesh, config.relocate))


def _clean(state: State, config: Config, about: About) -> Result:
    from cortet.stages.clean import clean

    return state.with_mesh(*clean(state.mesh, state.surface, config.clean, cell_size=about.cell_size))


def _reconnect(state: State, config: Config, about: About) -> Result:
    from cortet.stages.reconnect import reconnect

    return state.with_mesh(*reconnect(state.mesh, state.surface, config.reconnect, cell_size=about.cell_size))


def _smooth_boundary(state: State, config: Config, _: About) -> Result:
    from cortet.stages.smooth_boundary import smooth_boundary

    return state.with_mesh(*smooth_boundary(state.mesh, state.surface, config.smooth_boundary))


def _snap(state: State, config: Config, _: About) -> Result:
    from cortet.stages.snap import snap

    return state.with_mesh(*snap(state.mesh, state.surface, config.snap))


def _solver_ready(state: State, config: Config, _: About) -> Result:
    from cortet.stages.solver_ready import solver_ready

    return state.with_mesh(*solver_ready(state.mesh, state.surface, config.transfer))


#: in the order in which they run
LINE = (
    Stage(
        name="resample",
        does="puts the surface onto the common mesh",
        label="resampled",
        function=_resample,
        gives="surface",
        about=("hemi",),
        registered=True,
        each_surface=True,
    ),
    Stage(
        name="repair",
        does="repairs what is broken",
        label="repaired",
        function=_repair,
        gives="surface",
        settings=("gate.allow_genus",),
        each_surface=True,
    ),
    Stage(
        name="gate",
        does="checks that the surface can be meshed",
        label="gated",
        function=_gate,
        gives="surface",
        about=("gestational_age", "hemi", "to_mm"),
        each_surface=True,
    ),
    Stage(
        name="smooth_surface",
        does="smooths the surface according to its roughness",
        label="smoothed",
        function=_smooth_surface,
        gives="surface",
        about=("gestational_age",),
        each_surface=True,
    ),
    Stage(
        name="separate",
        does="moves inner surfaces away from the one around them",
        label="separated",
        function=_separate,
        gives="surface",
        section="regions",
        about=("cell_size",),
        nested=True,
    ),
    Stage(
        name="generate",
        does="fills the surface with tetrahedra",
        label="Generated",
        function=_generate,
        gives="mesh",
        settings_of_nested=("regions.elements_across",),
        about=("cell_size", "mesher", "contacts"),
        number="S1",
        shared_by_settings=True,
    ),
    Stage(
        name="transfer",
        does="carries fields to the mesh",
        label="Transferred",
        function=_transfer,
        gives="mesh",
        number="S2",
        shared_by_settings=True,
    ),
    Stage(
        name="relocate",
        does="moves interior nodes",
        label="Relocated",
        function=_relocate,
        gives="mesh",
        number="S3",
    ),
    Stage(
        name="clean",
        does="moves vertices until the worst elements are good",
        label="Cleaned",
        function=_clean,
        gives="mesh",
        about=("cell_size",),
        number="S4",
    ),
    Stage(
        name="reconnect",
        does="reconnects elements that moving cannot improve",
        label="Reconnected",
        function=_reconnect,
        gives="mesh",
        about=("cell_size",),
        number="S4+",
    ),
    Stage(
        name="smooth_boundary",
        does="smooths the boundary",
        label="BoundarySmoothed",
        function=_smooth_boundary,
        gives="mesh",
    ),
    Stage(
        name="snap",
        does="puts the boundary onto the surface",
        label="Snapped",
        function=_snap,
        gives="mesh",
        number="S6",
    ),
    Stage(
        name="solver_ready",
        does="orders nodes and elements",
        label="Ordered",
        function=_solver_ready,
        gives="mesh",
        section="transfer",  # it carries the fields onto the final positions, as S2 onto the first ones
        number="S5",
    ),
)
STAGES = {stage.name: stage for stage in LINE}
MESH_STAGES = {stage.name: stage for stage in LINE if stage.gives == "mesh"}


def stages_of(config: Config, *, nested: bool = False, registered: bool = False, aged: bool = True) -> list[Stage]:
    """The stages that run, in order.

    Parameters
    ----------
    nested : whether the surface has inner ones
    registered : whether it has a sphere
    aged : whether its gestational age is known
    """
    return [
        stage
        for stage in LINE
        if stage.is_on(config, aged=aged) and (nested or not stage.nested) and (registered or not stage.registered)
    ]


def settled(config: Config) -> Config:
    """The configuration with what this machine decides: the package that runs CGAL, one for all meshes of a cohort."""
    if config.generate.backend != "auto":
        return config
    generate = config.generate.model_copy(update={"backend": installed_backend()})
    return config.model_copy(update={"generate": generate})


def certify_record(config: Config, cell_size: float | None) -> Values:
    """The limits of the certificate of a mesh and the version of its code, as certificates record them."""
    layers = {} if config.export.layers is None else {"layers": config.export.layers}
    return {**config.certify.values(), "cell_size": cell_size, **layers, "version": version_of("measure.certify")}


def require_programs(config: Config) -> None:
    """Raise InputError if the line calls meshtool, which is not installed."""
    if config.clean.enabled and config.clean.backend == "meshtool" and shutil.which("meshtool") is None:
        remedy = "add it to the PATH, or set clean.backend: cortet"
        raise InputError("the program meshtool is not installed", remedy=remedy)


def require_nesting(config: Config) -> None:
    """Raise InputError if a mesher or a stage of the line knows no inner surfaces."""
    meshers, smoothing = config.generate.meshers, config.smooth_boundary
    # Gmsh is given the boundary only; a boundary that may leave its surface leaves the interfaces, too
    unable = {
        f"generate.meshers: {', '.join(meshers)}": not all(MESHERS[name].regions for name in meshers),
        "relocate.enabled: true": config.relocate.enabled,
        "clean.boundary: free": config.clean.enabled and config.clean.boundary == "free",
        "reconnect.boundary: free": config.reconnect.enabled and config.reconnect.boundary == "free",
        "smooth_boundary.onto_surface: false": smoothing.enabled and not smoothing.onto_surface,
    }
    if key := next((key for key, is_set in unable.items() if is_set), None):
        raise InputError(
            f"{key} does not support inner surfaces", remedy="use the setting `default` for cases with inner surfaces"
        )


def notices(config: Config) -> list[str]:
    """What a user should know before the line runs, in plain words."""
    said = (MESHERS[name].notice(config.generate) for name in config.generate.meshers)
    return [notice for notice in said if notice]
