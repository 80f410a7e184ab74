"""The typed configuration: every key with its unit, its default and what it does.

One model describes the whole file. `load` reads a YAML file (or the dict Snakemake hands over), `render` writes the
documented YAML that `config.yaml` is checked against, and `Config.stage` gives the plain dict of one stage's
parameters that the workflow compares between runs.

Named settings give the stage parameters their defaults: those of `default` stand in the models below, the others
replace some of them (`SETTINGS`). `cgal` takes the paper's mesher and Gmsh, with our choices for the boundary and for
S4; `published` takes all choices of the CORTET paper (arXiv:2607.12157). A key in the configuration overrides each.
"""

from __future__ import annotations

import ast
import difflib
import itertools
import reprlib
import shutil
import textwrap
from collections.abc import Iterator, Mapping
from functools import cache
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveInt,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo

from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.atomic import atomic_path
from cortet.formats.placement import UNITS, matrix
from cortet.formats.untrusted import content
from cortet.geometry.limits import CELL_SIZE_MM, SUBDIVISIONS
from cortet.meshers import BASELINES, MESHERS, installed_backend
from cortet.simulation.growth import AGES
from cortet.stages import MESH_STAGES, STAGES, Stage

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(gt=0, le=1)]
Threshold = Annotated[float, Field(gt=0, lt=1)]
Boundary = Literal["fixed", "slide", "free"]
Setting = Literal["default", "cgal", "published"]
if TYPE_CHECKING:
    Mesher = str
    Solver = str
    StageName = str
else:  # what may be chosen from the lists of meshers, formats and stages
    Mesher = Literal[tuple(MESHERS | BASELINES)]
    Solver = Literal[tuple(FORMATS)]
    StageName = Literal[tuple(MESH_STAGES)]


def _as_list(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else [value]


def _whole_micrometres(value: float) -> float:
    if not isfinite(value * 1000) or abs(value * 1000 - round(value * 1000)) > 1e-6:
        raise ValueError("must be a multiple of 0.001 mm: files are named by it (res-600um)")
    return round(value, 3)


CellSize = Annotated[Positive, AfterValidator(_whole_micrometres), Field(ge=CELL_SIZE_MM[0], le=CELL_SIZE_MM[1])]
Subdivisions = Annotated[int, Field(ge=SUBDIVISIONS[0], le=SUBDIVISIONS[1])]
#: those to which a column of the sheet says yes
Column = Annotated[dict[Literal["column"], str], Field(min_length=1)]
#: `all` cases of the sheet, so many of them, spread over the ages, those that are named, or those of a column
Cases = Literal["all"] | NonNegativeInt | list[str] | Column


class Section(BaseModel):
    """A part of the configuration; unknown keys are errors, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class Scan(Section):
    """How `cortet cohort scan` reads a data release. Placeholders: {participant}, {session}, {hemi}."""

    surfaces: list[str] = [
        "sub-{participant}/ses-{session}/anat/sub-{participant}_ses-{session}_hemi-{hemi}_wm.surf.gii",
        "sub-{participant}/ses-{session}/anat/sub-{participant}_ses-{session}_hemi-{hemi}_white.surf.gii",
        "sub-{participant}/anat/sub-{participant}_hemi-{hemi}_wm.surf.gii",
        "sub-{participant}/anat/sub-{participant}_hemi-{hemi}_white.surf.gii",
        "sub-{participant}/surf/{hemi}.white",
    ]
    """Where surfaces lie below the release's folder; the first pattern that finds a case wins."""
    pial: bool = False
    """true: a pial surface beside a white one becomes the surface, and the white one its inner surface."""
    spheres: list[str] = ["sphere.reg*.surf.gii", "desc-reg_sphere.surf.gii", "sphere.surf.gii", "sphere.reg"]
    """Spheres beside a surface, through which it is resampled (section resample): what stands in their names in the
    place of `white.surf.gii`, of FreeSurfer's of `white`; the first that exists wins. []: none."""
    sessions: str = "sub-{participant}/sub-{participant}_sessions.tsv"
    """Table of a participant's sessions."""
    participants: str = "participants.tsv"
    """Table of all participants, used where the sessions table has no age."""
    age_columns: list[str] = ["scan_age", "gestational_age", "ga", "age"]
    """Columns that may hold the gestational age at scan; the first that exists is read, in the unit that the sidecar of
    the table gives (Units), else in weeks. The column age of BIDS counts from birth, in years: it is read where its
    sidecar says weeks, or where this key is set."""


class Cohort(Section):
    """The surfaces to mesh."""

    sheet: Path = Path("demo/cohort.tsv")
    """Cohort sheet (TSV); `cortet cohort scan` writes one. File names in it are relative to the sheet's folder.
    The surface `phantom` stands for a synthetic cortex of the row's scan_age and hemi."""
    dataset: Path | None = None
    """Root of the dataset that the surfaces come from, `bids:raw:` in the sidecars. null: the folder of the sheet."""
    fields: dict[str, str] = {}
    """Per-vertex fields (.shape/.func/.label.gii) of every case, name: file pattern. Placeholders are the columns of
    the sheet, e.g. thickness: "../{participant_id}/{session_id}/thickness_hemi-{hemi}.shape.gii"; names are relative
    to the sheet's folder. A sheet column `field_<name>` overrides the pattern for its row."""
    scan: Scan = Scan()


class Phantom(Section):
    """Synthetic fetal cortex surfaces (`phantom` in the sheet)."""

    subdivisions: Subdivisions = 5
    """Subdivisions of the icosahedron: 5 gives 10,242 vertices, 6 gives 40,962."""
    seed: NonNegativeInt = 0
    """Seed of the individual variation of the sulci."""
    thickness: Positive = 1.5
    """Distance of the synthetic white surface (`phantom` in the column `inner`) below the cortex, mm; folds of 30 weeks
    and more have no room for that."""


class Resample(Section):
    """Surfaces with a sphere (column `sphere` of the sheet) on a mesh that all cases share: vertices correspond."""

    enabled: bool = True
    """false leaves the stage out: surfaces keep their own triangles, also where the sheet has spheres."""
    subdivisions: Annotated[int, Field(ge=3, le=7)] = 6
    """The common mesh: an icosahedron so often divided; 6 gives 40,962 vertices, 5 gives 10,242."""
    template: str | None = None
    """File of another common sphere (.surf.gii), which the spheres of the cases are registered to; {hemi} in its name
    stands for L or R. null: the icosphere."""


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
    method: Literal["local", "voxel"] = "local"
    """local mends what is broken and leaves the rest as it is. voxel, a last resort, makes a broken surface anew as a
    sphere, on a grid; of the keys above, only the change of volume limits it."""
    spacing: Positive = 0.3
    """Spacing of the grid of voxel, mm: what is thinner is lost."""


class Gate(Section):
    """Input gate: what a surface must be before anything else happens to it."""

    allow_genus: NonNegativeInt = 0
    """Largest genus accepted. 0: a sphere, as a hemisphere must be."""
    unit: Literal[tuple(UNITS)] = "mm"  # type: ignore[valid-type]
    """Unit of the coordinates of the input surfaces: mm, m or um. A column `unit` of the sheet overrides it."""
    affine: Path | Annotated[list[list[float]], Field(min_length=4, max_length=4)] | None = None
    """Coordinates are voxel indices: an image (.nii.gz, .mgz) with their voxel-to-mm affine, or its four rows. A column
    `affine` of the sheet, relative to its folder, overrides it. null: they are none."""


class SmoothSurface(Section):
    """Smoothing of the input surface, as much as it is rough, or by gestational age as in the paper (PyMeshLab)."""

    enabled: bool = True
    """false leaves the stage out: the surface is meshed as the gate lets it through."""
    method: Literal["taubin", "published"] = "taubin"
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


class Regions(Section):
    """Meshes with inner surfaces (column `inner` of the sheet): what is between them and the outer one."""

    min_gap: Annotated[float, Field(gt=0, le=2)] = 0.5
    """Distance that inner surfaces keep from the one around them, a fraction of h: where they are nearer, as at the
    medial wall, they are moved inward."""
    max_outside: Positive = 0.5
    """Farthest that an inner surface may lie outside the one around it and still be moved inside, mm."""
    elements_across: Annotated[int, Field(ge=1, le=6)] = 1
    """Tetrahedra through the cortex, between the outer surface and those inside it, at least: cells there become
    smaller for it, down to 0.35 h, and grow to h away from it. The certificate says what came of it."""


class Generate(Section):
    """S1: tetrahedra inside the surface."""

    cell_size: Annotated[list[CellSize], BeforeValidator(_as_list), Field(min_length=1)] = [0.6]
    """Cell size h, mm, a multiple of 0.001: bound of circumradius and surface ball. A list makes one mesh per size."""
    meshers: Annotated[list[Mesher], BeforeValidator(_as_list), Field(min_length=1)] = ["lattice"]
    """Meshers: lattice (ours: better elements, ten times faster), cgal (published), or with its own defaults one of
    tetgen, ftetwild, gmsh and netgen. Every stage after S1 is the same for all of them."""
    backend: Literal["auto", "pygalmesh", "cgal"] = "auto"
    """Package that runs CGAL: pygalmesh (compiled from source), cgal (wheel), auto: pygalmesh where installed."""
    facet_angle: Annotated[float, Field(gt=0, le=30)] = 25.0
    """Smallest angle of a boundary triangle, degrees; refinement ends for certain only up to 30."""
    facet_distance: Annotated[list[Fraction], BeforeValidator(_as_list), Field(min_length=1)] = [0.5, 0.2, 0.1, 0.05]
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
    edge_length: Annotated[list[Positive], BeforeValidator(_as_list), Field(min_length=1)] = [
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


class Transfer(Section):
    """S2, and once more before S5: the surface's fields on the nodes of the mesh."""

    interior: Literal["nearest", "harmonic"] = "nearest"
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


class SmoothBoundary(Section):
    """Post-mesh smoothing of the boundary (paper, section 4.4), with a cleaning of its own."""

    enabled: bool = False
    """true adds the stage."""
    method: Literal["laplacian", "workbench"] = "laplacian"
    """laplacian: PyMeshLab's surface-preserving one; workbench: wb_command -surface-smoothing, if it is installed."""
    iterations: PositiveInt = 3
    """Iterations; halved, up to four times, when an element inverts."""
    onto_surface: bool = True
    """true puts the boundary back onto the surface after each iteration; false lets it leave it."""
    thresholds: list[Threshold] = [0.7, 0.5]
    """Passes of the cleaning afterwards, as in clean; a further one at 0.3 does not converge here (paper)."""


class Snap(Section):
    """S6: boundary nodes to the nearest point of the input surface."""

    enabled: bool = False
    """true adds the stage; after `boundary: slide` there is nothing left for it to do."""
    q_max: Threshold = 0.6
    """Elements that snapping makes worse than this are repaired."""


class Certify(Section):
    """What a mesh must be to be called solver-ready."""

    q_max: Threshold = 0.6
    """Worst element: q (0 regular, 1 degenerate) must be below this."""
    max_boundary_distance: Positive | None = 1e-3
    """Largest distance of a boundary node to the surface that was meshed, mm; null: no limit."""
    max_face_distance: Positive | None = 0.75
    """Largest distance of the centre of a boundary face to the surface, a fraction of h; null: no limit."""
    min_bank_gap: Fraction | None = 0.03
    """Smallest gap between banks of the boundary, through the outside, a fraction of the surface's own gap there (at
    most an edge of the boundary); null: no limit."""
    max_surface_distance: Positive | None = 0.5
    """Largest distance of the surface (vertices and face centres) to the boundary, a fraction of h; null: no limit."""
    max_mean_surface_distance: Positive | None = 0.1
    """The same, on average; null: no limit."""
    max_area_change: Positive | None = 0.05
    """Largest relative change of the area against the surface, of either sign; null: no limit."""
    max_volume_change: Positive | None = 0.1
    """Largest relative change of the volume against the surface, of either sign; null: no limit."""
    max_native_distance: Positive | None = 1.0
    """Largest distance between the boundary and the native surface, as it was read, of both directions, a fraction of
    h; null: no limit. This and the next two do not apply to surfaces that were repaired."""
    max_mean_native_distance: Positive | None = 0.2
    """The same, on average; null: no limit."""
    max_native_area_change: Positive | None = 0.1
    """Largest relative change of the area against the native surface, of either sign; null: no limit."""


class Quality(Section):
    """Quality records beside the meshes."""

    stages: list[StageName] = ["generate", "relocate", "clean", "solver_ready"]
    """Stages whose mesh is measured (those that are enabled)."""


class Export(Section):
    """Files for solvers, each verified as written."""

    formats: list[Solver] = ["braingrowth"]
    """Formats to write: braingrowth (.mesh), abaqus (.inp, CalculiX reads it too), febio (.feb), fenics (.xdmf), gmsh
    (.msh), vtu, carp (.pts), carp_binary (.bpts); and of the boundary stl and gifti (.surf.gii)."""
    uncertified: bool = False
    """true also exports meshes that are not certified."""
    carp_unit: Literal["mm", "um"] = "um"
    """Unit of the coordinates in CARP files: um for openCARP, mm for meshtool."""
    cortex_depth: Positive = 1.5
    """Tetrahedra whose centroid is less than this below the cortical surface, mm, are cortex, the others core."""
    cortex_thickness: str | None = None
    """Field of the cohort, mm, that takes the place of cortex_depth, e.g. thickness."""
    medial_wall: dict[str, list[int]] = {}
    """Label fields and their keys that mark the medial wall, e.g. {parcellation: [0]}; the rest is cortical surface."""
    field_units: dict[str, str] = {}
    """Units of the fields, e.g. {thickness: mm}, for the sidecars."""

    @property
    def sets(self) -> dict[str, Any]:
        """Arguments of `cortet.solver_files.sets.named_sets`."""
        return self.model_dump(mode="json", include={"cortex_depth", "cortex_thickness", "medial_wall"})


class Ablation(Section):
    """What each stage does (the paper's Table 1, and the pooled quality of its Fig. 2), beside other meshers."""

    cases: Cases = "all"
    """Cases at the cell sizes of `generate`: all, a number of them spread over the ages, or a list of their names."""
    further: dict[CellSize, Cases] = {}
    """Further cell sizes, mm, and the cases that are meshed with each, e.g. {0.6: [sub-01_hemi-L]}."""
    meshers: list[Mesher] = ["cgal", "tetgen"]
    """Meshers beside those of `generate`, through the same S3 and S4: lattice, or with its own defaults one of tetgen,
    ftetwild, gmsh and netgen. Where one of these four fails, a row of the table says so."""
    time_limit: PositiveInt = 60
    """Minutes that tetgen, ftetwild, gmsh or netgen may take for one surface."""


class Resolution(Section):
    """Element count and quality against the cell size (the paper's Table 2)."""

    cases: Cases = 3
    """Cases: all, a number of them spread over the ages, or a list of their names."""
    cell_size: list[CellSize] = [0.4, 0.6, 0.8]
    """Cell sizes h, mm."""


class Measures(Section):
    """Worst element by three further measures of the literature."""

    cases: Cases = 3
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names."""


class Series(Section):
    """Pictures of meshes over the ages, on one scale."""

    cases: Cases = 4
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names. Both
    hemispheres are drawn where the sheet has them."""


class Convergence(Section):
    """Folding against the cell size: `snakemake convergence`. What is folded, and until when, is as in `fold`."""

    cases: Cases = 1
    """Cases: all, a number of them spread over the ages, or a list of their names."""
    cell_size: Annotated[list[CellSize], Field(min_length=2)] = [1.6, 1.2, 0.9]
    """Cell sizes h, mm; three or more, in about equal ratios, allow an extrapolation to h = 0."""
    seeds: Annotated[list[NonNegativeInt], Field(min_length=1)] = [0, 1]
    """Realisations of a mesh (`generate.seed`): directions in which it is made. How much they differ is chance."""
    meshers: Annotated[list[Mesher], Field(min_length=1)] = ["lattice", "cgal"]
    """Meshers: lattice, cgal."""


class Experiments(Section):
    """The experiments of the paper, on this cohort: `snakemake tables figures report`."""

    settings: list[Setting] = ["default", "cgal", "published"]
    """Settings to compare, from S3 on. Each is run on the meshes of its own mesher, so `cgal` and `published` on the
    same ones, and on those of tetgen, ftetwild, gmsh and netgen."""
    reference_meshes: list[Path] = []
    """Tetrahedral meshes in the format of BrainGrowth (Tallinen), measured beside ours."""
    ablation: Ablation = Ablation()
    resolution: Resolution = Resolution()
    measures: Measures = Measures()
    series: Series = Series()
    convergence: Convergence = Convergence()


class Fold(Section):
    """Folding simulation of meshes: growth of the cortex until it buckles (the model of the BrainGrowth solver)."""

    cases: Cases | None = None
    """Cases whose meshes are folded: all, a number of them spread over the ages, a list of their names, as file names
    begin: sub-01_ses-02_hemi-L, or those to which a column of the sheet says yes: {column: simulated}. null: those of
    the column fold, where the sheet has one. Each from its scan_age on, as half a brain where hemi is L or R. Point
    data of the mesh named growth (0 to 1), thickness (mm), medial_wall and label are used; fields of the sheet become
    them."""
    variants: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], dict[str, Any]] = {}
    """Further runs of each of these cases, name: keys of this section that differ, e.g.
    {thin: {thickness: 1.0}, stiff: {core_stiffness: 2.0}}."""
    end: Annotated[float, Field(ge=AGES[0], le=AGES[1])] = 40.0
    """Gestational age at which a run ends, weeks."""
    growth_rate: Positive = 1.829
    """Tangential growth of the cortex per unit of time (0 at 22 weeks, 1 at 44)."""
    core_stiffness: Positive = 1.167
    """Shear modulus of what does not grow, over that of the growing cortex."""
    regions: dict[int, Annotated[list[Finite], Field(min_length=3, max_length=3)]] = {}
    """Growth of single regions: value of the field label, then amplitude, rate and latency of a Gompertz law."""
    thickness: Positive | None = None
    """Thickness of the growing cortex at the start, mm; null: 0.042 of half the length of the brain at 22 weeks, 1.25
    mm, and slightly more later. A run says which."""
    time_step: Positive | None = None
    """Largest dimensionless time step; null: from the smallest altitude of the tetrahedra, as the run goes on."""
    reference: bool = False
    """true: centre, mask, medial plane, start of growth and lag of the reference implementation, for comparison."""
    record_interval: Positive = 0.1
    """Weeks between two rows of the table of a run."""
    frame_interval: Positive = 1.0
    """Weeks between two frames (.vtu) of a run."""
    device: Literal["cpu", "cuda"] = "cpu"
    """What takes the steps of a run: cpu, or cuda for a GPU of NVIDIA (`pip install 'cortet[gpu]'`), where the workflow
    lets one job at a time have one. A result is reproducible bit for bit on one device, not across devices."""

    @model_validator(mode="after")
    def _variants_are_valid(self) -> Fold:
        own = self.model_dump(exclude={"variants", "cases"})
        for name, changed in self.variants.items():
            if not changed or {"variants", "cases"} & set(changed):
                raise ValueError(f"variant {name}: name keys of fold that differ, other than cases and variants")
            try:
                Fold(**{**own, **changed})
            except ValidationError as error:
                first = error.errors()[0]
                raise ValueError(f"variant {name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        return self


class Config(Section):
    """The whole configuration."""

    setting: Setting = "default"
    """Named set of stage parameters: `default` (ours: lattice mesher, no Gmsh), `cgal` (the paper's mesher and Gmsh,
    then ours) or `published` (the CORTET paper's). Keys below override it."""
    output: Path = Path("derivatives/cortet")
    """Folder of everything that is made (BIDS derivative)."""
    keep_intermediates: bool = True
    """false deletes the mesh of every stage but the last as soon as nothing needs it any more, CARP files of S2
    included: a third of the disk, but a changed parameter of any stage runs the line from S1 on.
    `snakemake --delete-temp-output` deletes those of earlier runs."""
    time_limit: Positive | None = 1440.0
    """Minutes a job may take before it is ended and its case has failed; null: no limit."""
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
    quality: Quality = Quality()
    export: Export = Export()
    fold: Fold = Fold()
    experiments: Experiments = Experiments()

    def enabled(self, stage: str) -> bool:
        """Whether the line of stages contains `stage`."""
        return bool(getattr(getattr(self, stage, None), "enabled", True))

    def smooths(self, *, aged: bool) -> bool:
        """Whether the surface of a case is smoothed; the published method asks for its age."""
        return self.enabled("smooth_surface") and (aged or self.smooth_surface.method != "published")

    def line(self, *, nested: bool = False, registered: bool = False, aged: bool = True) -> list[Stage]:
        """The stages that run, in their order.

        Parameters
        ----------
        nested : whether the surface has inner ones
        registered : whether it has a sphere
        aged : whether its age is known
        """
        return [
            stage
            for stage in STAGES.values()
            if (self.smooths(aged=aged) if stage.name == "smooth_surface" else self.enabled(stage.name))
            and (nested or not stage.nested)
            and (registered or not stage.registered)
        ]

    def require_programs(self) -> None:
        """Raise InputError naming a program that the line calls and that is not installed here."""
        called = {
            "meshtool": self.clean.enabled and self.clean.backend == "meshtool" and "clean.backend: cortet",
            "wb_command": self.smooth_boundary.enabled
            and self.smooth_boundary.method == "workbench"
            and "smooth_boundary.method: laplacian",
        }
        for program, instead in called.items():
            if instead and shutil.which(program) is None:
                raise InputError(
                    f"the program {program} is not installed", remedy=f"put it on the PATH, or set {instead}"
                )

    def require_nesting(self, nested: bool) -> None:
        """Raise InputError where inner surfaces meet a mesher or a stage that knows no interfaces."""
        if not nested:
            return
        for key, in_the_way in {
            f"generate.meshers: {', '.join(self.generate.meshers)}": self.generate.meshers != ["lattice"],
            "relocate.enabled: true": self.relocate.enabled,
            "smooth_boundary.onto_surface: false": self.smooth_boundary.enabled
            and not self.smooth_boundary.onto_surface,
            "clean.boundary: free": self.clean.enabled and self.clean.boundary == "free",
            "reconnect.boundary: free": self.reconnect.enabled and self.reconnect.boundary == "free",
        }.items():
            if in_the_way:
                raise InputError(
                    f"{key} knows no inner surfaces", remedy="use the setting `default` for cases that have some"
                )

    def notices(self) -> list[str]:
        """What a user should know before the line runs, in plain words."""
        if "cgal" in self.generate.meshers and self.generate.backend == "auto" and installed_backend() != "pygalmesh":
            return [
                "pygalmesh, the paper's tool, is not installed: CGAL runs by the `cgal` wheel, the same library in "
                "another version and without a seed (`make published` compiles pygalmesh, once, in some ten minutes)"
            ]
        return []

    def arguments(self, step: str, facts: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Plain, JSON-able keyword arguments of the function of a stage, or of another step of the workflow.

        Parameters
        ----------
        step : name of its section
        facts : what is known of the mesh that is asked for, by the names in `_FACTS`
        """
        name, keys = _PARTS.get(step, (step, None))
        section = getattr(self, name, None)
        values = section.model_dump(mode="json", include=keys, exclude=_CHOICES) if section is not None else {}
        if step == "generate" and (facts or {}).get("nested"):
            values["elements_across"] = self.regions.elements_across
        if step == "resample" and values["template"]:
            values["template"] = self.template((facts or {})["hemisphere"])
        if step == "repair":  # handles that the gate lets in stay
            values["allow_genus"] = self.gate.allow_genus
        if values.get("backend") == "auto":  # meshes of a cohort must come from one backend
            values["backend"] = installed_backend()
        return {**values, **{name: (facts or {})[name] for name in _FACTS.get(step, ())}}

    def template(self, hemisphere: str | None) -> str | None:
        """File of the common sphere of a hemisphere; None where it is the icosphere.

        Raises
        ------
        InputError
            its name depends on the hemisphere, which is not known
        """
        name = self.resample.template
        if name and "{hemi}" in name:
            if hemisphere is None:
                raise InputError(
                    f"resample.template = {name!r}, but it is not known which hemisphere this is",
                    remedy="give L or R in the column hemi of the cohort sheet, or the name without {hemi}",
                )
            name = name.replace("{hemi}", hemisphere)
        return name

    def placement(
        self, unit: str | None = None, affine: str | Path | None = None
    ) -> tuple[tuple[float, ...], ...] | None:
        """Matrix that takes coordinates as stored to mm (`formats.placement.matrix`); None where they are mm.

        Parameters
        ----------
        unit, affine : of one case; None: as `gate.unit` and `gate.affine` say
        """
        return matrix(unit or self.gate.unit, affine or self.gate.affine)

    def record(self, step: str, facts: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The arguments of a step beside the version of its code, as certificates record them."""
        placement = (facts or {}).get("placement") if step == "gate" else None
        return {
            **self.arguments(step, facts),
            **({"to_mm": placement} if placement else {}),
            "version": version_of(_MODULES.get(step, f"stages.{step}")),
        }


#: keys that choose what is run, and are arguments of no function
_CHOICES = {"enabled", "cell_size", "meshers", "cases", "stages", "variants", "unit", "affine"}
#: steps that take another section than that of their name, or some of its keys
_PARTS: dict[str, tuple[str, set[str] | None]] = {
    "phantom": ("phantom", {"subdivisions", "seed"}),
    "phantom_inner": ("phantom", {"thickness"}),
    "separate": ("regions", {"min_gap", "max_outside"}),
    "solver_ready": ("transfer", None),  # S5 carries the fields onto the final positions as S2 did
}
#: arguments that differ from mesh to mesh, and stand in no section
_FACTS = {
    "phantom": ("gestational_age", "hemisphere"),
    "resample": ("sphere_file",),
    "repair": ("source",),
    "gate": ("source",),
    "smooth_surface": ("gestational_age",),
    "separate": ("cell_size",),
    "generate": ("cell_size", "mesher"),
    "clean": ("cell_size",),
    "reconnect": ("cell_size",),
    "certify": ("cell_size",),
    "fold": ("gestational_age", "hemisphere"),
}
#: modules of the steps that are no stages
_MODULES = {
    "phantom": "phantom",
    "quality": "measure.quality",
    "certify": "measure.certify",
    "export": "solver_files.export",
    "fold": "simulation.fold",
}


#: the paper's mesher and Gmsh: section -> key -> value
CGAL: dict[str, dict[str, Any]] = {
    "generate": {"meshers": ["cgal"]},
    "relocate": {"enabled": True},
    # its facets may be half a cell from the surface, and more at creases
    "certify": {
        "max_surface_distance": 1.0,
        "max_face_distance": 1.0,
    },
}

#: where the paper's choices differ from ours
PUBLISHED: dict[str, dict[str, Any]] = {
    "repair": {"enabled": False},
    "smooth_surface": {
        "method": "published",
        "max_area_change": 0.06,
        "max_volume_change": None,
        "max_displacement": 0.25,
    },
    "generate": {"meshers": ["cgal"], "facet_distance": [0.5], "fallback": None},
    "relocate": {"enabled": True, "boundary": "free"},
    "clean": {"boundary": "free", "improve_mean": False},
    "reconnect": {"enabled": False},
    "smooth_boundary": {"iterations": 10, "onto_surface": False},
    "certify": {
        "max_boundary_distance": None,
        "max_face_distance": None,
        "min_bank_gap": None,
        "max_surface_distance": None,
        "max_mean_surface_distance": None,
        "max_area_change": None,
        "max_volume_change": None,
        "max_native_distance": None,
        "max_mean_native_distance": None,
        "max_native_area_change": None,
    },
}

#: parameters of the named settings, where they differ from the defaults
SETTINGS: dict[str, dict[str, Any]] = {"cgal": CGAL, "published": PUBLISHED}


def load(source: Path | str | Mapping[str, Any]) -> Config:
    """The validated configuration of a YAML file or a plain dict.

    Raises `InputError` naming every offending key with its value and, for an unknown key, the nearest known one.
    """
    data = read(Path(source)) if isinstance(source, (str, Path)) else dict(source)
    place = source if isinstance(source, (str, Path)) else "configuration"
    if sum(1 for _ in itertools.islice(_values(data), _MOST_VALUES + 1)) > _MOST_VALUES:
        raise InputError(f"holds more than {_MOST_VALUES:,} values", file=place, remedy="use fewer aliases (*name)")
    data = _overlaid(SETTINGS.get(str(data.get("setting")), {}), _without_empty_sections(data, Config))
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        lines = [_complaint(problem) for problem in error.errors(include_url=False)]
        raise InputError("; ".join(lines), file=place) from None


@cache
def version_of(module: str) -> int:
    """`VERSION` of a module of cortet (`stages.clean`), read from its source: importing it would load Numba or Gmsh."""
    path = _PACKAGE.joinpath(*module.split(".")).with_suffix(".py")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == "VERSION" for target in targets):
            return int(ast.literal_eval(node.value))  # type: ignore[attr-defined]
    raise LookupError(f"{path} declares no VERSION")


def render(data: Mapping[str, Any]) -> str:
    """Documented YAML of a configuration: keys in `data` are set, the others shown as comments with their default."""
    head = (
        "# Configuration of cortet. Keys that are commented out show their value in the `default` setting.\n"
        "# Use another file with `snakemake --configfile FILE`, or change single keys with\n"
        "# `snakemake --config setting=published generate='{cell_size: 1.0}'`.\n"
    )
    return head + "".join(_rendered(Config, data, SETTINGS, indent=0, commented=False))


def refresh(path: Path | str) -> None:
    """Rewrite a configuration file: the keys that are set stay, documentation and other keys become the model's."""
    with atomic_path(path) as temporary:
        temporary.write_text(render(read(Path(path))), encoding="utf-8")


def read(path: Path) -> dict[str, Any]:
    """The content of a YAML file of the configuration, not validated.

    Raises
    ------
    InputError
        it cannot be read, holds no keys, or holds one twice
    """
    remedy = "give a YAML file of keys and values"
    try:
        data = yaml.load(content(path, largest=_LONGEST_FILE).decode("utf-8"), Loader=_UniqueKeys)
    except _Twice as error:
        raise InputError(str(error), file=path, remedy="keep one of the two, with the keys of both") from None
    except (ValueError, TypeError, AttributeError, RecursionError, yaml.YAMLError) as error:  # what PyYAML lets through
        raise InputError(f"cannot be read: {error}", file=path, remedy=remedy) from None
    if not isinstance(data, dict):
        raise InputError("holds no keys", file=path, remedy=remedy)
    return data


class _Twice(Exception):  # noqa: N818, becomes an InputError
    """A key that a mapping of a YAML file holds twice."""


class _UniqueKeys(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses what YAML forbids and PyYAML does: to take the last of two values of a key."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Raise _Twice for a key that occurs twice."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                line = key.start_mark.line + 1
                if lines.setdefault(key.value, line) != line:
                    raise _Twice(f"key {key.value} stands in line {lines[key.value]} and in line {line}")
        return super().construct_mapping(node, deep)


_PACKAGE = Path(__file__).parent
#: of a configuration: bytes, and values when aliases are written out
_LONGEST_FILE, _MOST_VALUES = 10_000_000, 100_000


def _without_empty_sections(data: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """The data without sections that are null: YAML makes that of one whose keys are all commented out."""
    kept = {}
    for key, value in data.items():
        info = model.model_fields.get(key)
        section = info.annotation if info and _is_section(info) else None
        if isinstance(value, Mapping) and section:
            kept[key] = _without_empty_sections(value, cast(type[BaseModel], section))
        elif value is not None or not (section or model is Config):
            kept[key] = value
    return kept


def _values(data: Any) -> Iterator[Any]:
    """All values, with everything that an alias stands for; without end where it stands for itself."""
    waiting = [data]
    while waiting:
        value = waiting.pop()
        yield value
        if isinstance(value, Mapping):
            waiting += [*value.values(), *value]
        elif isinstance(value, (list, set, tuple)):
            waiting += value


def _overlaid(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over` put on top, section by section."""
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _overlaid(result[key], value) if both else value
    return result


def _complaint(problem: Any) -> str:
    """One finding of pydantic in the user's words."""
    *parents, last = [str(part) for part in problem["loc"]]
    name = ".".join([*parents, last])
    if problem["type"] != "extra_forbidden":
        return f"{name} = {reprlib.repr(problem['input'])}: {problem['msg']}"
    model: Any = Config
    for parent in parents:
        model = model.model_fields[parent].annotation
    here, everywhere = list(model.model_fields), {key.rpartition(".")[2]: key for key in _keys(Config)}
    for known in (here, list(everywhere)):
        if nearest := difflib.get_close_matches(last, known, n=1, cutoff=0.7):
            suggestion = ".".join([*parents, nearest[0]]) if known is here else everywhere[nearest[0]]
            return f"unknown key {name}; did you mean {suggestion}?"
    return f"unknown key {name}; known here: {', '.join(here)}"


def _keys(model: type[BaseModel], parents: str = "") -> Iterator[str]:
    """Dotted names of all keys, sections included."""
    for name, info in model.model_fields.items():
        yield parents + name
        if _is_section(info):
            yield from _keys(cast(type[BaseModel], info.annotation), f"{parents}{name}.")


def _is_section(info: FieldInfo) -> bool:
    return isinstance(info.annotation, type) and issubclass(info.annotation, Section)


def _rendered(
    model: type[BaseModel],
    data: Mapping[str, Any],
    settings: Mapping[str, Mapping[str, Any]],
    *,
    indent: int,
    commented: bool,
) -> Iterator[str]:
    pad = " " * indent
    for name, info in model.model_fields.items():
        given = data.get(name)
        hidden = "# " if commented or name not in data else ""
        if _is_section(info):
            section: Any = info.annotation
            yield f"\n{pad}# {section.__doc__}\n{pad}{hidden}{name}:\n"
            below = {setting: values.get(name, {}) for setting, values in settings.items()}
            yield from _rendered(section, given or {}, below, indent=indent + 2, commented=bool(hidden))
            continue
        text = " ".join((info.description or "").split())
        text += "".join(f" {setting}: {_yaml(values[name])}" for setting, values in settings.items() if name in values)
        yield "\n" if indent == 0 else ""
        yield textwrap.indent(textwrap.fill(text, 118 - indent, break_long_words=False), f"{pad}# ") + "\n"
        yield f"{pad}{hidden}{name}: {_yaml(given if name in data else info.default)}\n"


def _yaml(value: Any) -> str:
    """One line of YAML for one value."""
    plain = value.as_posix() if isinstance(value, Path) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=10_000)
    return text.removesuffix("\n").removesuffix("\n...")
