"""The line of stages: one module for each of them, which declares it as `STAGE`.

This is the only list: the configuration, the workflow, `cortet mesh` and the pages read it. Every job loads all modules
here to read the configuration, so heavy libraries (Numba, SciPy, Gmsh, PyMeshLab) are imported in the functions that
use them. Modules whose names begin with `_` are parts of a stage, and load with it. A new stage is a new file in this
folder (CONTRIBUTING.md shows one).
"""

from __future__ import annotations

from cortet.sections import public_modules
from cortet.stages.stage import Stage

__all__ = ["MESH_STAGES", "STAGES", "Stage"]


def _found() -> dict[str, Stage]:
    """The stages of all modules in this folder, by name, in the order in which they run."""
    modules = public_modules(__name__, __path__)
    stages = sorted((module.STAGE for module in modules if hasattr(module, "STAGE")), key=lambda stage: stage.order)
    orders = [stage.order for stage in stages]
    if len(set(orders)) < len(orders):
        raise ImportError(f"two stages have the same place in the line: {[(s.name, s.order) for s in stages]}")
    return {stage.name: stage for stage in stages}


STAGES = _found()
MESH_STAGES = {name: stage for name, stage in STAGES.items() if stage.gives == "mesh"}
