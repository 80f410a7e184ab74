"""The line of stages, in the order in which they run, and one module for each of them.

This list is the only one: the configuration, the workflow, `cortet mesh` and the pages read it. It is light, so that
the workflow can be planned without loading what the stages need (Numba, Gmsh, PyMeshLab).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal


@dataclass(frozen=True)
class Stage:
    """One stage of the line: `cortet.stages.<name>.<name>(*takes, **arguments)` returns what it gives and a report."""

    #: name of its module, its function, its rule and its section of the configuration
    name: str
    #: what it does, as pages say it
    does: str
    #: what names of files call its result: `desc-<label>` of a surface, `desc-<mesher><setting><label>` of a mesh
    label: str
    #: what its function takes before the keyword arguments
    takes: tuple[Literal["surface", "sphere", "mesh"], ...]
    gives: Literal["surface", "mesh"]
    #: number in the paper's line, where it has one
    number: str = ""
    #: whether it has something to do only where there are inner surfaces
    nested: bool = False
    #: whether it has something to do only where the surface has a sphere
    registered: bool = False
    #: whether its function is told, by `inside=True`, that a surface is an inner one
    told_inside: bool = False
    #: whether the result is the same in every setting of the configuration, so that all of them share it
    shared_by_settings: bool = False

    @property
    def function(self) -> Callable[..., tuple[Any, Any]]:
        """The stage's function; the first access loads its libraries."""
        function: Callable[..., tuple[Any, Any]] = getattr(import_module(f"{__name__}.{self.name}"), self.name)
        return function


#: S6 runs before S5, so that the mesh which is certified and exported is the last one
STAGES: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        Stage(
            "resample",
            "puts the surface onto the common mesh",
            "resampled",
            ("surface", "sphere"),
            "surface",
            registered=True,
            told_inside=True,
        ),
        Stage("repair", "repairs what is broken", "repaired", ("surface",), "surface"),
        Stage("gate", "lets in a surface that can be meshed", "gated", ("surface",), "surface", told_inside=True),
        Stage("smooth_surface", "smooths the surface as much as it is rough", "smoothed", ("surface",), "surface"),
        Stage(
            "separate",
            "moves inner surfaces away from the one around them",
            "separated",
            ("surface",),
            "surface",
            nested=True,
        ),
        Stage(
            "generate",
            "fills the surface with tetrahedra",
            "Generated",
            ("surface",),
            "mesh",
            number="S1",
            shared_by_settings=True,
        ),
        Stage(
            "transfer",
            "carries fields to the mesh",
            "Transferred",
            ("mesh", "surface"),
            "mesh",
            number="S2",
            shared_by_settings=True,
        ),
        Stage("relocate", "moves interior nodes", "Relocated", ("mesh",), "mesh", number="S3"),
        Stage(
            "clean",
            "moves vertices until the worst elements are good",
            "Cleaned",
            ("mesh", "surface"),
            "mesh",
            number="S4",
        ),
        Stage(
            "reconnect",
            "reconnects elements that moving cannot improve",
            "Reconnected",
            ("mesh", "surface"),
            "mesh",
            number="S4+",
        ),
        Stage("smooth_boundary", "smooths the boundary", "BoundarySmoothed", ("mesh", "surface"), "mesh"),
        Stage("snap", "puts the boundary onto the surface", "Snapped", ("mesh", "surface"), "mesh", number="S6"),
        Stage("solver_ready", "orders nodes and elements", "Solver", ("mesh", "surface"), "mesh", number="S5"),
    )
}
MESH_STAGES = {name: stage for name, stage in STAGES.items() if stage.gives == "mesh"}
