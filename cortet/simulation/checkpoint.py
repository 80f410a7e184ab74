"""What a killed run needs to go on as if nothing had happened."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.mesh import FloatArray, TetMesh


class Checkpoint(NamedTuple):
    """A moment of a run, bit for bit; n nodes, s surface nodes."""

    #: of the mesh and the parameters: only the same run may go on from here
    fingerprint: str
    step: int
    #: (n, 3) each
    x: FloatArray
    v: FloatArray
    #: (s, 3), where the contact list was made
    listed: FloatArray
    time: float
    degenerate: int
    contacts: int
    #: since the start: energy dissipated, work of the contact, work of growth
    energies: tuple[float, float, float]
    #: of the steps so far, this and earlier processes together
    seconds: float
    #: rows of the tables so far, and the frames written
    rows: list[dict[str, Any]]
    frames: list[tuple[str, float]]


_ARRAYS = ("x", "v", "listed")


def fingerprint(mesh: TetMesh, parameters: dict[str, Any]) -> str:
    """SHA-256 of everything a run depends on."""
    digest = hashlib.sha256(json.dumps(parameters, sort_keys=True, default=str).encode())
    named: dict[str, NDArray[Any]] = {"points": mesh.points, "cells": mesh.cells}
    named |= {f"point field {name}": values for name, values in mesh.point_data.items()}
    named |= {f"cell field {name}": values for name, values in mesh.cell_data.items()}
    named |= {
        f"set of {kind}: {name}": members for kind, sets in vars(mesh.sets).items() for name, members in sets.items()
    }
    for name, array in sorted(named.items()):
        # a name, a type and a shape: the same bytes under another name, or in other rows, are another mesh
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save(checkpoint: Checkpoint, path: Path) -> None:
    """Write a checkpoint; the one before stays until this one is complete."""
    rest = {name: value for name, value in checkpoint._asdict().items() if name not in _ARRAYS}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, rest=json.dumps(rest), **{name: getattr(checkpoint, name) for name in _ARRAYS})


def load(path: Path, fingerprint: str) -> Checkpoint | None:
    """The checkpoint of the run with this fingerprint; None where there is none, or another run's."""
    try:
        with np.load(path) as data:
            rest = json.loads(str(data["rest"]))
            if rest["fingerprint"] != fingerprint:
                return None
            rest["frames"] = [(name, age) for name, age in rest["frames"]]
            return Checkpoint(**rest, **{name: data[name] for name in _ARRAYS})
    except FileNotFoundError:
        return None
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile):  # of an older version, or damaged
        return None
