"""The sections of the stages, in the order of the line, and the whole configuration: the only source of defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from cortet.config.fold import Fold
from cortet.config.section import (
    AsList,
    Boundary,
    CellSize,
    Fraction,
    MesherName,
    Positive,
    Section,
    Setting,
    Threshold,
)
from cortet.config.sections import Certify, Cohort, Experiments, Export, Phantom
from cortet.errors import InputError
from cortet.formats.placement import UNITS

Interior = Literal["nearest", "harmonic"]
SmoothingMethod = Literal["taubin", "published"]


class Resample(Section):
    """Resampling of surfaces with a registered sphere (column `sphere`) onto a mesh that all cases share."""

    enabled: bool = True
    """false skips the stage: surfaces keep their own triangles even if the sheet names spheres."""
    subdivisions: Annotated[int, Field(ge=3, le=7)] = 6
    """Number of subdivisions of the icosahedron that is the common mesh: 6 gives 40,962 vertices, 5 gives 10,242."""
    template: str | None = None
    """Sphere (.surf.gii) that replaces the icosphere as the common mesh; the spheres of the cases must be registered to
    it. {hemi} in its name stands for L or R. null: the icosphere."""

    def template_of(self, hemisphere: str | None) -> str | None:
        """File of the common sphere of a hemisphere; None where it is the icosphere."""
        if self.template is None or "{hemi}" not in self.template:
            return self.template
        if hemisphere is None:
            raise InputError(
                f"resample.template = {self.template!r} needs the hemisphere, which is unknown",
                remedy="set the column hemi of the cohort sheet to L or R, or give a name without {hemi}",
            )
        return self.template.replace("{hemi}", hemisphere)


class Repair(Section):
    """Repair of broken input surfaces within limits. A surface is refused if its repair is larger or ambiguous."""

    enabled: bool = True
    """false skips the stage. The gate then refuses broken surfaces; it corrects only harmless faults."""
    max_displacement: Positive = 1.0
    """Largest distance, mm, that repair may move a self-intersecting triangle or place its replacement from it."""
    max_volume_change: Fraction = 0.02
    """Largest relative change of the volume."""
    max_hole: Positive = 200.0
    """Longest rim of a hole that repair fills, mm. A removed medial wall leaves a rim of 120 to 180 mm."""
    max_loop: Positive = 30.0
    """Longest loop, mm, along which repair cuts a handle or closes a tunnel."""
    max_piece: Threshold = 0.01
    """A separate piece is dropped if it has at most this fraction of the area. Two larger pieces are an error."""


class Gate(Section):
    """Checks that every input surface must pass before it is meshed."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"unit"}

    allow_genus: NonNegativeInt = 0
    """Largest accepted genus. 0, a topological sphere, is right for a hemisphere."""
    unit: Literal[tuple(UNITS)] | None = None  # type: ignore[valid-type]
    """Unit of the coordinates of the input surfaces: mm, m, cm or um. A column `unit` of the sheet overrides it. null:
    mm, and the surface must be as large as the brain of a human or a monkey. A stated unit is believed: mm accepts the
    brain of a mouse."""


class SmoothSurface(Section):
    """Smoothing of the input surface (PyMeshLab), by its roughness or, as in the paper, by gestational age."""

    enabled: bool = True
    """false skips the stage."""
    method: SmoothingMethod = "taubin"
    """taubin removes stair steps, if there are any, without shrinking the surface. published smooths by gestational age
    and is skipped if the age is not known."""
    max_roughness: Positive = 0.03
    """taubin: surfaces up to this roughness (mean bi-Laplacian along the normals over the mean edge length) are not
    smoothed. Atlas surfaces have 0.006 to 0.027; the stair steps of a label image have 0.11."""
    max_area_change: Fraction = 0.08
    """Largest relative change of the area. Stair steps add area of their own, which smoothing removes."""
    max_volume_change: Fraction | None = 0.01
    """Largest relative change of the volume; null: no limit."""
    max_displacement: Positive = 0.05
    """Largest mean distance to the unsmoothed surface, mm. The default is a tenth of a 0.5 mm voxel. taubin measures it
    from surface to surface, published from vertex to nearest vertex."""

    def runs(self, *, aged: bool) -> bool:
        """The published method asks for the age."""
        return self.enabled and (aged or self.method != "published")


class Regions(Section):
    """Regions between the outer surface and inner surfaces (column `inner` of the sheet)."""

    #: S1 makes these elements; their number changes nothing here
    choices: ClassVar[frozenset[str]] = Section.choices | {"elements_across"}

    min_gap: Annotated[float, Field(gt=0, le=2)] = 0.5
    """Least distance of an inner surface from the surface around it, as a fraction of h. Where the two are closer, for
    example at the medial wall, the inner surface is moved inward."""
    max_outside: Positive = 0.5
    """Largest distance, mm, by which an inner surface may lie outside the surface around it and still be moved
    inside."""
    elements_across: Annotated[int, Field(ge=1, le=6)] = 1
    """Number of tetrahedra across the cortex, between the outer surface and the inner ones. Cells there become smaller,
    down to 0.35 h, and grow back to h further inside; where that is not enough, as many as fit. The certificate records
    the number reached."""


_EDGE_LENGTHS = [1.25, 1.2, 1.15, 1.1, 1.0, 0.9, 0.8, 0.7, 0.6]


class Generate(Section):
    """S1: tetrahedra inside the surface."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"cell_size", "meshers"}

    cell_size: Annotated[list[CellSize], AsList, Field(min_length=1)] = [0.6]
    """Cell size h, mm, a multiple of 0.001: upper bound of circumradii and surface balls. A list makes one mesh per
    size."""
    meshers: Annotated[list[MesherName], AsList, Field(min_length=1)] = ["lattice"]
    """Meshers: lattice (ours: better elements, ten times faster), cgal (published), or with its own defaults one of
    tetgen, ftetwild, gmsh and netgen. Every stage after S1 is the same for all of them."""
    backend: Literal["auto", "pygalmesh", "cgal"] = "auto"
    """Package that runs CGAL: pygalmesh (compiled from source), cgal (wheel), or auto (pygalmesh if it is
    installed)."""
    facet_angle: Annotated[float, Field(gt=0, le=30)] = 25.0
    """Smallest angle of a boundary triangle, degrees. Above 30 refinement may not terminate."""
    facet_distance: Annotated[list[Fraction], AsList, Field(min_length=1)] = [0.5, 0.2, 0.1, 0.05]
    """Largest distance between the circumcentre of a boundary triangle and the centre of its surface ball, as fractions
    of h. They are tried in this order until the boundary is a closed manifold of the input's genus, since a large
    distance lets narrow sulci fuse."""
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
    """Seed of CGAL's random numbers and of the orientation in which the surface is meshed (0: not rotated)."""
    fallback: Literal["lattice"] | None = "lattice"
    """Mesher to use if no facet distance gives the right topology. null: the case fails."""
    edge_length: Annotated[list[Positive], AsList, Field(min_length=1)] = _EDGE_LENGTHS
    """lattice: edge lengths of the boundary triangles, as fractions of h, tried in this order until none intersect."""
    surface_distance: Annotated[float, Field(gt=0, le=1)] = 0.4
    """lattice: largest distance from the surface to the boundary triangles, as a fraction of h. Edges are shortened
    where needed. S4 and S4+ slide the boundary, which may add 0.07 h."""
    core_ratio: Annotated[float, Field(ge=1, le=8)] = 1.0
    """lattice: ratio of the cell size in the core to h. The cortex keeps h."""
    core_depth: Positive = 6.0
    """lattice: depth below the surface at which the core begins, mm."""
    size_field: str | None = None
    """lattice: field of the surface with the cell size at each vertex, mm, where it should be smaller than h (down to
    0.35 h). Cells grow back to h away from there."""
    sizes: dict[str, Positive] = {}
    """lattice: cell sizes, mm, at the surfaces of regions, where they should be smaller than h (down to 0.35 h), e.g.
    {white: 0.5}. Cells grow back to h away from there."""

    @property
    def passes(self) -> tuple[str, ...]:
        """CGAL's optimisation passes, in the order it runs them."""
        return tuple(name for name in ("odt", "lloyd", "perturb", "exude") if getattr(self, name))


class Transfer(Section):
    """Transfer of the fields of the surface to the nodes of the mesh: in S5, and on request before S3, as S2."""

    enabled: bool = False
    """true also runs S2, which writes its mesh as CARP files, too (.pts, .elem, .lon; um). Nodes move afterwards, so S5
    transfers all fields again. For CARP files of the final mesh, use `export.formats: [carp]`."""
    interior: Interior = "nearest"
    """Values of interior nodes: nearest copies the nearest boundary node, harmonic solves Laplace's equation. Labels
    are always copied from the nearest boundary node."""


class Relocate(Section):
    """S3: Gmsh Relocate3D."""

    enabled: bool = False
    """true runs the stage. It does not improve meshes of the lattice mesher."""
    passes: PositiveInt = 5
    """Number of Relocate3D passes."""
    boundary: Literal["fixed", "free"] = "fixed"
    """fixed keeps boundary nodes on the surface, where S1 placed them. free lets Gmsh move them, too."""


class Clean(Section):
    """S4: worst-element cleaning; only vertices move."""

    enabled: bool = True
    """false skips the stage."""
    thresholds: Annotated[list[Threshold], Field(min_length=1)] = [0.7, 0.5, 0.3]
    """One pass per threshold moves the vertices of elements with q above it. If `improve_mean` is false, further passes
    move those of elements with q above half of the lowest threshold."""
    boundary: Boundary = "slide"
    """slide moves boundary nodes along the input surface, fixed holds them, free lets them leave the surface."""
    improve_mean: bool = True
    """true adds sweeps over all vertices, before and after the passes, that improve the mean q. meshtool has none."""
    backend: Literal["cortet", "meshtool"] = "cortet"
    """cortet: our own kernel. meshtool: an installed meshtool binary (needs boundary: free, improve_mean: false)."""

    @model_validator(mode="after")
    def _backend_has_it(self) -> Clean:
        if self.enabled and self.backend == "meshtool" and (self.boundary != "free" or self.improve_mean):
            raise ValueError(
                "backend meshtool moves the boundary freely and cannot improve the mean q: "
                "set clean.boundary: free and clean.improve_mean: false"
            )
        return self


class Reconnect(Section):
    """S4+: local reconnection of elements that no movement of vertices can improve."""

    enabled: bool = True
    """false skips the stage."""
    threshold: Threshold = 0.3
    """Swaps are tried around elements with a larger q."""
    boundary: Boundary = "slide"
    """Movement of boundary nodes, as in clean. fixed also keeps every boundary edge."""
    insert: bool = True
    """true also inserts interior nodes where no swap helps, for example between the two sides of a thin gyrus. With
    boundary: slide, it also removes boundary nodes that are in the way."""


class SmoothBoundary(Section):
    """Post-mesh smoothing of the boundary (paper, section 4.4), followed by its own cleaning."""

    enabled: bool = False
    """true runs the stage."""
    iterations: PositiveInt = 3
    """Number of iterations of PyMeshLab's surface-preserving filter. It is halved, up to four times, if an element
    inverts."""
    onto_surface: bool = True
    """true projects the boundary back onto the surface after each iteration. false lets it leave the surface."""
    thresholds: list[Threshold] = [0.7, 0.5]
    """Thresholds of the cleaning that follows, as in clean. A pass at 0.3 does not converge here (paper)."""


class Snap(Section):
    """S6: projection of boundary nodes onto the input surface."""

    enabled: bool = False
    """true runs the stage. After `boundary: slide` the nodes lie on the surface already."""
    q_max: Threshold = 0.6
    """Elements that snapping would raise to this q or above are improved first."""


class Config(Section):
    """The whole configuration."""

    setting: Setting = "default"
    """Preset of stage parameters: `default` (lattice mesher, no Gmsh), `folding` (the same, with fine cells in the
    cortex and coarse ones in the core), `cgal` (the paper's mesher and Gmsh, then our stages) or `published` (all
    choices of the CORTET paper). Keys below override it."""
    output: Path = Path("derivatives/cortet")
    """Output folder (BIDS derivative)."""
    keep_intermediates: bool = True
    """false deletes the mesh of every stage except the last once no later stage needs it. That saves 40 % of the disk,
    but a changed parameter of any stage then reruns all stages from S1. `snakemake --delete-temp-output` deletes the
    intermediate meshes of earlier runs."""
    time_limit: Positive | None = 1440.0
    """Longest run time of a job, minutes. A job that takes longer is stopped and its case fails. null: no limit."""
    cohort: Cohort = Cohort()
    phantom: Phantom = Phantom()
    resample: Resample = Resample()
    repair: Repair = Repair()
    gate: Gate = Gate()
    smooth_surface: SmoothSurface = SmoothSurface()
    regions: Regions = Regions()
    generate: Generate = Generate()
    transfer: Transfer = Transfer()
    relocate: Relocate = Relocate()
    clean: Clean = Clean()
    reconnect: Reconnect = Reconnect()
    smooth_boundary: SmoothBoundary = SmoothBoundary()
    snap: Snap = Snap()
    certify: Certify = Certify()
    export: Export = Export()
    fold: Fold = Fold()
    experiments: Experiments = Experiments()

    @field_validator("output")
    @classmethod
    def _without_braces(cls, output: Path) -> Path:
        if {"{", "}"} & set(str(output)):
            raise ValueError("braces in the name of the output folder are wildcards to Snakemake: use another name")
        return output

    @property
    def target(self) -> float | None:
        """Worst q at which the line stops to improve a mesh; None without S4+, which alone reaches it."""
        return self.reconnect.threshold if self.reconnect.enabled else None

    def enabled(self, stage: str) -> bool:
        """Whether the line contains `stage`."""
        return bool(getattr(getattr(self, stage, None), "enabled", True))

    def export_arguments(self, solver: str) -> dict[str, Any]:
        """Arguments of `export` for one format, plain values."""
        return {"solver": solver, "unit": self.export.carp_unit}

    def placement(self, unit: str | None = None) -> float | None:
        """Factor from stored coordinates to mm; None if nobody states their unit, which is then mm.

        Parameters
        ----------
        unit : of one case; None: as `gate.unit` says
        """
        named = unit or self.gate.unit
        return None if named is None else UNITS[named]
