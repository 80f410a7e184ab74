"""The files that a run writes into its folder: frames, a checkpoint to resume from, and its progress."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.folding.measurements import Measurements
from cortet.formats.atomic import atomic_path
from cortet.meshes import TetMesh

#: files in the folder of a run, which are the same in every run
TABLE, SIDECAR, VERDICT, SERIES = "fold.tsv", "fold.json", "verdict.json", "fold.pvd"
CHECKPOINT = "checkpoint.npz"
#: files of a run in its folder, without frames
FILES = (TABLE, SIDECAR, VERDICT, SERIES, CHECKPOINT)

#: called with every row of the table, the share of the steps done, and the seconds that they took
Progress = Callable[[Measurements, float, float], None]

_WIDTH = 20


# --- frames


def write_series(frames: Sequence[tuple[str, float]], path: Path) -> None:
    """Write the `.pvd` of frames: file names relative to it, and gestational ages in place of times."""
    lines = "".join(f'    <DataSet timestep="{age:.10g}" part="0" file={quoteattr(name)}/>\n' for name, age in frames)
    with atomic_path(path) as temporary:
        temporary.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            f"{lines}  </Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )


def series(path: Path) -> list[tuple[Path, float]]:
    """Frames of a run and their gestational ages, from its `.pvd` file."""
    try:
        entries = list(ElementTree.parse(path).iter("DataSet"))
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="fold the mesh again") from error
    return [(path.parent / entry.attrib["file"], float(entry.attrib["timestep"])) for entry in entries]


# --- checkpoint


def fingerprint(mesh: TetMesh, parameters: dict[str, Any]) -> str:
    """SHA-256 of everything a run depends on."""
    plain = json.loads(json.dumps(parameters, default=str))  # keys of one kind, which can be sorted
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
    named: dict[str, NDArray[Any]] = {"points": mesh.points, "cells": mesh.cells}
    named |= {f"point field {name}": values for name, values in mesh.point_data.items()}
    named |= {f"cell field {name}": values for name, values in mesh.cell_data.items()}
    named |= {
        f"set of {kind}: {name}": members for kind, sets in vars(mesh.sets).items() for name, members in sets.items()
    }
    for name, array in sorted(named.items()):
        # name, type and shape: the same bytes under another name, or in other rows, make another mesh
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save_checkpoint(path: Path, rest: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write the exact state of a run: its `fingerprint` and other plain values, and arrays.

    The previous one stays until this one is complete.
    """
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, rest=json.dumps(rest), **arrays)


def load_checkpoint(path: Path, fingerprint: str) -> dict[str, Any] | None:
    """All values of the checkpoint of the run with this fingerprint; None if there is none, or one of another run."""
    try:
        with np.load(path) as data:
            found = {**json.loads(str(data["rest"])), **{name: data[name] for name in data.files if name != "rest"}}
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):  # missing or damaged
        return None
    return found if found["fingerprint"] == fingerprint else None


# --- progress


def status(now: Measurements, part: float, seconds: float) -> str:
    """A line with a bar, time, age, worst element, folds and time left; `part` is the share of the steps done."""
    done = round(_WIDTH * part)
    left = seconds / part * (1 - part) if part > 0 else float("nan")
    return (
        f"[{'#' * done}{'.' * (_WIDTH - done)}] {part:4.0%}  {now.gestational_age:.2f} weeks  "
        f"smallest J {now.min_j:.3f}  gyrification {now.gyrification_index:.3f}  {_duration(left)} left"
    )


def per_percent(say: Callable[[str], None]) -> Progress:
    """A progress callback for `fold` that calls `say` once per percent, and at the end."""
    said = -1

    def progress(now: Measurements, part: float, seconds: float) -> None:
        nonlocal said
        if int(100 * part) > said:
            said = int(100 * part)
            say(status(now, part, seconds))

    return progress


def _duration(seconds: float) -> str:
    if seconds != seconds:
        return "unknown time"
    minutes = seconds / 60
    return f"{seconds:.0f} s" if minutes < 1 else f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
