"""The published cleaner, `meshtool clean quality`, if its binary is installed: one of the backends of S4.

Its known faults are detected, not repaired: it may return inverted tetrahedra under a new orientation, and its
coordinates pass through float32. If no element is above the threshold, it writes nothing and exits with 0. But it also
exits with 0 after wrong arguments, so that is believed only if our own q agrees. Source:
https://bitbucket.org/aneic/meshtool (Neic et al., SoftwareX 2020).
"""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cortet.errors import InputError, StageError, counted
from cortet.formats import carp, child
from cortet.formats.hashing import sha256
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh

logger = logging.getLogger(__name__)


def clean_with_meshtool(mesh: TetMesh, *, thresholds: Sequence[float]) -> TetMesh:
    """Run one cleaning pass for each of `thresholds` (q), in a separate folder.

    Raises
    ------
    StageError
        meshtool is not installed, stopped with an error, wrote nothing usable, changed the connectivity or inverted
        elements
    """
    binary = _binary()
    with tempfile.TemporaryDirectory(prefix="cortet-meshtool-") as name:
        folder = Path(name)
        last = folder / "pass0"
        carp.write(mesh, last, unit="mm")
        result = mesh
        for number, threshold in enumerate(thresholds, start=1):
            target = folder / f"pass{number}"
            _run(binary, source=last, target=target, threshold=threshold)
            if not target.with_suffix(".pts").exists():
                _check_nothing_to_do(result, threshold)
                continue
            try:
                result = carp.read(target, unit="mm")
            except InputError as error:
                raise StageError(f"meshtool left no usable result: {error}") from error
            _check_result(mesh, result)
            last = target
    return replace(mesh, points=result.points)


def program_version() -> str:
    """The hash of the installed meshtool's binary, which identifies its build: meshtool states no version."""
    return f"sha256:{sha256(_binary())[:12]}"


def _binary() -> str:
    binary = shutil.which("meshtool")
    if binary is None:
        raise StageError(
            "the program meshtool is not installed",
            remedy="add it to the PATH, or set clean.backend: cortet, which needs no program",
        )
    return binary


def _check_nothing_to_do(mesh: TetMesh, threshold: float) -> None:
    """Raise StageError if meshtool wrote nothing although an element is above the threshold."""
    if above := int((quality(mesh.points, mesh.cells) > threshold).sum()):
        raise StageError(
            f"meshtool wrote no mesh at threshold {threshold:g}, although "
            f"{counted(above, 'tetrahedron has', 'tetrahedra have')} a larger q",
            remedy="run `meshtool clean quality` by hand on the CARP files of S2, or set clean.backend: cortet",
        )
    logger.info("no tetrahedron is above %g: meshtool had nothing to do", threshold)


def _check_result(mesh: TetMesh, result: TetMesh) -> None:
    """Refuse a result that is not the same mesh with moved vertices."""
    if result.cells.shape != mesh.cells.shape:
        what = f"meshtool changed the number of tetrahedra from {len(mesh.cells)} to {len(result.cells)}"
        raise StageError(what)
    if len(result.points) != len(mesh.points):
        raise StageError(f"meshtool changed the number of nodes from {len(mesh.points)} to {len(result.points)}")
    if not np.array_equal(np.sort(result.cells, axis=1), np.sort(mesh.cells, axis=1)):
        raise StageError("meshtool changed the connectivity, although cleaning only moves vertices")
    # checked by the original orientation: meshtool reverses inverted tetrahedra and calls them positive
    inverted = int((~(signed_volumes(result.points, mesh.cells) > 0)).sum())
    if inverted:
        raise StageError(
            f"meshtool inverted {counted(inverted, 'tetrahedron', 'tetrahedra')}", remedy="set clean.backend: cortet"
        )


def _run(binary: str, *, source: Path, target: Path, threshold: float) -> None:
    """Run one pass, from the files of `source` to those of `target` beside them."""
    command = [
        binary,
        "clean",
        "quality",
        f"-msh={source.name}",
        f"-thr={threshold:g}",
        f"-outmsh={target.name}",
        "-ofmt=carp_txt",
    ]
    # one thread: the order of vertex moves, and so the result, depends on the number of threads
    done = child.run(command, cwd=source.parent, env=os.environ | {"OMP_NUM_THREADS": "1"})
    output = (done.stdout + done.stderr).strip()
    logger.debug("%s\n%s", " ".join(command), output)
    if done.returncode != 0:
        said = output.splitlines()[-1] if output else "no message"
        raise StageError(f"meshtool stopped with exit code {done.returncode} at threshold {threshold:g}: {said}")
