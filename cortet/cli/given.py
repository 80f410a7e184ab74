"""What commands are given: configuration, surfaces, meshes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.errors import InputError
from cortet.formats import format_of

if TYPE_CHECKING:
    from cortet.config import Config
    from cortet.meshes import TetMesh, TriSurface


def config_of(args: argparse.Namespace) -> Config:
    """The configuration of a file, with the options of the command on top."""
    from cortet.config import load

    return load(settings_of(args))


def settings_of(args: argparse.Namespace) -> dict[str, Any]:
    """The sections of a configuration file, with the options of the command on top."""
    from cortet.config import load, read

    data: dict[str, Any] = {}
    if args.config:
        load(args.config)  # complaints name the file
        data = read(args.config)
    if args.setting:
        data["setting"] = args.setting
    if args.cell_size is not None:
        data["generate"] = {**(data.get("generate") or {}), "cell_size": args.cell_size}
    return data


def surface_of(args: argparse.Namespace, config: Config) -> TriSurface:
    """The surface that a command is given, with its inner ones and fields, in mm."""
    from cortet.formats.gifti import read_surface
    from cortet.geometry.nesting import nested
    from cortet.solver_files.fields import with_fields

    finite = not config.enabled("repair")
    surface = with_fields(read_surface(args.surface, finite=finite), dict(args.field))
    return nested(surface, _inner_surfaces(dict(args.inner), finite=finite))


def sphere_of(args: argparse.Namespace) -> TriSurface | None:
    """The sphere that a command is given; None where it is given none."""
    from cortet.formats.gifti import read_surface

    return read_surface(args.sphere) if args.sphere else None


def _inner_surfaces(files: Mapping[str, str], *, finite: bool = True) -> dict[str, TriSurface]:
    from cortet.formats.gifti import read_surface

    return {name: read_surface(file, finite=finite) for name, file in files.items()}


def stem_of(path: Path) -> str:
    """The name of a file without its last ending: what its companions are named by."""
    return path.name.removesuffix(path.suffix)


def read_mesh(path: Path) -> TetMesh:
    """A mesh of any format; an InputError for a file that holds a surface."""
    form = format_of(path)
    if form.is_surface:
        raise InputError("holds a surface, not a mesh", file=path)
    return form.read(path)


def draw(mesh: TetMesh, path: Path, place: Callable[[Path], Path] = lambda path: path) -> None:
    """Draw a mesh, cut open, into a picture."""
    from cortet.report.render import picture

    picture(mesh, place(path))
    print(f"{path}: drawn")
