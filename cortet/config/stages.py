"""Sections of the stages, in the order of the line: the only source of their defaults and limits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cortet.config.section import (
    AsList,
    Boundary,
    CellSize,
    Fraction,
    NonNegativeInt,
    Positive,
    PositiveInt,
    Section,
    Threshold,
)
from cortet.errors import InputError
from cortet.formats.placement import UNITS

#: meshers of the line, and those of other projects
MesherName = Literal["cgal", "lattice", "tetgen", "ftetwild", "gmsh", "netgen"]
Interior = Literal["nearest", "harmonic"]
RepairMethod = Literal["local", "voxel"]
SmoothingMethod = Literal["taubin", "published"]
BoundarySmoothing = Literal["laplacian", "workbench"]


class Resample(Section):
    """Surfaces with a sphere (column `sphere` of the sheet) on a mesh that all cases share: vertices correspond."""

    enabled: bool = True
    """false leaves the stage out: surfaces keep their own triangles, also where the sheet has spheres."""
    subdivisions: Annotated[int, Field(ge=3, le=7)] = 6
    """The common mesh: an icosahedron so often divided; 6 gives 40,962 vertices, 5 gives 10,242."""
    template: str | None = None
    """File of another common sphere (.surf.gii), which the spheres of the cases are registered to; {hemi} in its name
    stands for L or R. null: the icosphere."""

    def template_of(self, hemisphere: str | None) -> str | None:
        """File of the common sphere of a hemisphere; None where it is the icosphere."""
        if self.template is None or "{hemi}" not in self.template:
            return self.template
        if hemisphere is None:
            raise InputError(
                f"resample.template = {self.template!r}, but it is not known which hemisphere this is",
                remedy="give L or R in the column hemi of the cohort sheet, or the name without {hemi}",
            )
        return self.template.replace("{hemi}", hemisphere)


class Repair(Section):
    """Repair of broken input surfaces, within limits; what is beyond them or has no single right answer is refused."""

    enabled: bool = True
    """false leaves the stage out: broken surfaces are refused by the gate, which mends only what is harmless."""
    max_displacement: Positive = 1.0
    """Farthest that triangles which cross others may be moved, or lie from those that take their place, mm."""
    max_volume_change: Fraction = 0.02
    """Largest relative change of the volume."""
    max_hole: Positive = 200.0
    """Longest rim of a hole that is filled, mm; the rim of a medial wall that was cut away has some 120 to 180 mm."""
    max_loop: Positive = 30.0
    """Longest loop along which a handle is cut or a tunnel closed, mm."""
    max_piece: Threshold = 0.01
    """Share of the area up to which a separate piece is dropped; of several larger ones none is."""
    method: RepairMethod = "local"
    """local mends what is broken and leaves the rest as it is. voxel, a last resort, replaces a broken surface by a
    new one, a sphere, made on a grid; of the keys above, only the change of volume limits it."""
    spacing: Positive = 0.3
    """Spacing of the grid of voxel, mm: what is thinner is lost."""


class Gate(Section):
    """Input gate: what a surface must be before anything else happens to it."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"unit", "affine"}

    allow_genus: NonNegativeInt = 0
    """Largest genus accepted. 0: a sphere, as a hemisphere must be."""
    unit: Literal[tuple(UNITS)] = "mm"  # type: ignore[valid-type]
    """Unit of the coordinates of the input surfaces: mm, m, cm or um. A column `unit` of the sheet overrides it."""
    affine: Path | Annotated[list[list[float]], Field(min_length=4, max_length=4)] | None = None
    """Coordinates are voxel indices: an image (.nii.gz, .mgz) with their voxel-to-mm affine, or its four rows. A column
    `affine` of the sheet, relative to its folder, overrides it. null: they are none."""


class SmoothSurface(Section):
    """Smoothing of the input surface, as much as it is rough, or by gestational age as in the paper (PyMeshLab)."""

    enabled: bool = True
    """false leaves the stage out: the surface is meshed as the gate lets it through."""
    method: SmoothingMethod = "taubin"
    """taubin removes stair steps without shrinking, where there are some; published smooths by gestational age, and is
    left out where that is not known."""
    max_roughness: Positive = 0.03
    """taubin: roughness (mean bi-Laplacian along the normals over the mean edge) up to which a surface is not smoothed;
    atlas surfaces have 0.006 to 0.027, the stair steps of a label image 0.11."""
    max_area_change: Fraction = 0.08
    """Largest relative change of the area; stair steps have some of their own, which goes with them."""
    max_volume_change: Fraction | None = 0.01
    """Largest relative change of the volume; null: no limit."""
    max_displacement: Positive = 0.05
    """Largest mean distance to the unsmoothed surface, mm: a tenth of a voxel of 0.5 mm. Of taubin from surface to
    surface, of published from vertex to nearest vertex."""

    def runs(self, *, aged: bool) -> bool:
        """The published method asks for the age."""
        return self.enabled and (aged or self.method != "published")


class Regions(Section):
    """Meshes with inner surfaces (column `inner` of the sheet): what is between them and the outer one."""

    #: S1 makes these elements; their number changes nothing here
    choices: ClassVar[frozenset[str]] = Section.choices | {"elements_across"}

    min_gap: Annotated[float, Field(gt=0, le=2)] = 0.5
    """Distance that inner surfaces keep from the one around them, a fraction of h: where they are nearer, as at the
    medial wall, they are moved inward."""
    max_outside: Positive = 0.5
    """Farthest that an inner surface may lie outside the one around it and still be moved inside, mm."""
    elements_across: Annotated[int, Field(ge=1, le=6)] = 1
    """Tetrahedra through the cortex, between the outer surface and those inside it, at least: cells there become
    smaller for it, down to 0.35 h, and grow to h away from it. The certificate says what came of it."""


_EDGE_LENGTHS = [1.25, 1.2, 1.15, 1.1, 1.0, 0.9, 0.8, 0.7, 0.6]


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
    fallback: Literal["lattice"] | None = "lattice"
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

    @property
    def passes(self) -> tuple[str, ...]:
        """CGAL's optimisation passes, in the order it runs them."""
        return tuple(name for name in ("odt", "lloyd", "perturb", "exude") if getattr(self, name))


class Transfer(Section):
    """S2, and once more before S5: the surface's fields on the nodes of the mesh."""

    interior: Interior = "nearest"
    """Values of interior nodes: nearest takes those of the nearest boundary node, harmonic solves Laplace's equation.
    Labels always come from the nearest boundary node."""


class Relocate(Section):
    """S3: Gmsh Relocate3D."""

    enabled: bool = False
    """true adds the stage; it does not improve the elements of the lattice mesher."""
    passes: PositiveInt = 5
    """Number of Relocate3D passes."""
    boundary: Literal["fixed", "free"] = "fixed"
    """fixed keeps boundary nodes where S1 put them, on the surface; free lets Gmsh move them too."""

    def excludes_inner_surfaces(self) -> str:
        """Gmsh is given the boundary only."""
        return "relocate.enabled: true"


class Clean(Section):
    """S4: worst-element cleaning; only vertices move."""

    enabled: bool = True
    """false leaves the stage out."""
    thresholds: Annotated[list[Threshold], Field(min_length=1)] = [0.7, 0.5, 0.3]
    """One pass per threshold: the vertices of elements with q above it are moved. Where `improve_mean` is false, passes
    around them also move those above half of the lowest."""
    boundary: Boundary = "slide"
    """slide lets boundary nodes move along the input surface, fixed holds them, free lets them leave it."""
    improve_mean: bool = True
    """Sweeps over all vertices before and after the passes, which improve the mean; the published tool has none."""
    backend: Literal["cortet", "meshtool"] = "cortet"
    """cortet: our own kernel; meshtool: an installed meshtool binary (boundary free, improve_mean false)."""

    def programs(self) -> dict[str, str]:
        """Meshtool, where it is the backend."""
        return {"meshtool": "clean.backend: cortet"} if self.backend == "meshtool" else {}

    def excludes_inner_surfaces(self) -> str:
        """A boundary that is free leaves the interfaces, too."""
        return "clean.boundary: free" if self.boundary == "free" else ""

    @model_validator(mode="after")
    def _backend_has_it(self) -> Clean:
        if self.enabled and self.backend == "meshtool" and (self.boundary != "free" or self.improve_mean):
            raise ValueError(
                "backend meshtool moves the boundary freely and has no passes for the mean: "
                "set clean.boundary: free and clean.improve_mean: false"
            )
        return self


class Reconnect(Section):
    """S4+: local swaps where moving vertices cannot help; connectivity changes."""

    enabled: bool = True
    """false leaves the stage out."""
    threshold: Threshold = 0.3
    """Swaps are tried around elements with q above this."""
    boundary: Boundary = "slide"
    """What boundary nodes may do when vertices move, as in clean; fixed also keeps every boundary edge."""
    insert: bool = True
    """true also inserts nodes inside, where no swap helps: between the banks of blades, behind corners."""

    def excludes_inner_surfaces(self) -> str:
        """A boundary that is free leaves the interfaces, too."""
        return "reconnect.boundary: free" if self.boundary == "free" else ""


class SmoothBoundary(Section):
    """Post-mesh smoothing of the boundary (paper, section 4.4), with a cleaning of its own."""

    enabled: bool = False
    """true adds the stage."""
    method: BoundarySmoothing = "laplacian"
    """laplacian: PyMeshLab's surface-preserving one; workbench: wb_command -surface-smoothing, if it is installed."""
    iterations: PositiveInt = 3
    """Iterations; halved, up to four times, when an element inverts."""
    onto_surface: bool = True
    """true puts the boundary back onto the surface after each iteration; false lets it leave it."""
    thresholds: list[Threshold] = [0.7, 0.5]
    """Passes of the cleaning afterwards, as in clean; a further one at 0.3 does not converge here (paper)."""

    def programs(self) -> dict[str, str]:
        """Connectome Workbench, where it is the method."""
        return {"wb_command": "smooth_boundary.method: laplacian"} if self.method == "workbench" else {}

    def excludes_inner_surfaces(self) -> str:
        """Interfaces that left their surfaces would meet."""
        return "" if self.onto_surface else "smooth_boundary.onto_surface: false"


class Snap(Section):
    """S6: boundary nodes to the nearest point of the input surface."""

    enabled: bool = False
    """true adds the stage; after `boundary: slide` there is nothing left for it to do."""
    q_max: Threshold = 0.6
    """Elements that snapping makes worse than this are repaired."""
