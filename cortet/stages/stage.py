"""What a stage is: a function of one shape, `(State, Config, About) -> (State, report)`, and what it depends on.

It is called the same way in memory (`cortet.pipeline`) and in a job of the workflow (`scripts/_job.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import BaseModel

from cortet.config.section import Section
from cortet.config.stages import Config
from cortet.meshers import MESHERS
from cortet.meshes import TetMesh, TriSurface
from cortet.version import version_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

#: plain, JSON-able values by name
Values = dict[str, object]


def _no_mesh() -> TetMesh:
    return TetMesh(np.empty((0, 3)), np.empty((0, 4), np.int32))


@dataclass(frozen=True)
class State:
    """What goes through the line; a stage returns a new one."""

    #: the surface to be meshed, in its present state, with its inner surfaces
    surface: TriSurface
    #: of the surface, which is then put onto the common mesh
    sphere: TriSurface | None = None
    #: without elements before S1
    mesh: TetMesh = field(default_factory=_no_mesh)

    def with_surface(self, surface: TriSurface, report: DataclassInstance) -> Result:
        """The state after a stage that made a surface, with its report."""
        return replace(self, surface=surface), report

    def with_mesh(self, mesh: TetMesh, report: DataclassInstance) -> Result:
        """The same of one that made a mesh."""
        return replace(self, mesh=mesh), report


class About(BaseModel, frozen=True, extra="forbid"):
    """What is known of a surface or mesh beside the configuration."""

    #: mm
    cell_size: float | None = None
    mesher: str | None = None
    #: weeks; without it the published smoothing, whose strength depends on it, is left out
    gestational_age: float | None = None
    #: L or R; None: a whole brain, or not known
    hemi: str | None = None
    #: factor that has brought the coordinates to mm, if the user has stated their unit
    to_mm: float | None = None
    #: whether the surface lies inside another one
    inside: bool = False
    #: location and radius, mm, of each contact of an electrode around which cells become smaller
    contacts: tuple[tuple[float, float, float, float], ...] = ()
    #: files of the surface and of its sphere, which messages and reports name
    source: str | None = None
    sphere_file: str | None = None
    #: name of each inner surface -> its file, or its name again
    inner: dict[str, str] = {}

    def of_inner(self, name: str) -> About:
        """The same of an inner surface."""
        return self.model_copy(update={"source": self.inner[name], "inside": True, "inner": {}})


#: nothing is known
UNKNOWN = About()
#: what `About` says of files: their content decides what a stage makes, not their names
LOCATIONS = {"source", "sphere_file", "inner"}

#: a new state, and a report
Result = tuple[State, "DataclassInstance"]


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage of the line."""

    #: name of its module and of its rule
    name: str
    #: what it does, as worded on pages
    does: str
    #: its result in file names: `desc-<label>` of a surface, `desc-<mesher><setting><label>` of a mesh
    label: str
    function: Callable[[State, Config, About], Result]
    gives: Literal["surface", "mesh"]
    #: its section of the configuration, if it is not its own; it then runs even if that is off
    section: str = ""
    #: what it reads of other sections, `section.key`; it sees nothing else of the configuration
    settings: tuple[str, ...] = ()
    #: likewise, where there are inner surfaces
    settings_of_nested: tuple[str, ...] = ()
    #: what it reads of `About`, besides names of files
    about: tuple[str, ...] = ()
    #: number in the paper's line, where it has one
    number: str = ""
    #: whether it runs only where there are inner surfaces, or a sphere
    nested: bool = False
    registered: bool = False
    #: whether it takes each surface by itself, inner ones too
    each_surface: bool = False
    #: whether the result is the same in every setting of the configuration, so that all of them share it
    shared_by_settings: bool = False

    @property
    def wildcards(self) -> tuple[str, ...]:
        """What its jobs differ by, besides case and region."""
        if self.gives == "surface":
            return ("res",) if self.nested else ()
        return ("res", "mesher") if self.shared_by_settings else ("res", "mesher", "setting")

    def section_of(self, config: Config) -> Section:
        """Its section of a configuration."""
        section: Section = getattr(config, self.section or self.name)
        return section

    def is_on(self, config: Config, *, aged: bool = True) -> bool:
        """Whether the configuration asks for it."""
        return bool(self.section) or self.section_of(config).runs(aged=aged)

    def settings_of(self, config: Config, about: About) -> dict[str, Values]:
        """What it reads of a configuration: section -> key -> plain value."""
        ignored = MESHERS[about.mesher].ignores if self.name == "generate" and about.mesher else ()
        own = {key: value for key, value in self.section_of(config).values().items() if key not in ignored}
        found: dict[str, Values] = {self.section or self.name: own}
        for name in (*self.settings, *(self.settings_of_nested if about.inner else ())):
            section, key = name.split(".")
            found[section] = {key: getattr(getattr(config, section), key)}
        return found

    def about_of(self, about: About) -> About:
        """What it reads of what is known, with the names of files."""
        return About.model_validate(about.model_dump(include={*self.about, "inside", *LOCATIONS}))

    def record(self, config: Config, about: About) -> Values:
        """All that it depends on, and the version of its code, as certificates record it."""
        read: Values = {"version": version_of(f"stages.{self.name}")}
        for values in self.settings_of(config, about).values():
            read |= values
        return read | about.model_dump(include={*self.about})

    def run(self, state: State, config: Config, about: About) -> tuple[State, Values]:
        """Take a state through it; returns also its report, with those on inner surfaces as `inner`.

        Raises
        ------
        InputError : it refuses the surface
        StageError : it failed
        """
        read = Config.model_validate(self.settings_of(config, about))
        made, found = self.function(state, read, self.about_of(about))
        report: Values = asdict(found)
        if self.each_surface and made.surface.inner:
            from cortet.geometry.nesting import nested  # loads Numba

            within, reports = {}, {}
            for name, one in made.surface.inner.items():
                through, reports[name] = self.run(replace(state, surface=one), config, about.of_inner(name))
                within[name] = through.surface
            made, report["inner"] = replace(made, surface=nested(made.surface, within)), reports
        return made, report
