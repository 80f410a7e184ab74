"""What commands share: groups of options, and how a command is added."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from cortet.cli.values import CellSize, InputFile, Setting, number

SURFACES = Group("Surfaces", sort_key=1)
MESHES = Group("Meshes", sort_key=2)
GROWTH = Group("Growth and folding", sort_key=3)
COHORTS = Group("Cohorts", sort_key=4)
OTHERS = Group("Others", sort_key=5)
HELP = Group("Help", sort_key=6)


def add(app: App, group: Group, *commands: Callable[..., int], name: str | None = None) -> None:
    """Add functions as commands; the example in the docstring of each ends its help."""
    for command in commands:
        _, _, example = (inspect.getdoc(command) or "").partition("Examples\n--------\n")
        end = f"Example:\n{textwrap.indent(example, '  ')}" if example else None
        app.command(command, name=name, group=group, help_epilogue=end)


@Parameter(name="*")
@dataclass(frozen=True)
class Common:
    """Options of every command.

    Parameters
    ----------
    verbose
        Print more messages.
    """

    verbose: Annotated[bool, Parameter(alias="-v")] = False


@Parameter(name="*")
@dataclass(frozen=True)
class Writes(Common):
    """Options of commands that write files.

    Parameters
    ----------
    force
        Replace existing files of any origin, but never an input.
    """

    force: bool = False


@Parameter(name="*")
@dataclass(frozen=True)
class Configured:
    """What a configuration is made of.

    Parameters
    ----------
    config
        YAML file of parameters; see `cortet config`.
    setting
        Preset: cortet's method, the paper's mesher with cortet's stages, or the paper's method.
    cell_size
        Cell size h (default: 0.6, or that of --config).
    """

    config: InputFile | None = None
    setting: Setting | None = None
    cell_size: CellSize | None = None

    def settings(
        self,
        sizes: Iterable[tuple[str, float]] = (),
        layers: Sequence[float] | None = None,
    ) -> dict[str, Any]:
        """The sections of the file; options of the command take precedence."""
        from cortet.api.given import sections as sections_of

        data = sections_of(self.config, self.cell_size)
        if self.setting:
            data["setting"] = self.setting
        if sizes:
            data = with_keys(data, "generate", sizes=dict(sizes))
        if layers is not None:
            data = with_keys(data, "export", layers=list(layers))
        return data


def with_keys(data: Mapping[str, Any], section: str, **keys: Any) -> dict[str, Any]:
    """Sections of a configuration, one of them with further keys."""
    return {**data, section: {**(data.get(section) or {}), **keys}}


@Parameter(name="*")
@dataclass(frozen=True)
class Limits:
    """Limits by which a mesh is checked.

    Parameters
    ----------
    q_max
        Limit of the worst q (default: 0.6).
    max_boundary_distance
        Limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit).
    """

    q_max: Annotated[float | None, number(0, 1, "Q")] = None
    max_boundary_distance: Annotated[float | None, number(0, 1000, "MM", endless=True)] = None
    cell_size: Annotated[
        CellSize | None,
        Parameter(
            help="Cell size h, which scales the limits on distances; inner surfaces are first moved apart as for "
            "meshing (default: not known, no limit on distances)."
        ),
    ] = None

    def settings(self) -> dict[str, Any]:
        """The section of the configuration with those that were given."""
        given = {"q_max": self.q_max, "max_boundary_distance": self.max_boundary_distance}
        return {"certify": {key: None if value == inf else value for key, value in given.items() if value is not None}}
