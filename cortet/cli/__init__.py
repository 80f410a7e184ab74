"""The `cortet` command: each command is a function, and its parameters are the arguments and options.

A command imports what is heavy only when it runs.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from cyclopts import App, CycloptsError, MissingArgumentError, Parameter, UnusedCliTokensError
from cyclopts.help import DefaultFormatter, PanelSpec
from rich.box import Box

from cortet.cli import folding, meshes, meshing, runs, surfaces
from cortet.cli.shared import HELP
from cortet.cli.values import WRITTEN, CheckedOutput, FolderOfFiles, OutputFile
from cortet.errors import CortetError, UsageError
from cortet.formats.ownership import guarded
from cortet.version import __version__

__all__ = ["app", "commands", "main"]

#: the last of an option given twice counts; what looks like JSON is the name of a file
_OPTIONS = Parameter(negative=(), show_default=False, allow_repeating=True, json_list=False, json_dict=False)
_PLAIN = DefaultFormatter(panel_spec=PanelSpec(box=Box("    \n" * 8), padding=0))


def app() -> App:
    """The command; each module beside this one adds commands."""
    top = App(
        name="cortet",
        help="Certified tetrahedral meshes of cortical surfaces.",
        version=f"cortet {__version__}",
        default_parameter=_OPTIONS,
        group_commands=HELP,
        help_format="plaintext",
        help_formatter=_PLAIN,
    )
    for module in (meshing, surfaces, meshes, runs, folding):
        module.add_commands(top)
    top.register_install_completion_command(help="Install shell completion for commands and options.")
    return top


def commands(of: App | None = None, words: str = "cortet") -> Iterator[tuple[str, App]]:
    """Every command that does something, with its words."""
    for name, one in (of or app()).resolved_commands().items():
        if name.startswith("-"):
            continue
        if one.default_command:
            yield f"{words} {name}", one
        else:
            yield from commands(one, f"{words} {name}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0: done and well, 1: refused, not certified or failed, 2: wrong usage, often by SystemExit."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may hold what the terminal cannot show
    try:
        command, bound = _parsed(sys.argv[1:] if arguments is None else list(arguments))
        given = _given(bound) if command.__module__.startswith("cortet.") else {}  # what is the library's: help
        level = logging.INFO if given.get("verbose") else logging.WARNING
        logging.basicConfig(format="%(levelname)s %(message)s", level=level)
        with _guarded(given):
            code = int(command(*bound.args, **bound.kwargs) or 0)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of our output, `head` perhaps, has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the last flush has no error
        return 141  # the exit code of a program that SIGPIPE ends
    except CortetError as error:
        print(f"cortet: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:  # no space left, no permission
        print(f"cortet: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("cortet: there is not enough memory for this (use a larger machine or cell size)", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("cortet: stopped by you", file=sys.stderr)
        return 130


def _parsed(words: list[str]) -> tuple[Any, inspect.BoundArguments]:
    """The function of a command and its arguments. Wrong usage is said in one line, and ends with 2."""
    top = app()
    try:
        command, bound, _ = top.parse_args(words, print_error=False, exit_on_error=False)
    except CycloptsError as error:
        raise _usage(["cortet", *(error.command_chain or ())], _complaint(error)) from None
    if command == top.help_print and not {"--help", "-h"} & set(words):
        raise _usage(["cortet", *words], "name a command")
    return command, bound


def _complaint(error: CycloptsError) -> str:
    """What is wrong with the words of a command."""
    name = error.argument.name if error.argument else ""
    if isinstance(error, MissingArgumentError):
        return f"{error.keyword} lacks a value" if error.keyword else f"{name} is missing"
    if isinstance(error, UnusedCliTokensError):
        return f"too many arguments: {' '.join(error.unused_tokens or ())}"
    return str(error).partition(" Available commands")[0].rstrip(".")


def _usage(command: list[str], complaint: str) -> SystemExit:
    """Print the error, and end the program with the exit code of wrong usage."""
    name = " ".join(command)
    print(f"{name}: {complaint} (usage: {name} --help)", file=sys.stderr)
    return SystemExit(2)


def _given(bound: inspect.BoundArguments) -> dict[str, Any]:
    """The arguments of a command by name, those within groups of options, too."""
    given: dict[str, Any] = {}
    for name, value in bound.arguments.items():
        given |= vars(value) if is_dataclass(value) else {name: value}
    return given


def _guarded(given: dict[str, Any]) -> contextlib.AbstractContextManager[None]:
    """The guard of a command, from the types of its arguments; any text may name an input."""
    if not given:
        return contextlib.nullcontext()
    from cortet.formats.volumes import volume_file

    single = list(_single(list(given.values())))
    named = [Path(volume_file(value)) for value in single if isinstance(value, str)]
    return guarded(
        [*named, *(value for value in single if isinstance(value, Path) and not isinstance(value, WRITTEN))],
        files=[value for value in single if isinstance(value, OutputFile)],
        shared=[value for value in single if isinstance(value, FolderOfFiles)],
        folders=[value for value in single if isinstance(value, CheckedOutput)],
        force=bool(given.get("force")),
    )


def _single(value: object) -> Iterator[object]:
    """The single values within lists and pairs."""
    if isinstance(value, (list, tuple)):
        for one in value:
            yield from _single(one)
    else:
        yield value
