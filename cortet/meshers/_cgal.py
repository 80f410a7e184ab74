"""CGAL Mesh_3, the published mesher: Delaunay refinement and four optimisation passes.

Two builds of the library can run it: `pygalmesh` (CGAL 5, compiled from source, the published tool) and the `cgal`
wheel (CGAL 6, nothing to compile). Both read an OFF file and write a Medit file, with 17 significant digits.

Reference: https://doc.cgal.org/latest/Mesh_3/index.html (criteria and passes).
"""

from __future__ import annotations

import ctypes
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import meshio
import numpy as np

from cortet.errors import StageError
from cortet.geometry.topology import compact, enclosed_volume
from cortet.meshes import FloatArray, IntArray, TriSurface

#: CGAL's optimisation passes in the order it runs them; exude must be last, since moving a vertex undoes it
PASSES = ("odt", "lloyd", "perturb", "exude")
#: CGAL's own defaults for ODT and Lloyd, which the wheel needs explicitly
CONVERGENCE, FREEZE_BOUND = 0.02, 0.01
#: "no limit" for the time limits, iteration limits and sliver bounds of CGAL's passes
NO_LIMIT = 0

#: time for the system to move this thread to an idle core before it is confined to its core
_SETTLING_S = 0.05

logger = logging.getLogger(__name__)


class Criteria(NamedTuple):
    """Criteria of CGAL's refinement; lengths in mm, the angle in degrees."""

    cell_size: float
    facet_angle: float
    facet_distance: float
    radius_edge_ratio: float


def fill(
    off: Path, *, backend: str, criteria: Criteria, passes: Sequence[str], seed: int
) -> tuple[FloatArray, IntArray]:
    """Tetrahedra inside the surface of an OFF file; the Medit file that CGAL writes stays beside it.

    Parameters
    ----------
    off : as `write_off` writes it
    backend : a key of `BACKENDS`
    passes : the `PASSES` to run after the refinement
    seed : of CGAL's random numbers; the `cgal` wheel takes none

    Returns
    -------
    points (n, 3) float64 mm; cells (m, 4), of either orientation
    """
    medit = off.with_suffix(".mesh")
    try:
        BACKENDS[backend](off, medit, criteria, passes, seed)
    except ImportError as error:
        raise StageError(f"mesher backend {backend} is not installed: {error}", remedy="run cortet doctor") from error
    except RuntimeError as error:
        raise StageError(f"{backend} failed: {error}") from error
    result = meshio.medit.read(medit)
    cells = result.cells_dict.get("tetra", np.empty((0, 4), np.int32))
    if not len(cells):
        raise StageError("the mesher returned no tetrahedra", remedy="use a smaller cell size")
    return result.points, cells


def _with_pygalmesh(off: Path, medit: Path, criteria: Criteria, passes: Sequence[str], seed: int) -> None:
    # Imported here, as CGAL is below, since either may be missing. pygalmesh's public function only wraps this one,
    # through temporary files of its own that outlive a failure.
    from _pygalmesh import _generate_from_off

    _generate_from_off(
        str(off),
        str(medit),
        **{name: name in passes for name in PASSES},
        min_facet_angle=criteria.facet_angle,
        max_radius_surface_delaunay_ball=criteria.cell_size,
        max_facet_distance=criteria.facet_distance,
        max_circumradius_edge_ratio=criteria.radius_edge_ratio,
        max_cell_circumradius=criteria.cell_size,
        verbose=False,
        seed=seed,
    )


def _with_cgal(off: Path, medit: Path, criteria: Criteria, passes: Sequence[str], _seed: int) -> None:
    from CGAL import CGAL_Mesh_3 as mesh_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    wanted = mesh_3.Default_mesh_criteria()
    wanted.facet_angle(criteria.facet_angle)
    wanted.facet_size(criteria.cell_size)
    wanted.facet_distance(criteria.facet_distance)
    wanted.cell_radius_edge_ratio(criteria.radius_edge_ratio)
    wanted.cell_size(criteria.cell_size)
    refinement_only = mesh_3.Mesh_3_parameters()
    refinement_only.no_perturb()
    refinement_only.no_exude()
    limits = (NO_LIMIT, NO_LIMIT, CONVERGENCE, FREEZE_BOUND)

    # the polyhedron must outlive the domain, which only refers to it
    polyhedron = Polyhedron_3(str(off))
    domain = mesh_3.Polyhedral_mesh_domain_3(polyhedron)
    with one_core():
        complex_3 = mesh_3.make_mesh_3(domain, wanted, refinement_only)
    run: dict[str, Callable[[], object]] = {
        "odt": lambda: mesh_3.odt_optimize_mesh_3(complex_3, domain, *limits),
        "lloyd": lambda: mesh_3.lloyd_optimize_mesh_3(complex_3, domain, *limits),
        "perturb": lambda: mesh_3.perturb_mesh_3(complex_3, domain, NO_LIMIT, NO_LIMIT),
        "exude": lambda: mesh_3.exude_mesh_3(complex_3, NO_LIMIT, NO_LIMIT),
    }
    for name in passes:
        began = time.perf_counter()
        with one_core():
            run[name]()
        logger.info("cgal: %s, %.1f s", name, time.perf_counter() - began)
    complex_3.output_to_medit(str(medit))


#: name of the distribution -> function that meshes an OFF file into a Medit file
BACKENDS: dict[str, Callable[[Path, Path, Criteria, Sequence[str], int], None]] = {
    "pygalmesh": _with_pygalmesh,
    "cgal": _with_cgal,
}


@contextmanager
def one_core() -> Iterator[None]:
    """Confine this thread, and the threads it starts, to the core it is running on, and undo that at the end.

    The `cgal` wheel starts one thread per core it may use, and more than one make the mesh depend on their timing.
    Each pass is confined again, so that two jobs that happen to choose the same core do not share it for long.
    """
    if not hasattr(os, "sched_setaffinity"):
        logger.warning("no CPU affinity on this system: the cgal backend is not reproducible here")
        yield
        return
    allowed = os.sched_getaffinity(0)
    time.sleep(_SETTLING_S)
    os.sched_setaffinity(0, {ctypes.CDLL(None).sched_getcpu()})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def write_off(surface: TriSurface, path: Path) -> None:
    """Write an OFF file whose faces point outward, with every digit of the coordinates."""
    inward = enclosed_volume(surface.points, surface.faces) < 0
    points, faces, _ = compact(surface.points, surface.faces[:, ::-1] if inward else surface.faces)
    with path.open("w") as file:
        file.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        np.savetxt(file, points, "%.17g")
        np.savetxt(file, faces, "3 %d %d %d")
