"""The section `fold` of the configuration: the only source of the defaults and limits of a fold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, ValidationError, model_validator

from cortet.config.section import Cases, Finite, Positive, Section
from cortet.geometry.limits import FOLD_AGES

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
#: shortest relaxation time, weeks: below a time step, relaxation takes energy that no account has
_SHORTEST = 0.01


def _not_below_a_step(time: Any) -> Any:
    """A relaxation time, or times at ages; ValueError for one below `_SHORTEST`."""
    for one in time.values() if isinstance(time, Mapping) else [time]:
        if one != "elastic" and one < _SHORTEST:
            raise ValueError(f"a time of {one:g} weeks is below a time step: give {_SHORTEST:g} weeks or more")
    return time


#: gestational age, weeks
Age = Annotated[float, Field(ge=FOLD_AGES[0], le=FOLD_AGES[1])]
#: growth per week from 22 weeks on, or growth since then at ages: {22: 0, 30: 0.3, 38: 0.8}
Amount = Annotated[float, Field(ge=-1e4, le=1e4, allow_inf_nan=False)]
AtAges = Annotated[dict[Age, Positive], Field(min_length=1)]
#: relaxation time, weeks, or at ages
Time = Annotated[Positive | AtAges | Literal["elastic"], AfterValidator(_not_below_a_step)]
ByAge = Amount | Annotated[dict[Age, Amount], Field(min_length=1)]


class Fold(Section):
    """Folding simulation of meshes: growth of the cortex until it buckles."""

    choices: ClassVar[frozenset[str]] = Section.choices | {"variants", "real_surfaces", "picture"}

    cases: Cases | None = None
    """Cases whose meshes are folded: all, a number of them spread over the ages, a list of their names, as file names
    begin: sub-01_ses-02_hemi-L, or those to which a column of the sheet says yes: {column: simulated}. null: those of
    the column fold, where the sheet has one. Each from its scan_age on, as half a brain where hemi is L or R. Point
    data of the mesh named growth (0 to 1), thickness (mm), medial_wall and label are used; fields of the sheet become
    them."""
    variants: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], dict[str, Any]] = {}
    """Further runs of each of these cases, name: keys of this section that differ, e.g.
    {thin: {thickness: 1.0}, stiff: {core_stiffness: 2.0}}."""
    real_surfaces: dict[Age, Path] = {}
    """Real brains that pictures show beside the simulated ones of their age, gestational age: closed surface in mm and
    RAS coordinates, of the same hemisphere; {hemi} in its name stands for L or R:
    {22: "atlas/week22_hemi-{hemi}_white.surf.gii"}."""
    end: Age = 40.0
    """Gestational age at which a run ends, weeks."""
    model: Model = "growing"
    """growing: a brain that grows as a whole, its cortex more than its core. braingrowth: only the cortex grows, as in
    the BrainGrowth solver, so the brain stays as small as it was."""
    growth_rate: ByAge | None = None
    """Tangential growth of the cortex. Of growing: relative to the core, per week from 22 weeks on, or since then at
    ages, {22: 0, 30: 0.3, 38: 0.8}. Of braingrowth: per unit of time (0 at 22 weeks, 1 at 44). null: that of the
    model."""
    thickness_rate: ByAge | None = None
    """Of growing: change of the thickness that the cortex has without stress, relative to that of 22 weeks, per week or
    at ages. null: that of the model."""
    volume: dict[Age, Positive] | None = None
    """Of growing: volume of the body at ages, {22: 20, 34: 79}; only ratios count. The core grows so that the whole
    does this. null: a law fitted to healthy hemispheres of 22 to 42 weeks."""
    start: Literal["stressed", "free"] = "stressed"
    """Of growing, for a mesh of later than 22 weeks. stressed: what its cortex should have grown by then, and its shape
    does not show, comes in the first week. free: growth since its age alone, as it always is where growth was measured
    (point data growth_to_AGE)."""
    envelope: bool | None = None
    """Of growing, where null is true: whether an envelope, as soft as a membrane with fluid behind it, keeps crowns
    from growing beyond it: the convex hull at the start, grown as `hull` says."""
    hull: dict[Age, Positive] | None = None
    """Of growing: volume of the convex hull at ages, {22: 25, 34: 106}; only ratios count. null: a law fitted to
    healthy hemispheres of 22 to 40 weeks."""
    core_regions: dict[int | str, ByAge] = {}
    """Of growing: region of the mesh by its number, or of an exported mesh a set of tetrahedra by its name
    (tissue_thalamus), and how much more than the rest of the core its lengths grow, per week from 22 weeks on or since
    then at ages: a ventricle that shrinks has values below 0. Of two sets that share tetrahedra the later counts."""
    core_stiffness: Positive | None = None
    """Shear modulus of the core over that of the cortex. null: that of the model."""
    region_stiffness: dict[int | str, Positive] = {}
    """Shear modulus of single regions of the core over that of the cortex, as `core_stiffness` is that of the rest: a
    region by its number, or a set of tetrahedra by its name, as in `core_regions`. How much a region resists a change
    of its volume stays that of the whole body."""
    core_relaxation: Time | None = None
    """Of growing: time in which shear stress in the core relaxes, weeks, or at ages, {22: 0.5, 34: 1}: tissue that is
    pulled grows, as white matter does. elastic: it does not. null: that of the model."""
    region_relaxation: dict[int | str, Time] = {}
    """The same of single regions of the core, as in `core_regions`."""
    regions: dict[int, Annotated[list[Finite], Field(min_length=3, max_length=3)]] = {}
    """Growth of single regions: value of the field label, then amplitude, rate and latency of a Gompertz law."""
    allow_volume: bool = False
    """true folds a mesh whose volume is below half or above twice that of a human brain of its age."""
    thickness: Positive | None = None
    """Thickness of the growing cortex at the start, mm. null: of growing, that of the model; of braingrowth, 0.042 of
    half the length of the brain at 22 weeks, 1.25 mm, and slightly more later. A run says which."""
    smoothing: Annotated[float, Field(ge=0, le=5)] | None = None
    """Length of the low-pass filter that takes ripples off the surface before it folds, mm: waves of 2, 4, 6 and 10
    times the length keep 8, 57, 84 and 97 % of their height. Voxels make such ripples, and folds would grow from them.
    0: none. null: that of the model; of growing 1, of braingrowth 0."""
    time_step: Annotated[float, Field(ge=1e-8, le=1)] | None = None
    """Largest dimensionless time step; null: as long as stability allows, measured at
    each row of the table."""
    reference: bool = False
    """true: centre, mask, medial plane, start of growth and lag of the reference implementation, for comparison; of
    braingrowth."""
    record_interval: Positive = 0.1
    """Weeks between two rows of the table of a run."""
    frame_interval: Positive = 1.0
    """Weeks between two frames (.vtu) of a run."""
    surfaces: list[Age] = []
    """Weeks at which the folded cortex comes home to the vertices of its own surface, with maps of depth, curvature,
    gyrification, thickness, growth of area, and stress in the cortex and in the white matter below: [28, 34]."""
    picture: Measure | None = None
    """Map that folded.png shows at the weeks of `surfaces`: depth, cortex_stress, ... null, or no such week: folds
    every four weeks, beside real brains."""

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
            what = f"{name} is of the model {other}, not of {self.model}"
            raise ValueError(f"{what}: leave it out, or set model: {other}")
        return self

    @model_validator(mode="after")
    def _variants_are_valid(self) -> Fold:
        own = self.model_dump(include=Fold.model_fields.keys() - self.choices)
        for name, changed in self.variants.items():
            if not changed or self.choices & set(changed):
                raise ValueError(
                    f"variant {name}: name keys of fold that differ, other than "
                    "cases, variants, real_surfaces and picture"
                )
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
