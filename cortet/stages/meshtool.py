"""The published cleaner, `meshtool clean quality`, where its binary is installed: one of the backends of S4.

Its known faults are guarded against, not repaired: it may return inverted tetrahedra under a new orientation, and its
coordinates pass through float32. Source: https://bitbucket.org/aneic/meshtool (Neic et al., SoftwareX 2020).
"""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cortet.errors import InputError, StageError
from cortet.formats import carp
from cortet.measure.quality import signed_volumes
from cortet.mesh import TetMesh

logger = logging.getLogger(__name__)


def clean_with_meshtool(mesh: TetMesh, *, thresholds: Sequence[float]) -> TetMesh:
    """Run one cleaning pass for each of `thresholds` (q), in a folder of its own.

    Raises
    ------
    StageError
        meshtool is not installed, stopped with an error, wrote nothing usable, changed the connectivity or inverted
        elements
    """
    binary = shutil.which("meshtool")
    if binary is None:
        raise StageError(
            "the program meshtool is not installed",
            remedy="put it on the PATH, or set clean.backend: cortet, which needs nothing",
        )
    with tempfile.TemporaryDirectory(prefix="cortet-meshtool-") as name:
        folder = Path(name)
        carp.write(mesh, folder / "pass0", unit="mm")
        for i, threshold in enumerate(thresholds):
            _run(binary, folder, source=f"pass{i}", target=f"pass{i + 1}", threshold=threshold)
        try:
            result = carp.read(folder / f"pass{len(thresholds)}", unit="mm")
        except InputError as error:
            raise StageError(f"meshtool left no usable result: {error}") from error
    if result.cells.shape != mesh.cells.shape:
        raise StageError(f"meshtool returned {len(result.cells)} tetrahedra of {len(mesh.cells)}")
    if len(result.points) != len(mesh.points):
        raise StageError(f"meshtool returned {len(result.points)} nodes of {len(mesh.points)}")
    if not np.array_equal(np.sort(result.cells, axis=1), np.sort(mesh.cells, axis=1)):
        raise StageError("meshtool changed the connectivity, though cleaning moves vertices only")
    # judged by the orientation they came with: meshtool turns inverted tetrahedra round and calls them positive
    inverted = int((~(signed_volumes(result.points, mesh.cells) > 0)).sum())
    if inverted:
        raise StageError(f"meshtool inverted {inverted} tetrahedra", remedy="set clean.backend: cortet")
    return replace(mesh, points=result.points)


def _run(binary: str, folder: Path, *, source: str, target: str, threshold: float) -> None:
    """One pass, from the files of `source` to those of `target` in `folder`."""
    command = [
        binary,
        "clean",
        "quality",
        f"-msh={source}",
        f"-thr={threshold:g}",
        f"-outmsh={target}",
        "-ofmt=carp_txt",
    ]
    # one thread: the order of its vertex moves, so its result, depends on their number
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    output = (done.stdout + done.stderr).strip()
    logger.debug("%s\n%s", " ".join(command), output)
    if done.returncode != 0:
        last = output.splitlines()[-1] if output else "no message"
        raise StageError(f"meshtool stopped with exit code {done.returncode} at threshold {threshold:g}: {last}")
