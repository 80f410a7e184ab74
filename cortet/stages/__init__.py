"""The line of stages: what each is called, what it takes and gives, and in which order they run.

The function of a stage is `cortet.stages.<name>.<name>`, and its parameters are a section of the configuration. Every
job of the workflow loads this list, so it imports no stage: a module loads when its stage runs.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from cortet.config import stages as sections
from cortet.config.section import Section
from cortet.errors import InputError
from cortet.meshers import MESHERS
from cortet.meshers.cgal import installed_backend
from cortet.meshes import TetMesh, TriSurface
from cortet.version import version_of

if TYPE_CHECKING:
    from cortet.config import Config


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage: `cortet.stages.<name>.<name>(*takes, settings, **facts)` returns what it gives and a report."""

    #: name of its module, its function and its rule
    name: str
    #: what it does, as worded on pages
    does: str
    #: its result in file names: `desc-<label>` of a surface, `desc-<mesher><setting><label>` of a mesh
    label: str
    #: what its function takes before its settings
    takes: tuple[Literal["surface", "sphere", "mesh"], ...]
    gives: Literal["surface", "mesh"]
    #: its parameters, the class of a section of the configuration
    settings: type[Section]
    #: name of that section, if it is not its own; the stage then runs even if the section is off
    section: str = ""
    #: keyword arguments of its function that differ from mesh to mesh and are in no section
    facts: tuple[str, ...] = ()
    #: number in the paper's line, where it has one
    number: str = ""
    #: whether it has something to do only where there are inner surfaces
    nested: bool = False
    #: whether it takes every surface by itself, inner ones too
    alone: bool = False
    #: whether its function takes `inside=True` for an inner surface
    takes_inside: bool = False
    #: whether the result is the same in every setting of the configuration, so that all of them share it
    shared_by_settings: bool = False

    def section_of(self, config: Config) -> Section:
        """Its section of a configuration."""
        section: Section = getattr(config, self.section or self.name)
        return section

    def run(self, *given: TriSurface | TetMesh, **arguments: Any) -> tuple[Any, Any]:
        """Call its function with plain arguments, as `arguments_of` gives them."""
        function = getattr(import_module(f"cortet.stages.{self.name}"), self.name)
        settings, facts = self.settings.split(arguments)
        result: tuple[Any, Any] = function(*given, settings, **facts)
        return result


#: in the order in which they run
LINE = (
    Stage(
        name="resample",
        does="puts the surface onto the common mesh",
        label="resampled",
        takes=("surface", "sphere"),
        gives="surface",
        settings=sections.Resample,
        facts=("sphere_file",),
        alone=True,
        takes_inside=True,
    ),
    Stage(
        name="repair",
        does="repairs what is broken",
        label="repaired",
        takes=("surface",),
        gives="surface",
        settings=sections.Repair,
        facts=("source",),
        alone=True,
    ),
    Stage(
        name="gate",
        does="checks that the surface can be meshed",
        label="gated",
        takes=("surface",),
        gives="surface",
        settings=sections.Gate,
        facts=("source", "gestational_age", "hemi"),
        alone=True,
        takes_inside=True,
    ),
    Stage(
        name="smooth_surface",
        does="smooths the surface according to its roughness",
        label="smoothed",
        takes=("surface",),
        gives="surface",
        settings=sections.SmoothSurface,
        facts=("gestational_age",),
        alone=True,
    ),
    Stage(
        name="separate",
        does="moves inner surfaces away from the one around them",
        label="separated",
        takes=("surface",),
        gives="surface",
        settings=sections.Regions,
        section="regions",
        facts=("cell_size",),
        nested=True,
    ),
    Stage(
        name="generate",
        does="fills the surface with tetrahedra",
        label="Generated",
        takes=("surface",),
        gives="mesh",
        settings=sections.Generate,
        number="S1",
        facts=("cell_size", "mesher"),
        shared_by_settings=True,
    ),
    Stage(
        name="transfer",
        does="carries fields to the mesh",
        label="Transferred",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.Transfer,
        number="S2",
        shared_by_settings=True,
    ),
    Stage(
        name="relocate",
        does="moves interior nodes",
        label="Relocated",
        takes=("mesh",),
        gives="mesh",
        settings=sections.Relocate,
        number="S3",
    ),
    Stage(
        name="clean",
        does="moves vertices until the worst elements are good",
        label="Cleaned",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.Clean,
        number="S4",
        facts=("cell_size",),
    ),
    Stage(
        name="reconnect",
        does="reconnects elements that moving cannot improve",
        label="Reconnected",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.Reconnect,
        number="S4+",
        facts=("cell_size",),
    ),
    Stage(
        name="smooth_boundary",
        does="smooths the boundary",
        label="BoundarySmoothed",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.SmoothBoundary,
    ),
    Stage(
        name="snap",
        does="puts the boundary onto the surface",
        label="Snapped",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.Snap,
        number="S6",
    ),
    Stage(
        name="solver_ready",
        does="orders nodes and elements",
        label="Solver",
        takes=("mesh", "surface"),
        gives="mesh",
        settings=sections.Transfer,
        number="S5",
        section="transfer",  # it carries the fields onto the final positions, as S2 onto the first ones
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
        if (stage.section or stage.section_of(config).runs(aged=aged))
        and (nested or not stage.nested)
        and (registered or "sphere" not in stage.takes)
    ]


def arguments_of(config: Config, stage: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Plain, JSON-able arguments of a stage.

    Parameters
    ----------
    stage : a key of `STAGES`
    facts : what is known of the surface or mesh: the facts that the stage declares, and for some `hemisphere`, `nested`
    """
    one = STAGES[stage]
    own = {name: facts[name] for name in one.facts}
    found = {**one.section_of(config).values(), **_decided_elsewhere(config, stage, facts), **own}
    ignored = MESHERS[facts["mesher"]].ignores if stage == "generate" else ()
    return {key: value for key, value in found.items() if key not in ignored}


def _decided_elsewhere(config: Config, stage: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of a stage that another section, the case or this machine decides."""
    if stage == "resample":
        return {"template": config.resample.template_of(facts["hemisphere"])}
    if stage == "repair":
        return {"allow_genus": config.gate.allow_genus}
    if stage == "gate" and facts.get("placement"):
        return {"to_mm": facts["placement"]}
    if stage == "generate":
        # one package for all meshes of a cohort; cells across the cortex only where there is an inner surface
        backend = {"backend": installed_backend()} if config.generate.backend == "auto" else {}
        return backend | ({"elements_across": config.regions.elements_across} if facts.get("nested") else {})
    return {}


def record_of(config: Config, stage: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a stage and the version of its code, as certificates record them."""
    return {**arguments_of(config, stage, facts), "version": version_of(f"stages.{stage}")}


def certify_record(config: Config, cell_size: float) -> dict[str, Any]:
    """The limits of the certificate of a mesh and the version of its code, likewise."""
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
