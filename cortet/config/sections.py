"""Sections of what is before and after the line of stages: the cohort, its records, its files for solvers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from cortet.config.section import Fraction, NonNegativeInt, Positive, Section, Subdivisions, Threshold
from cortet.formats import FORMATS
from cortet.geometry.limits import LEAST_BANK_GAP

TenNodeSolver = Literal["abaqus", "febio", "fenics", "gmsh", "vtu"]
if TYPE_CHECKING:
    Solver = str
else:  # a literal of names that come from a list is no type to mypy
    Solver = Literal[tuple(FORMATS)]
StageName = Literal["generate", "transfer", "relocate", "clean", "reconnect", "smooth_boundary", "snap", "solver_ready"]


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


class Figures(Section):
    """Figures over all cases."""

    journal: Literal["cortet", "nature", "elsevier", "plos", "ieee"] = "cortet"
    """Width of the page, font, size of letters: cortet (183 mm, DejaVu Sans, 7 pt), nature (183 mm, Arial, 7 pt),
    elsevier (190 mm, Arial, 7 pt), plos (190.5 mm, Arial, 8 pt) or ieee (182 mm, Times, 8 pt). Where the font is not
    installed, Liberation's of the same widths takes its place, else DejaVu Sans. Colours are those that colour-blind
    readers tell apart."""


class Export(Section):
    """Files for solvers."""

    formats: list[Solver] = ["vtu"]
    """Formats to write: vtu (ParaView, meshio, PyVista), abaqus (.inp, CalculiX reads it too), febio (.feb), fenics
    (.xdmf), braingrowth (.mesh), gmsh (.msh, version 2.2), nastran (.bdf), carp (.pts); and of the boundary stl and
    gifti (.surf.gii)."""
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
    map: bool = False
    """true also writes, beside each mesh, the matrices from its nodes to the vertices of the surface as it was read
    (.to_surface.npz) and back (.from_surface.npz), for scipy.sparse.load_npz."""
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


class Certify(Section):
    """What a mesh must be to be called solver-ready."""

    q_max: Threshold = 0.6
    """Worst element: q (0 regular, 1 degenerate) must be below this."""
    max_boundary_distance: Positive | None = 1e-3
    """Largest distance of a boundary node to the surface that was meshed, mm; null: no limit."""
    max_face_distance: Positive | None = 0.75
    """Largest distance of the centre of a boundary face to the surface, a fraction of h; null: no limit."""
    min_bank_gap: Fraction | None = LEAST_BANK_GAP
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
