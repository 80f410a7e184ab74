"""General-purpose tetrahedral meshers of other projects, each with its own defaults, to compare ours with.

Each gets the oriented, merged surface and, if it takes one, the cell size; nothing is tuned. They are foreign code that
may crash or never finish, so each runs in a separate process, under a time limit.

========  ============================  =========================================================================
mesher    distribution on PyPI          called as
========  ============================  =========================================================================
tetgen    tetgen                        switches ``pq1.2/20Y``, the baseline of the CORTET paper; takes no cell size
ftetwild  pytetwild                     ideal edge length h; its envelope and energy are its defaults
gmsh      gmsh                          3D mesh inside the surface as a discrete entity; element size at most h
netgen    netgen-mesher                 volume mesh inside the surface; ``maxh`` h
========  ============================  =========================================================================
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from cortet.errors import StageError, counted
from cortet.meshers.mesher import OF_CGAL, Facts, Filled, Mesher
from cortet.meshes import FloatArray, IntArray, TriSurface

if TYPE_CHECKING:
    from cortet.config.stages import Generate

VERSION: int = 1

#: switches of the CORTET paper: bounds of radius-edge ratio and dihedral angle; the boundary is kept
TETGEN_SWITCHES = "pq1.2/20Y"

#: folder of the package, even if it is not installed
_PACKAGES = Path(__file__).parents[2]

#: nodes (n, 3) in mm and tetrahedra (m, 4) of either orientation
Tetrahedra = tuple[FloatArray, IntArray]


def with_tetgen(points: FloatArray, faces: IntArray, _cell_size: float) -> Tetrahedra:
    """TetGen, as the CORTET paper called it."""
    import tetgen

    filled = tetgen.TetGen(points, faces).tetrahedralize(switches=TETGEN_SWITCHES + "Q")
    return filled[0], filled[1]


def with_ftetwild(points: FloatArray, faces: IntArray, cell_size: float) -> Tetrahedra:
    """fTetWild; its boundary only stays within an envelope around the surface."""
    import pytetwild

    return pytetwild.tetrahedralize(points, faces, edge_length_abs=cell_size, quiet=True, num_threads=1)[:2]  # type: ignore[attr-defined, unused-ignore]


def with_gmsh(points: FloatArray, faces: IntArray, cell_size: float) -> Tetrahedra:
    """Gmsh's own mesher inside the given triangles, followed by its default optimisation."""
    import gmsh

    gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMax", cell_size)
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.mesh.addNodes(2, 1, np.arange(len(points)) + 1, points.ravel())
    gmsh.model.mesh.addElementsByType(1, 2, np.arange(len(faces)) + 1, faces.ravel() + 1)
    gmsh.model.geo.addSurfaceLoop([1], 1)
    gmsh.model.geo.addVolume([1], 1)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(3)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType(4)
    gmsh.finalize()
    row = np.zeros(int(tags.max()) + 1, np.int64)
    row[tags] = np.arange(len(tags))
    return coordinates.reshape(-1, 3), row[corners].reshape(-1, 4)


def with_netgen(points: FloatArray, faces: IntArray, cell_size: float) -> Tetrahedra:
    """Netgen's volume mesher inside the given triangles, on one thread: races between threads fold elements."""
    from netgen import meshing
    from pyngcore import SetNumThreads

    SetNumThreads(1)
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(points)
    outside = mesh.Add(meshing.FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
    mesh.AddElements(dim=2, index=outside, data=faces, base=0)
    mesh.GenerateVolumeMesh(maxh=cell_size)
    cells = mesh.Elements3D().NumPy()["nodes"][:, :4]
    # copied, since Netgen's own array is freed with its mesh
    return np.array(mesh.Coordinates(), float), cells.astype(np.int64) - 1


#: mesher -> distribution that installs it, and the function that calls it
TOOLS: dict[str, tuple[str, Callable[[FloatArray, IntArray, float], Tetrahedra]]] = {
    "tetgen": ("tetgen", with_tetgen),
    "ftetwild": ("pytetwild", with_ftetwild),
    "gmsh": ("gmsh", with_gmsh),
    "netgen": ("netgen-mesher", with_netgen),
}


def tetrahedra(surface: TriSurface, mesher: str, *, cell_size: float, time_limit: float | None = None) -> Tetrahedra:
    """Nodes and tetrahedra inside a closed surface, made by one of `TOOLS` in a separate process.

    Parameters
    ----------
    surface : closed and connected, without self-intersections; turned outward and merged here
    cell_size : mm
    time_limit : minutes; None for no limit

    Returns
    -------
    Nodes and tetrahedra as the mesher returns them: of either orientation, possibly with flat ones and unused nodes.

    Raises
    ------
    StageError : the mesher is not installed, failed, crashed, took too long, or returned nothing
    """
    from cortet.formats import child

    with TemporaryDirectory(prefix=f"cortet-{mesher}-") as folder:
        given, made = Path(folder) / "surface.npz", Path(folder) / "mesh.npz"
        points, faces = prepared(surface)
        np.savez(given, points=points, faces=faces)
        command = [sys.executable, "-m", "cortet.meshers.baselines", mesher, str(given), str(made), repr(cell_size)]
        try:
            done = child.run(
                command,
                cwd=folder,  # TetGen leaves files behind if it fails
                env={**os.environ, "PYTHONPATH": os.pathsep.join([str(_PACKAGES), *sys.path])},
                timeout=None if time_limit is None else 60 * time_limit,
            )
        except subprocess.TimeoutExpired:
            raise StageError(f"{mesher} took longer than {time_limit:g} minutes") from None
        if done.returncode < 0:
            raise StageError(f"{mesher} crashed ({signal.Signals(-done.returncode).name})")
        if done.returncode:
            said = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
            raise StageError(f"{mesher} failed: {said}")
        with np.load(made) as arrays:
            result = arrays["points"], arrays["cells"]
    if not len(result[1]):
        raise StageError(f"{mesher} returned no tetrahedra")
    return result


def prepared(surface: TriSurface) -> tuple[FloatArray, IntArray]:
    """Points and faces turned outward, without unused points and with those of equal coordinates merged."""
    from cortet.geometry.topology import compact, enclosed_volume

    _, first, inverse = np.unique(surface.points, axis=0, return_index=True, return_inverse=True)
    faces = first[inverse.reshape(-1)][surface.faces].astype(np.int32)
    if enclosed_volume(surface.points, faces) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    points, faces, _ = compact(surface.points, faces)
    return points, faces


def _run(mesher: str, given: str, made: str, cell_size: str) -> None:
    """Main function of the process that `tetrahedra` starts."""
    with np.load(given) as arrays:
        points, cells = TOOLS[mesher][1](arrays["points"], arrays["faces"], float(cell_size))
    np.savez(made, points=points, cells=cells)


def _fill(mesher: str, surface: TriSurface, _settings: Generate, facts: Facts) -> Filled:
    """A mesh by one of `TOOLS`, without its flat tetrahedra; refused if it overlaps itself."""
    from cortet.geometry.filling import folded_faces
    from cortet.meshers._filled import checked, log_attempt, well_ordered

    began = time.perf_counter()
    made = tetrahedra(surface, mesher, cell_size=facts.cell_size, time_limit=facts.time_limit)
    mesh, flat = well_ordered(*made)
    if folded := folded_faces(mesh):  # no later stage could work on it
        raise StageError(
            f"{mesher} returned overlapping tetrahedra: {counted(folded, 'face has', 'faces have')} both "
            "tetrahedra on the same side"
        )
    attempt = checked(mesh, surface, flat=flat)
    log_attempt(mesher, attempt, time.perf_counter() - began)
    return Filled(mesh, (attempt,), TOOLS[mesher][0])


#: names of meshers in tables
_PRINTED = {"tetgen": "TetGen", "ftetwild": "fTetWild", "gmsh": "Gmsh", "netgen": "Netgen"}

MESHERS = tuple(
    Mesher(name=name, printed=_PRINTED[name], fill=partial(_fill, name), own=False, ignores=OF_CGAL) for name in TOOLS
)


if __name__ == "__main__":
    _run(*sys.argv[1:])
