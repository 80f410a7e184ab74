"""CGAL Mesh_3, the published mesher, through pygalmesh or the `cgal` wheel (`meshers._cgal`).

Its refinement decides the topology: with a coarse facet distance, the two banks of a narrow sulcus silently pinch or
fuse. So the boundary is checked after refinement, before the slow passes, and again after them. If its topology is not
that of the surface, the facet distance (nothing else) is tightened. No distance helps on surfaces with creases, or with
banks closer than their own edges; there the fallback takes over.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from cortet.meshers.mesher import Attempt, Facts, Filled, Mesher
from cortet.meshes import TetMesh, TriSurface

if TYPE_CHECKING:
    from cortet.config.stages import Generate
    from cortet.meshers._cgal import Criteria

logger = logging.getLogger(__name__)


def installed_backend() -> str:
    """The package that runs CGAL if the configuration says `auto`."""
    return "pygalmesh" if find_spec("pygalmesh") else "cgal"


def fill(surface: TriSurface, settings: Generate, facts: Facts) -> Filled:
    """Mesh with the first facet distance that gives the topology of the surface, else with the last one."""
    from cortet.meshers._cgal import Criteria, write_off

    backend = installed_backend() if settings.backend == "auto" else settings.backend
    every = [
        Criteria(facts.cell_size, settings.facet_angle, fraction * facts.cell_size, settings.radius_edge_ratio)
        for fraction in settings.facet_distance
    ]
    attempts: list[Attempt] = []
    with TemporaryDirectory(prefix="cortet-generate-") as folder:
        off = Path(folder) / "surface.off"
        write_off(surface, off)
        for criteria in every:
            # nothing follows the last attempt, so its passes run whatever the refinement gives
            another = criteria != every[-1] or settings.fallback is not None
            for passes in [(), settings.passes] if settings.passes and another else [settings.passes]:
                mesh, attempt = _attempt(off, surface, backend, criteria, passes, seed=settings.seed)
                attempts.append(attempt)
                if attempt.problems:
                    break
            if not attempts[-1].problems:
                break
        else:
            logger.warning("facet distances of %s h: %s", settings.facet_distance, "; ".join(attempts[-1].problems))
    return Filled(mesh, tuple(attempts), backend, settings.passes)


def _attempt(
    off: Path, surface: TriSurface, backend: str, criteria: Criteria, passes: tuple[str, ...], *, seed: int
) -> tuple[TetMesh, Attempt]:
    """Mesh once and compare the topology of the result with that of the surface."""
    from cortet.meshers import _cgal
    from cortet.meshers._filled import checked, log_attempt, well_ordered

    began = time.perf_counter()
    mesh, flat = well_ordered(*_cgal.fill(off, backend=backend, criteria=criteria, passes=passes, seed=seed))
    if flat:
        logger.warning("dropped %d exactly flat tetrahedra", flat)
    what = f"{backend}, facet distance {criteria.facet_distance:g} mm, {', '.join(('refinement', *passes))}"
    attempt = checked(mesh, surface, facet_distance=criteria.facet_distance, passes=passes, flat=flat)
    log_attempt(what, attempt, time.perf_counter() - began)
    return mesh, attempt


def _notice(generate: Generate) -> str:
    if generate.backend != "auto" or installed_backend() == "pygalmesh":
        return ""
    return (
        "pygalmesh, the paper's tool, is not installed: CGAL runs by the `cgal` wheel, the same library in "
        "another version and without a seed (`make published` compiles pygalmesh, once, in some ten minutes)"
    )


def _said(parameters: Mapping[str, Any], backend: str, _mesher: str, meshes: str) -> str:
    passes = [name for name in ("odt", "lloyd", "perturb", "exude") if parameters[name]]
    distances = ", ".join(f"{value:g}" for value in parameters["facet_distance"])
    return (
        f"CGAL Mesh_3 through {backend} (facet angle {parameters['facet_angle']:g} degrees, facet distance "
        f"{distances} h, tried in this order until the topology was right, radius-edge ratio "
        f"{parameters['radius_edge_ratio']:g}, optimisation {', '.join(passes) or 'none'}, seed "
        f"{parameters['seed']}; {meshes})"
    )


MESHERS = (
    Mesher(
        name="cgal",
        printed="CGAL",
        fill=fill,
        tets_per_cube=4.2,  # measured 4.13 to 4.19
        may_change_topology=True,
        notice=_notice,
        said=_said,
    ),
)
