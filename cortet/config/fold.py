"""The section `fold` of the configuration: the only source of the defaults and limits of a fold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError, model_validator

from cortet.config.section import Cases, Finite, Positive, Section
from cortet.geometry.limits import FOLD_AGES, THICKNESS_MM

#: placeholder for the hemisphere in the name of a file
_HEMI = "{hemi}"

Measure = Literal[
    "depth",
    "mean_curvature",
    "gaussian_curvature",
    "local_gyrification",
    "thickness",
    "area_growth",
    "cortex_stress",
    "cortex_pressure",
    "cortex_stretch",
    "white_stress",
    "white_pressure",
    "white_stretch",
]
Model = Literal["growing", "braingrowth"]

#: gestational age, weeks
Age = Annotated[float, Field(ge=FOLD_AGES[0], le=FOLD_AGES[1])]
#: growth per week from 22 weeks on, or growth since then at ages: {22: 0, 30: 0.3, 38: 0.8}
Amount = Annotated[float, Field(ge=-1e4, le=1e4, allow_inf_nan=False)]
AtAges = Annotated[dict[Age, Positive], Field(min_length=1)]
#: weeks between two rows or frames: below, a fold would write without end
Interval = Annotated[float, Field(ge=1e-3, allow_inf_nan=False)]
#: weeks: below a time step, relaxation takes energy that no account has
Weeks = Annotated[float, Field(ge=0.01, allow_inf_nan=False)]
#: relaxation time, or times at ages
Time = Weeks | Annotated[dict[Age, Weeks], Field(min_length=1)] | Literal["elastic"]
ByAge = Amount | Annotated[dict[Age, Amount], Field(min_length=1)]


class Fold(Section):
    """Folding simulation of meshes: growth of the cortex until it buckles."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"variants", "real_surfaces", "picture"}

    cases: Cases | None = None
    """Cases to fold: all, a number of them spread over the ages, or a list of names such as sub-01_ses-02_hemi-L. null:
    the column fold of the sheet, if it has one. Each fold starts at the scan_age of its case, as half a brain if hemi
    is L or R. It uses the point data growth (0 to 1), thickness (mm), medial_wall and label of the mesh, which fields
    of the sheet become."""
    variants: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], dict[str, Any]] = {}
    """Further folds of each case, by name, with the keys of this section that differ, e.g. {thin: {thickness: 1.0},
    stiff: {core_stiffness: 2.0}}."""
    real_surfaces: dict[Age, Path] = {}
    """Real brains to show next to the simulated ones, by gestational age: closed surfaces of the same hemisphere, in mm
    and RAS coordinates. {hemi} in a name stands for L or R: {22: "atlas/week22_hemi-{hemi}_white.surf.gii"}."""
    end: Age = 40.0
    """Gestational age at which a fold ends, weeks."""
    model: Model = "growing"
    """growing: the entire brain grows, the cortex more than the core. braingrowth: only the cortex grows, as in the
    BrainGrowth solver, so the brain does not get larger."""
    growth_rate: ByAge | None = None
    """Tangential growth of the cortex. growing: relative to the core, per week from 22 weeks on, or in total since 22
    weeks at ages, {22: 0, 30: 0.3, 38: 0.8}. braingrowth: per unit of time (0 at 22 weeks, 1 at 44). null: the default
    of the model."""
    thickness_rate: ByAge | None = None
    """growing: change of the stress-free thickness of the cortex relative to 22 weeks, per week or at ages. null: the
    default of the model."""
    volume: AtAges | None = None
    """growing: volume of the brain at ages, {22: 20, 34: 79}; only ratios matter. The core grows so that the brain
    follows it. null: a law fitted to healthy hemispheres of 22 to 42 weeks."""
    start: Literal["stressed", "free"] = "stressed"
    """growing, for meshes older than 22 weeks. stressed: the growth since 22 weeks that the shape of the mesh does not
    show is applied in the first week. free: only growth after the age of the mesh is applied, as always where growth
    was measured (point data growth_to_AGE)."""
    envelope: bool | None = None
    """growing (null: true): whether an envelope, as soft as a membrane with fluid behind it, holds the gyral crowns. It
    is the convex hull at the start, grown as `hull` states."""
    hull: AtAges | None = None
    """growing: volume of the convex hull at ages, {22: 25, 34: 106}; only ratios matter. null: a law fitted to healthy
    hemispheres of 22 to 40 weeks."""
    core_regions: dict[int | str, ByAge] = {}
    """growing: additional growth in length of single regions of the core relative to the rest, per week from 22 weeks
    on or in total at ages. A region is named by its number or, in an exported mesh, by its set of tetrahedra
    (tissue_thalamus). A shrinking ventricle has negative values. Where two sets overlap, the later one applies."""
    core_stiffness: Positive | None = None
    """Shear modulus of the core relative to that of the cortex. null: the default of the model."""
    region_stiffness: dict[int | str, Positive] = {}
    """Shear modulus of single regions of the core relative to that of the cortex; `core_stiffness` applies to the rest.
    Regions are named as in `core_regions`. Their bulk modulus is that of the entire brain."""
    core_relaxation: Time | None = None
    """growing: relaxation time of shear stress in the core, weeks, or at ages, {22: 0.5, 34: 1}: stretched tissue
    grows, as white matter does. elastic: no relaxation. null: the default of the model."""
    region_relaxation: dict[int | str, Time] = {}
    """Relaxation times of single regions of the core, which are named as in `core_regions`."""
    regions: dict[int, Annotated[list[Finite], Field(min_length=3, max_length=3)]] = {}
    """Growth of single regions, by value of the field label: amplitude, rate and latency of a Gompertz law."""
    force: bool = False
    """true also folds a mesh whose cells are larger than 0.6 of the thickness of its cortex, so that they determine the
    width of its folds, or whose volume is less than half or more than twice that of a human brain of its age."""
    thickness: Annotated[float, Field(ge=THICKNESS_MM[0], le=THICKNESS_MM[1])] | None = None
    """Thickness of the growing cortex at the start, mm. null: for growing, the default of the model; for braingrowth,
    0.042 of half the length of the brain (1.25 mm at 22 weeks, slightly more later). The log states the value."""
    smoothing: Annotated[float, Field(ge=0, le=5)] | None = None
    """Length of the low-pass filter that removes ripples from the surface before it folds, mm. Waves of 2, 4, 6 and 10
    times this length keep 8, 57, 84 and 97 % of their height. Voxels leave such ripples, and folds would grow from
    them. 0: no filter. null: the default of the model, 1 for growing and 0 for braingrowth."""
    time_step: Annotated[float, Field(ge=1e-8, le=1)] | None = None
    """Largest dimensionless time step. null: the longest stable step, which is measured at each row of the table."""
    reference: bool = False
    """braingrowth: true takes centre, mask, medial plane, start of growth and lag from the reference implementation,
    for comparison."""
    record_interval: Interval = 0.1
    """Weeks between two rows of the table of a fold."""
    frame_interval: Interval = 1.0
    """Weeks between two frames (.vtu) of a fold."""
    surfaces: list[Age] = []
    """Weeks at which the folded cortex is written on the vertices of the input surface, with maps of depth, curvature,
    gyrification, thickness, area growth, and stress in the cortex and in the white matter below it: [28, 34]."""
    picture: Measure | None = None
    """Map that folded.png shows at the weeks of `surfaces`: depth, cortex_stress, ... null: folded.png shows the folds
    every four weeks next to real brains."""

    @model_validator(mode="after")
    def _keys_are_of_the_model(self) -> Fold:
        of_growing = {
            "thickness_rate": self.thickness_rate is not None,
            "volume": self.volume is not None,
            "hull": self.hull is not None,
            "envelope": bool(self.envelope),
            "core_regions": bool(self.core_regions),
            "core_relaxation": self.core_relaxation is not None,
            "region_relaxation": bool(self.region_relaxation),
            "growth_rate by age": isinstance(self.growth_rate, Mapping),
        }
        wrong = {"reference": self.reference} if self.model == "growing" else of_growing
        other = "braingrowth" if self.model == "growing" else "growing"
        if name := next((name for name, is_set in wrong.items() if is_set), None):
            raise ValueError(f"{name} applies only to model {other}: leave {name} out, or set model: {other}")
        return self

    @model_validator(mode="after")
    def _variants_are_valid(self) -> Fold:
        own = self.model_dump(include=Fold.model_fields.keys() - self.choices)
        for name, changed in self.variants.items():
            if not changed or self.choices & set(changed):
                others = "cases, variants, real_surfaces or picture"
                raise ValueError(f"variant {name} must set keys of fold, but not {others}")
            try:
                Fold(**{**own, **changed})
            except ValidationError as error:
                first = error.errors()[0]
                where = ".".join(map(str, first["loc"]))
                raise ValueError(f"variant {name}: {where + ': ' if where else ''}{first['msg']}") from None
        return self

    def real_surfaces_of(self, hemisphere: str | None) -> dict[float, Path]:
        """The real brains for a hemisphere; for a whole one (None), those whose names depend on none."""
        return {
            age: Path(str(path).replace(_HEMI, hemisphere or ""))
            for age, path in self.real_surfaces.items()
            if hemisphere or _HEMI not in str(path)
        }


class Settings(Fold):
    """What a run needs besides its mesh: the section, and whose brain the mesh is."""

    gestational_age: float
    """Of the mesh, weeks; growth is relative to it."""
    hemisphere: Literal["L", "R"] | None = None
    """Half a brain, which the medial plane confines; null: a whole one."""
