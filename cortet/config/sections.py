"""Sections of what is before and after the line of stages: the cohort, its files for solvers, the experiments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError, model_validator

from cortet.formats import FORMATS
from cortet.geometry.limits import FOLD_AGES
from cortet.meshers import MESHERS
from cortet.sections import Cases, CellSize, NonNegativeInt, Positive, PositiveInt, Section, Subdivisions
from cortet.simulation.section import Fold
from cortet.stages import MESH_STAGES

Setting = Literal["default", "cgal", "published"]
TenNodeSolver = Literal["abaqus", "febio", "fenics", "gmsh", "vtu"]
PredictionKind = Literal[
    "mechanics", "core", "forecast", "uniform", "shuffled", "unmapped", "braingrowth", "path", "nothing"
]
if TYPE_CHECKING:
    Mesher = str
    Solver = str
    StageName = str
else:  # what may be chosen from the lists of meshers, formats and stages
    Mesher = Literal[tuple(MESHERS)]
    Solver = Literal[tuple(FORMATS)]
    StageName = Literal[tuple(MESH_STAGES)]


class Scan(Section):
    """How `cortet cohort scan` reads a data release. Placeholders: {participant}, {session}, {hemi}, {entities}."""

    surfaces: list[str] = [
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_wm.surf.gii",
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_white.surf.gii",
        "sub-{participant}/ses-{session}/anat/sub-{participant}{entities}_smoothwm.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_wm.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_white.surf.gii",
        "sub-{participant}/anat/sub-{participant}{entities}_smoothwm.surf.gii",
        "sub-{participant}/surf/{hemi}.white",
        "sub-{participant}_ses-{session}/surf/{hemi}.white",
        "sub-{participant}/ses-{session}/surf/{hemi}.white",
        "{participant}/surf/{hemi}.white",
        "{participant}/T1w/Native/{participant}.{hemi}.white.native.surf.gii",
    ]
    """Where surfaces lie below the release's folder; the first pattern that finds a case wins, but a surface in the
    space of a template (_space-MNI...) comes last. They may be packed by gzip (.gz). {entities} are any of BIDS, such
    as _ses-1_run-2_hemi-L_space-T1w. A pattern that begins with {participant}/ takes folders of any name, as
    FreeSurfer's and HCP's, but sub-... and fsaverage."""
    pial: bool = False
    """true: a pial surface beside a white one becomes the surface, and the white one its inner surface."""
    fields: dict[str, list[str]] = {}
    """Fields beside a surface, by name: what stands in their file names in the place of `white.surf.gii`, of
    FreeSurfer's of `white`; the first that exists wins, e.g. {thickness: [thickness], parcel: [aparc.annot]}."""
    spheres: list[str] = ["sphere.reg*.surf.gii", "desc-reg_sphere.surf.gii", "sphere.surf.gii", "sphere.reg"]
    """Spheres beside a surface, through which it is resampled (section resample): what stands in their names in the
    place of `white.surf.gii`, of FreeSurfer's of `white`; the first that exists wins. []: none."""
    volumes: dict[str, list[str]] = {
        "tissue": [
            "sub-{participant}/ses-{session}/anat/sub-{participant}_ses-{session}_desc-drawem9_dseg.nii.gz",
            "sub-{participant}/anat/sub-{participant}_desc-drawem9_dseg.nii.gz",
        ]
    }
    """Volumes whose labels or numbers tetrahedra get, by name: patterns below the folder, of which the first that
    exists wins. {}: none."""
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


class Quality(Section):
    """Quality records beside the meshes."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"stages"}

    stages: list[StageName] = ["generate", "relocate", "clean", "solver_ready"]
    """Stages whose mesh is measured (those that are enabled)."""


class Export(Section):
    """Files for solvers, each verified as written."""

    formats: list[Solver] = ["braingrowth"]
    """Formats to write: braingrowth (.mesh), abaqus (.inp, CalculiX reads it too), febio (.feb), fenics (.xdmf), gmsh
    (.msh), gmsh_v2 (.v2.msh, version 2.2), nastran (.bdf), vtu, vtk (legacy), carp (.pts), carp_binary (.bpts); and of
    the boundary stl and gifti (.surf.gii)."""
    ten_nodes: list[TenNodeSolver] = []
    """Formats in which the mesh is also written with elements of ten nodes that follow the surface: abaqus (.inp),
    febio (.feb), fenics (.xdmf), gmsh (.msh), vtu."""
    uncertified: bool = False
    """true also exports meshes that are not certified."""
    carp_unit: Literal["mm", "um"] = "um"
    """Unit of the coordinates in CARP files: um for openCARP, mm for meshtool."""
    cortex_depth: Positive = 1.5
    """Tetrahedra whose centroid is less than this below the cortical surface, mm, are cortex, the others core."""
    cortex_layer: bool | None = None
    """Whether a mesh without inner surfaces has such a layer. null: unless the surface is a white one, which has the
    cortex outside it. CalculiX, FEBio and FEniCS grow the layer."""
    cortex_thickness: str | None = None
    """Field of the cohort, mm, that takes the place of cortex_depth, e.g. thickness."""
    medial_wall: dict[str, list[int]] = {}
    """Label fields and their keys that mark the medial wall, e.g. {parcellation: [0]}; the rest is cortical surface."""
    holes: list[str] = []
    """Inner regions without tetrahedra in the files, e.g. [ventricle]; their walls are the faces `hole_surface`."""
    tags: str | None = None
    """Volume of labels whose labels take the place of the regions, e.g. tissue: a format with one number for each
    tetrahedron holds one of the two. null: the regions."""
    label_shares: bool = False
    """true also writes the share of each label in each tetrahedron, for volumes of labels."""
    field_units: dict[str, str] = {}
    """Units of the fields, e.g. {thickness: mm}, for the sidecars."""

    def sets(self, kind: str | None) -> dict[str, Any]:
        """Arguments of `cortet.solver_files.sets.named_sets`.

        Parameters
        ----------
        kind : of the surface, `formats.gifti.kind_of`
        """
        layer = kind != "white" if self.cortex_layer is None else self.cortex_layer
        named = self.model_dump(mode="json", include={"cortex_depth", "cortex_thickness", "medial_wall", "tags"})
        return {**named, "cortex_layer": layer}


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


class Prediction(Section):
    """Later brains predicted from growth that was measured: `snakemake prediction`. Folds are as in `fold`."""

    participants: list[str] = []
    """Participants whose surfaces of several ages have vertices that correspond: a series each, by hemisphere. Empty:
    all that have two ages or more."""
    cell_size: CellSize = 1.1
    """Cell size h, mm, of the mesh of the first surface."""
    kinds: list[PredictionKind] = [
        *("mechanics", "core", "forecast"),
        *("uniform", "shuffled", "unmapped", "braingrowth", "path", "nothing"),
    ]
    """What is predicted from. mechanics: growth until the last age. core: the same, and the core grows as the later
    surfaces let it: what it would be worth to know this. forecast: growth until an early age, which goes on
    as in usual brains. The rest is what they have to beat. uniform: the same growth everywhere. shuffled: growth turned
    at random on the sphere, where the sheet has one. unmapped: the model of fold without growth that was measured.
    braingrowth: the model of that name, in which only the cortex grows.
    path: each vertex goes on as it went until the early age. nothing: the first surface, scaled to the volume."""
    until: Annotated[float, Field(ge=FOLD_AGES[0], le=FOLD_AGES[1])] = 32.0
    """The early age, weeks: a forecast knows surfaces up to there."""
    rounds: Annotated[int, Field(ge=1, le=10)] = 3
    """Rounds in which the growth that has to be imposed is found: compressed tissue grows less than it is told to."""
    smoothing: Annotated[float, Field(ge=0, le=50)] | None = None
    """Smoothing of measured growth along the surface, full width at half maximum, mm; null: as much as noise asks
    for."""
    seed: NonNegativeInt = 0
    """Of the random rotation of shuffled."""
    uncertain: list[PredictionKind] = []
    """Kinds that are predicted once more under each of variants. How far these predictions lie apart is a map, and
    whether the truth lies among them are columns of the table."""
    variants: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], dict[str, Any]] = {
        "coarser": {"cell_size": 1.4},
        "turned": {"seed": 1},
        "softer": {"core_stiffness": 0.1875},
        "stiffer": {"core_stiffness": 0.125},
        "thinner": {"thickness": 1.0},
        "thicker": {"thickness": 1.5},
    }
    """Variants, name: what differs, cell_size, seed (of generate: the direction in which the mesh is made), or keys of
    fold. By default stiffness and thickness of the cortex are 20 % lower and higher."""

    @model_validator(mode="after")
    def _variants_are_valid(self) -> Prediction:
        same_in_all = {
            "path": "is not folded, so it has no variants",
            "nothing": "is not folded, so it has no variants",
            "braingrowth": "has constants of its own, which no variant changes",
        }
        if same := [kind for kind in self.uncertain if kind in same_in_all]:
            raise ValueError(f"uncertain: {same[0]} {same_in_all[same[0]]}")
        for name, changed in self.variants.items():
            own = {key: value for key, value in changed.items() if key in ("cell_size", "seed")}
            try:
                Prediction(**own, variants={}), Fold(**{key: changed[key] for key in changed.keys() - own.keys()})
            except ValidationError as error:
                first = error.errors()[0]
                raise ValueError(f"variant {name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        return self


class Experiments(Section):
    """The experiments of the paper, on this cohort: `snakemake tables figures`."""

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
    prediction: Prediction = Prediction()
