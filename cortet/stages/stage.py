"""What a stage of the line declares, once, in its module: everything that others need to know about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from cortet.meshes import TetMesh, TriSurface
from cortet.sections import Cost, Section

#: content of a certificate.json
Certificate = Mapping[str, Any]


@dataclass(frozen=True)
class Step:
    """A function with a section in the configuration: a stage, or what the workflow does before and after the line."""

    #: module of the function below `cortet`, which declares its VERSION
    module: str
    #: name of its section in the configuration
    section: str
    #: keys of the section that are its arguments; None: all but those that choose what is run
    keys: frozenset[str] | None = None
    #: arguments that differ from mesh to mesh and are in no section
    facts: tuple[str, ...] = ()

    def arguments(self, config: Any, facts: Mapping[str, Any]) -> dict[str, Any]:
        """Plain arguments of the function, from a configuration and what is known about the mesh."""
        section: Section = getattr(config, self.section)
        included = None if self.keys is None else set(self.keys)
        values = section.model_dump(mode="json", include=included, exclude=set(section.choices))
        return {**values, **section.decided(config, facts), **{name: facts[name] for name in self.facts}}


def _nothing_said(_: Sequence[Certificate]) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage: `cortet.stages.<name>.<name>(*takes, parameters, **facts)` returns what it gives and a report."""

    #: name of its module, its function, its rule and its section of the configuration
    name: str
    #: rank in the line: stages run in ascending order
    order: int
    #: what it does, as worded on pages
    does: str
    #: its result in file names: `desc-<label>` of a surface, `desc-<mesher><setting><label>` of a mesh
    label: str
    #: what its function takes before its parameters
    takes: tuple[Literal["surface", "sphere", "mesh"], ...]
    gives: Literal["surface", "mesh"]
    cost: Cost
    #: its parameters, with the only record of their defaults and limits; stages may share one
    parameters: type[Section]
    #: name of its section, if that is not its own name
    section: str = ""
    #: keyword arguments of its function that differ from mesh to mesh and are in no section
    facts: tuple[str, ...] = ()
    #: what the methods paragraph of a paper says about it, from the certificates; "" if it did nothing
    sentence: Callable[[Sequence[Certificate]], str] = _nothing_said
    #: number in the paper's line, where it has one
    number: str = ""
    #: whether it has something to do only where there are inner surfaces
    nested: bool = False
    #: whether it has something to do only where the surface has a sphere
    registered: bool = False
    #: whether it takes every surface by itself, inner ones too
    alone: bool = False
    #: whether its function takes `inside=True` for an inner surface
    takes_inside: bool = False
    #: whether the result is the same in every setting of the configuration, so that all of them share it
    shared_by_settings: bool = False

    @property
    def step(self) -> Step:
        """Where its arguments come from."""
        return Step(f"stages.{self.name}", self.section or self.name, facts=self.facts)

    @property
    def function(self) -> Callable[..., tuple[Any, Any]]:
        """The stage's function."""
        function: Callable[..., tuple[Any, Any]] = getattr(import_module(f"cortet.stages.{self.name}"), self.name)
        return function

    def run(self, *given: TriSurface | TetMesh, **arguments: Any) -> tuple[Any, Any]:
        """Call its function with plain arguments, as `Config.arguments` gives them."""
        settings, facts = self.parameters.split(arguments)
        return self.function(*given, settings, **facts)


#: words of the methods paragraph for what boundary nodes did
BOUNDARY_WORDS = {
    "fixed": "boundary nodes fixed",
    "free": "boundary nodes free",
    "slide": "boundary nodes sliding on the surface",
}


def parameters_of(stage: str, certificates: Sequence[Certificate]) -> list[Mapping[str, Any]]:
    """The parameters of a stage in those certificates whose mesh went through it."""
    return [content["parameters"][stage] for content in certificates if content["parameters"].get(stage)]


def counted(count: int, noun: str) -> str:
    """A number and its noun, in the plural unless the number is one: ``3 meshes``."""
    plural = f"{noun}es" if noun.endswith(("h", "ss")) else f"{noun}s"
    return f"{count} {noun if count == 1 else plural}"
