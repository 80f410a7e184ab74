"""The `cortet` command. Each subcommand imports the heavy modules that it needs."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from cortet.cli import meshes, meshing, runs, surfaces
from cortet.cli.values import WRITTEN, CheckedOutput, FolderOfFiles, Number, OutputFile
from cortet.errors import CortetError, InputError
from cortet.formats.ownership import guarded
from cortet.neighbours import neighbours
from cortet.version import __version__

__all__ = ["Number", "main", "parser"]


def parser() -> argparse.ArgumentParser:
    """The parser of the command; each module beside this one adds its subcommands, as neighbours do."""
    top = argparse.ArgumentParser(prog="cortet", description="Certified tetrahedral meshes of cortical surfaces.")
    top.add_argument("--version", action="version", version=f"cortet {__version__}")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    for module in (meshing, surfaces, meshes):
        module.add_commands(commands)
    for neighbour in neighbours():
        neighbour.add_commands(commands)
    runs.add_commands(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0: done and well, 1: refused, not certified or failed, 2: wrong usage."""
    args = parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s %(message)s", level=logging.INFO if args.verbose else logging.WARNING)
    try:
        _refuse_repeated(args)
        with _guarded(args):
            code = int(args.run(args))
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of our output, `head` perhaps, has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the last flush has no error
        return 141  # the exit code of a program that SIGPIPE ends
    except CortetError as error:
        print(f"cortet: {error}", file=sys.stderr)
        return 1
    except OSError as error:  # no space left, no permission
        print(f"cortet: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("cortet: there is not enough memory for this (use a larger machine or cell size)", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("cortet: interrupted", file=sys.stderr)
        return 130


def _refuse_repeated(args: argparse.Namespace) -> None:
    """Raise InputError where an option that may be repeated has the same name, or age, twice."""
    for option, form in (
        ("inner", "NAME=FILE"),
        ("field", "NAME=FILE"),
        ("volume", "NAME=FILE"),
        ("real", "WEEKS=FILE"),
        ("material", "SET=SHEAR"),
        ("size", "WHERE=MM"),
    ):
        names = [name for name, _ in getattr(args, option, [])]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise InputError(f"--{option} names {twice} twice", remedy=f"give each its own: {form}")


def _guarded(args: argparse.Namespace) -> contextlib.AbstractContextManager[None]:
    """The guard of a command, from the types of its arguments."""
    from cortet.formats.volumes import is_volume, volume_file

    values = [one for value in vars(args).values() for one in (value if isinstance(value, list) else [value])]
    pairs = [value for value in values if isinstance(value, tuple)]
    named = [last for _, last in pairs if isinstance(last, str)]  # NAME=FILE
    named += [first for first, last in pairs if not isinstance(last, str) and is_volume(first)]  # VOLUME=MM
    named += [value for value in values if isinstance(value, str) and is_volume(value)]
    paths = [*values, *(Path(volume_file(name)) for name in named)]
    return guarded(
        [path for path in paths if isinstance(path, Path) and not isinstance(path, WRITTEN)],
        files=[path for path in paths if isinstance(path, OutputFile)],
        shared=[path for path in paths if isinstance(path, FolderOfFiles)],
        folders=[path for path in paths if isinstance(path, CheckedOutput)],
        force=getattr(args, "force", False),
    )
