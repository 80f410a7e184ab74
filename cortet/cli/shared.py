"""Options that several commands share."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cortet.cli.values import Number, inner_file
from cortet.geometry.limits import CELL_SIZE_MM

if TYPE_CHECKING:
    #: the subparsers to which each module adds its commands
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]


def common() -> argparse.ArgumentParser:
    """Options of every command."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    return own


def writes() -> argparse.ArgumentParser:
    """Options of commands that write files."""
    own = argparse.ArgumentParser(add_help=False, parents=[common()])
    own.add_argument("--force", action="store_true", help="replace existing files, whoever made them; never an input")
    return own


def inner() -> argparse.ArgumentParser:
    """Options for surfaces inside the named one."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument(
        "--inner",
        action="append",
        default=[],
        type=inner_file,
        metavar="[NAME=]FILE",
        help="closed surface inside SURFACE, whose inside is a region NAME (default: white), or labels of a volume, "
        "VOLUME:5,6; repeatable",
    )
    return own


def limits() -> argparse.ArgumentParser:
    """Options for the limits by which a mesh is checked."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--q-max", type=Number(0, 1), metavar="Q", help="limit of the worst q (default: 0.6)")
    own.add_argument(
        "--max-boundary-distance",
        type=Number(0, 1000, endless=True),
        metavar="MM",
        help="limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit)",
    )
    own.add_argument(
        "--cell-size",
        type=Number(*CELL_SIZE_MM),
        metavar="MM",
        help="cell size h; the surface may be half of it from the boundary, and inner surfaces are moved away from it "
        "first, as for meshing (default: not known, no limit)",
    )
    return own
