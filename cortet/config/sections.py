"""Sections of what is before and after the line of stages: the cohort, its files for solvers, its experiments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, NonNegativeInt, PositiveInt

from cortet.config.section import (
    AsShares,
    Cases,
    CellSize,
    Fraction,
    MesherName,
    Positive,
    Section,
    Subdivisions,
    Threshold,
)
from cortet.formats import FORMATS
from cortet.geometry.limits import LEAST_BANK_GAP, MOST_LAYERS

#: presets that differ in what follows a mesher
Compared = Literal["default", "cgal", "published"]
TenNodeSolver = Literal["abaqus", "febio", "fenics", "gmsh", "vtu"]
if TYPE_CHECKING:
    Solver = str
else:  # a literal of names that come from a list is no type to mypy
    Solver = Literal[tuple(FORMATS)]


class Scan(Section):
    """How `cortet cohort scan` reads a data release. Placeholders: {participant}, {session}, {hemi}, {entities}."""

    surfaces: list[str] = [
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_wm.surf.gii",
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_white.surf.gii",
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_smoothwm.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_wm.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_white.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_smoothwm.surf.gii",
        "sub-{participant}_ses-{session}.long.sub-{participant}/surf/{hemi}.white",
        "sub-{participant}/surf/{hemi}.white",
        "sub-{participant}_ses-{session}/surf/{hemi}.white",
        "sub-{participant}/ses-{session}/surf/{hemi}.white",
        "{participant}/surf/{hemi}.white",
        "{participant}/T1w/Native/{participant}.{hemi}.white.native.surf.gii",
    ]
    """Patterns of the surfaces, relative to the dataset. The first pattern that finds a case is used, but a surface in
    the space of a template (_space-MNI...) comes last. Surfaces may be gzipped (.gz). {entities} matches any BIDS
    entities, such as _ses-1_run-2_hemi-L_space-T1w. A pattern that begins with {participant}/ matches folders of any
    name except sub-..., fsaverage and cvs_avg35, as FreeSurfer and HCP have them."""
    pial: bool = False
    """true: where a white surface has a pial one next to it, the pial surface is meshed and the white one is inside."""
    fields: dict[str, list[str]] = {}
    """Fields next to a surface, by name: the ending that replaces `white.surf.gii` (for FreeSurfer `white`) in the file
    name. The first file that exists is used, e.g. {thickness: [thickness], parcel: [aparc.annot]}."""
    spheres: list[str] = ["sphere.reg*.surf.gii", "desc-reg_sphere.surf.gii", "sphere.surf.gii", "sphere.reg"]
    """Registered spheres next to a surface, used for resampling (section resample): the ending that replaces
    `white.surf.gii` (for FreeSurfer `white`) in the file name. The first file that exists is used. []: none."""
    volumes: dict[str, list[str]] = {
        "tissue": [
            "sub-{participant}/ses-{session}/anat/sub-{participant}_ses-{session}_desc-drawem9_dseg.nii.gz",
            "sub-{participant}/anat/sub-{participant}_desc-drawem9_dseg.nii.gz",
        ]
    }
    """Volumes whose labels or values are transferred to tetrahedra, by name: patterns relative to the dataset. The
    first file that exists is used. {}: none."""
    sessions: str = "sub-{participant}/sub-{participant}_sessions.tsv"
    """Table of the sessions of a participant."""
    participants: str = "participants.tsv"
    """Table of all participants, used if the sessions table has no age."""
    age_columns: list[str] = ["scan_age", "gestational_age", "ga"]
    """Columns that may hold the gestational age at scan. The first that exists is read, in the unit that the sidecar of
    the table states (`Units`: weeks or days), else in weeks. BIDS counts the column `age` in years from birth, so name
    it here only if its ages are gestational."""


class Cohort(Section):
    """The surfaces to mesh."""

    sheet: Path = Path("demo/cohort.tsv")
    """Cohort sheet (TSV), as `cortet cohort scan` writes it. File names are relative to the folder of the sheet. The
    surface `phantom` is a synthetic cortex with the scan_age and hemi of the row."""
    dataset: Path | None = None
    """Root of the dataset of the surfaces (`bids:raw:` in sidecars). null: the folder of the sheet."""
    scan: Scan = Scan()


class Phantom(Section):
    """Synthetic fetal cortex surfaces (`phantom` in the sheet)."""

    subdivisions: Subdivisions = 5
    """Subdivisions of the icosahedron: 5 gives 10,242 vertices, 6 gives 40,962."""
    seed: NonNegativeInt = 0
    """Seed of the random variation of the sulci."""
    thickness: Positive = 1.5
    """Depth of the synthetic white surface (`phantom` in the column `inner`) below the cortical surface, mm. From 30
    weeks on, the folds are too narrow for the default."""


class Export(Section):
    """Files for solvers."""

    formats: list[Solver] = ["vtu"]
    """Formats to write: vtu (ParaView, meshio, PyVista), abaqus (.inp, also read by CalculiX), febio (.feb), fenics
    (.xdmf), braingrowth (.mesh), gmsh (.msh, version 2.2), nastran (.bdf), carp (.pts); for the boundary alone stl and
    gifti (.surf.gii)."""
    ten_nodes: list[TenNodeSolver] = []
    """Formats in which the mesh is also written with ten-node elements that follow the surface: abaqus (.inp), febio
    (.feb), fenics (.xdmf), gmsh (.msh), vtu."""
    uncertified: bool = False
    """true also exports meshes that are not certified, under names that say so: `…Uncertified_sets.vtu`."""
    carp_unit: Literal["mm", "um"] = "um"
    """Unit of the coordinates in CARP files: um for openCARP, mm for meshtool."""
    cortex_depth: Positive = 1.5
    """Thickness of the cortex, mm: tetrahedra whose centroid is less deep are cortex, the others core."""
    cortex_layer: bool | None = None
    """Whether a mesh without inner surfaces has this layer of cortex. null: yes, unless the surface is a white surface,
    whose cortex lies outside."""
    cortex_thickness: str | None = None
    """Field of the cohort, mm, that replaces cortex_depth, e.g. thickness."""
    medial_wall: dict[str, list[int]] = {}
    """Label fields and the keys that mark the medial wall, e.g. {parcellation: [0]}. All other faces are cortex."""
    tags: str | None = None
    """Label volume whose labels replace the regions as the numbers of tetrahedra, e.g. tissue. Formats with one number
    per tetrahedron cannot hold both. null: the regions."""
    layers: Annotated[list[Positive], AsShares, Field(min_length=1, max_length=MOST_LAYERS)] | None = None
    """Layers of a cortex around an inner surface `white`: their number, or the share of the volume of each from the
    pial surface on, e.g. [1, 1, 2]. Files then have the sets layer_1, ..., and the fields column, thickness_mm, depth
    and depth_equivolumetric. null: none."""

    def sets(self, kind: str | None) -> dict[str, Any]:
        """Arguments of `cortet.solver_files.sets.named_sets`.

        Parameters
        ----------
        kind : of the surface, `formats.gifti.kind_of`
        """
        layer = kind != "white" if self.cortex_layer is None else self.cortex_layer
        named = self.model_dump(mode="json", include={"cortex_depth", "cortex_thickness", "medial_wall", "tags"})
        if self.layers is not None:
            named["layers"] = self.layers
        return {**named, "cortex_layer": layer}


class Certify(Section):
    """Limits that a mesh must meet to be certified."""

    q_max: Threshold = 0.6
    """Upper limit of the worst q (0: regular tetrahedron, 1: degenerate)."""
    max_boundary_distance: Positive | None = 1e-3
    """Largest distance from a boundary node to the meshed surface, mm. null: no limit."""
    max_face_distance: Positive | None = 0.75
    """Largest distance from the centre of a boundary face to the surface, as a fraction of h. null: no limit."""
    min_bank_gap: Fraction | None = LEAST_BANK_GAP
    """Smallest gap between opposite banks of a sulcus in the mesh, as a fraction of the gap of the surface there (gaps
    wider than an edge of the boundary do not count). null: no limit."""
    max_surface_distance: Positive | None = 0.5
    """Largest distance from the surface (vertices and face centres) to the boundary, as a fraction of h. null: no
    limit."""
    max_mean_surface_distance: Positive | None = 0.1
    """Largest mean of these distances, as a fraction of h. null: no limit."""
    max_area_change: Positive | None = 0.05
    """Largest relative difference in area from the surface, of either sign. null: no limit."""
    max_volume_change: Positive | None = 0.1
    """Largest relative difference in volume from the surface, of either sign. null: no limit."""
    max_native_distance: Positive | None = 1.0
    """Largest distance between the boundary and the native (input) surface, in both directions, as a fraction of h.
    null: no limit. Of a repaired surface, this and the next two limits hold for the surface after its repair."""
    max_mean_native_distance: Positive | None = 0.2
    """Largest mean of these distances, as a fraction of h. null: no limit."""
    max_native_area_change: Positive | None = 0.1
    """Largest relative difference in area from the native surface, of either sign. null: no limit."""
    max_repaired_area: Fraction | None = 0.12
    """Largest fraction of the area of a surface that repair may have made. A medial wall that was cut out takes 3 to
    11 %, a fetal brain without its front third 19 %. null: no limit."""
    max_repaired_volume: Fraction | None = 0.03
    """Largest volume between the caps on holes and flat caps, as a fraction of the volume in the surface. It is up to
    2 % where a medial wall was cut out, and 4 % where a tenth of the brain is missing. null: no limit."""


class Ablation(Section):
    """Effect of each stage, next to other meshers (Table 1 and Fig. 2 of the paper)."""

    cases: Cases = "all"
    """Cases at the cell sizes of `generate`: all, a number of them spread over the ages, or a list of their names."""
    further: dict[CellSize, Cases] = {}
    """Further cell sizes, mm, and the cases to mesh with each, e.g. {0.6: [sub-01_hemi-L]}."""
    meshers: list[MesherName] = []
    """Further meshers, each followed by the same S3 and S4: lattice, cgal, or with its own defaults tetgen, ftetwild,
    gmsh or netgen. If one of these four fails, the table has a row for the failure. The paper compares cgal and
    tetgen."""
    time_limit: PositiveInt = 60
    """Longest run time of tetgen, ftetwild, gmsh or netgen on one surface, minutes."""


class Resolution(Section):
    """Number and quality of elements by cell size (Table 2 of the paper)."""

    cases: Cases = 3
    """Cases: all, a number of them spread over the ages, or a list of their names."""
    cell_size: list[CellSize] = []
    """Cell sizes h, mm; empty: those of `generate`. The paper compares 0.4, 0.6 and 0.8."""


class Measures(Section):
    """Worst element by three other quality measures."""

    cases: Cases = 3
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names."""


class Series(Section):
    """Pictures of meshes at several ages, on one scale."""

    cases: Cases = 4
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names. Both
    hemispheres are drawn if the sheet has them."""


class Experiments(Section):
    """The experiments of the paper, on this cohort: `snakemake tables figures`."""

    settings: list[Compared] = []
    """Presets to compare with that of the run, from S3 on: default, cgal, published. Each runs on the meshes of its own
    mesher (so `cgal` and `published` share theirs) and on those of tetgen, ftetwild, gmsh and netgen."""
    reference_meshes: list[Path] = []
    """Tetrahedral meshes in BrainGrowth format (Tallinen) to measure next to ours."""
    ablation: Ablation = Ablation()
    resolution: Resolution = Resolution()
    measures: Measures = Measures()
    series: Series = Series()
