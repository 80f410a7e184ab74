"""What sections of the configuration are made of: their base and the types of their keys."""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    ValidationInfo,
    field_validator,
)

from cortet.geometry.limits import CELL_SIZE_MM, MOST_LAYERS, SUBDIVISIONS


def _as_list(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else [value]


def _shares(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return value
    if type(value) is not int or not 0 < value <= MOST_LAYERS:
        raise ValueError(f"must be a whole number from 1 to {MOST_LAYERS}, or a list of relative volumes")
    return [1.0] * value


def _takes_bool(annotation: Any) -> bool:
    """Whether a type is `bool`, or has it as a part."""
    return annotation is bool or any(map(_takes_bool, get_args(annotation)))


def _whole_micrometres(value: float) -> float:
    if not isfinite(value * 1000) or abs(value * 1000 - round(value * 1000)) > 1e-6:
        raise ValueError("must be a multiple of 0.001 mm, because file names contain whole micrometres (res-600um)")
    return round(value, 3)


#: a single value means a list of one
AsList = BeforeValidator(_as_list)
#: a whole number means so many equal shares
AsShares = BeforeValidator(_shares)
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(gt=0, le=1)]
#: a quality q between a perfect and a flat tetrahedron
Threshold = Annotated[float, Field(gt=0, lt=1)]
#: mm
CellSize = Annotated[Positive, AfterValidator(_whole_micrometres), Field(ge=CELL_SIZE_MM[0], le=CELL_SIZE_MM[1])]
Subdivisions = Annotated[int, Field(ge=SUBDIVISIONS[0], le=SUBDIVISIONS[1])]
#: behaviour of boundary vertices when vertices move: stay, slide along the surface, or move like all others
Boundary = Literal["fixed", "slide", "free"]
#: named sets of stage parameters (`config.settings`)
Setting = Literal["default", "folding", "cgal", "published"]
#: meshers of the line, and those of other projects
MesherName = Literal["cgal", "lattice", "tetgen", "ftetwild", "gmsh", "netgen"]
#: `all` cases of the sheet, a number of them spread over the ages, or those named
Cases = Literal["all"] | NonNegativeInt | list[str]


class Section(BaseModel):
    """A part of the configuration; unknown keys are errors, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    #: keys that choose what is run; they are not arguments of the function that the section describes
    choices: ClassVar[frozenset[str]] = frozenset({"enabled", "cases"})

    @field_validator("*", mode="before")
    @classmethod
    def _no_yes_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Pydantic would take `yes` in a file, or True in Python, for the number 1; a section without keys is null."""
        values = value if isinstance(value, (list, tuple)) else [value]
        field = cls.model_fields[str(info.field_name)]
        if value is None and isinstance(field.default, Section):
            return field.default
        if any(isinstance(one, bool) for one in values) and not _takes_bool(field.annotation):
            raise ValueError("true and false are not accepted here")
        return value

    def with_keys(self, **keys: Any) -> Self:
        """A copy in which some keys have other values, checked like those of a file."""
        return type(self)(**{**self.model_dump(), **keys})

    def values(self) -> dict[str, Any]:
        """Plain values of its keys, without those that choose what is run."""
        return self.model_dump(mode="json", exclude=set(self.choices))

    def runs(self, *, aged: bool) -> bool:  # noqa: ARG002, one stage asks for it
        """Whether the line has the stage of this section; `aged`: the gestational age of the case is known."""
        return bool(getattr(self, "enabled", True))
