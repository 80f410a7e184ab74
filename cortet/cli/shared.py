"""What commands share: groups of options, and how a command is added."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from cortet.cli.values import CellSize, InputFile, Setting

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
        Preset: default is cortet's method, folding the same with cells for folds, cgal the paper's mesher with
        cortet's stages, published the paper's method.
    cell_size
        Cell size h (default: that of --config, or 0.6; of a mesh file, that of the mesh if it is known).
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

        data = sections_of(self.config)
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
