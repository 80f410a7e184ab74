"""The section `generate` of the configuration: parameters of S1, of which each mesher uses those that it knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from cortet.meshers import MESHERS, OWN
from cortet.meshers.cgal import installed_backend
from cortet.sections import AsList, CellSize, Fraction, NonNegativeInt, Positive, Section

if TYPE_CHECKING:
    MesherName = str
    Fallback = str
else:  # the names of all meshers, and of those that always keep the topology
    MesherName = Literal[tuple(MESHERS)]
    Fallback = Literal[tuple(name for name, mesher in OWN.items() if not mesher.may_change_topology)]


class Generate(Section):
    """S1: tetrahedra inside the surface."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"cell_size", "meshers"}

    cell_size: Annotated[list[CellSize], AsList, Field(min_length=1)] = [0.6]
    """Cell size h, mm, a multiple of 0.001: bound of circumradius and surface ball. A list makes one mesh per size."""
    meshers: Annotated[list[MesherName], AsList, Field(min_length=1)] = ["lattice"]
    """Meshers: lattice (ours: better elements, ten times faster), cgal (published), or with its own defaults one of
    tetgen, ftetwild, gmsh and netgen. Every stage after S1 is the same for all of them."""
    backend: Literal["auto", "pygalmesh", "cgal"] = "auto"
    """Package that runs CGAL: pygalmesh (compiled from source), cgal (wheel), auto: pygalmesh where installed."""
    facet_angle: Annotated[float, Field(gt=0, le=30)] = 25.0
    """Smallest angle of a boundary triangle, degrees; refinement ends for certain only up to 30."""
    facet_distance: Annotated[list[Fraction], AsList, Field(min_length=1)] = [0.5, 0.2, 0.1, 0.05]
    """Distance of a boundary triangle's circumcentre to that of its surface ball, as fractions of h, tried in this
    order until the boundary is a closed manifold of the input's genus: narrow sulci fuse when it is too large."""
    radius_edge_ratio: Positive = 2.0
    """Largest ratio of circumradius to shortest edge."""
    odt: bool = True
    """Optimal Delaunay triangulation smoothing."""
    lloyd: bool = True
    """Lloyd smoothing."""
    perturb: bool = True
    """Vertex perturbation against slivers."""
    exude: bool = True
    """Sliver exudation, last."""
    seed: NonNegativeInt = 0
    """Seed of CGAL's random numbers, and of the direction in which the surface is meshed (0: as it stands)."""
    fallback: Fallback | None = "lattice"
    """Mesher to take where no facet distance gives the right topology; null: none."""
    edge_length: Annotated[list[Positive], AsList, Field(min_length=1)] = [
        1.25,
        1.2,
        1.15,
        1.1,
        1.0,
        0.9,
        0.8,
        0.7,
        0.6,
    ]
    """lattice: edges of the boundary triangles, as fractions of h, tried in this order until no triangles cross."""
    surface_distance: Annotated[float, Field(gt=0, le=1)] = 0.4
    """lattice: largest distance of the surface to the boundary triangles, a fraction of h; edges get shorter where it
    takes that. S4 and S4+ slide the boundary and may add 0.07 h."""
    core_ratio: Annotated[float, Field(ge=1, le=8)] = 1.0
    """lattice: how many times larger cells are in the core; the cortex keeps h."""
    core_depth: Positive = 6.0
    """lattice: depth below the surface where the core begins, mm."""
    size_field: str | None = None
    """lattice: field of the surface that says the cell size at each vertex, mm, where it is to be smaller than h (down
    to 0.35 h); cells grow to h away from there."""

    sizes: dict[str, Positive | None] = {}
    """lattice: cell sizes, mm, at the surface of a region or inside labels of a volume, where they are to be smaller
    than h (down to 0.35 h): {white: 0.5, dseg.nii.gz:thalamus: 0.4}; {sizes.nii.gz: null} takes them from the voxels.
    Volumes for `cortet mesh` alone; cells grow to h away from there."""

    def excludes_inner_surfaces(self) -> str:
        """Not all meshers fill several regions."""
        able = all(MESHERS[name].regions for name in self.meshers)
        return "" if able else f"generate.meshers: {', '.join(self.meshers)}"

    @property
    def passes(self) -> tuple[str, ...]:
        """CGAL's optimisation passes, in the order it runs them."""
        return tuple(name for name in ("odt", "lloyd", "perturb", "exude") if getattr(self, name))

    def decided(self, config: Any, facts: Mapping[str, Any]) -> dict[str, Any]:
        """One backend for all meshes of a cohort; cells across the cortex only if there is an inner surface."""
        backend = {"backend": installed_backend()} if self.backend == "auto" else {}
        return backend | ({"elements_across": config.regions.elements_across} if facts.get("nested") else {})
