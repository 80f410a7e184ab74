"""How like a real brain is a simulated one?

    python benchmarks/fold_brain.py RUN... [--real SURFACE:AGE[:HEMI] ...] [--pair PIAL:WHITE:AGE:HEMI ...]
        [--weeks 24 26 ...]
    python benchmarks/fold_brain.py --table FOLDER

RUN are folders of `cortet fold` that differ by chance alone, as seeds of a mesh do: their mean is shown, and half of
what lies between the lowest and the highest of them. Beside it stand laws of Gompertz for area, volume and hull
(`usual_size.usual`), and real brains, interpolated between the surfaces that are named, or else between the healthy
fetuses of `cortet/folding/data/real_brains.tsv`, whose mean counts where several have one age; newborns have a line of
their own, since folds are not the same before and after birth. What is more or less than these is given in per cent of
them, of the gyrification index and of shares as a difference.

A real surface is measured as a simulated one is, its medial wall left out of width, depth and concavity; HEMI is L, R
or both, and not needed where the file names it. With a pair, what lies between pial and white surface is the cortex:
its share is of the volume of the pial surface, its thickness over the area of that without the medial wall; all else
is of the white surface. `--table` measures all surfaces of that table again, which lie anywhere in a folder, and
prints it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from _frame import command
from scipy.optimize import curve_fit

from cortet.folding.body import scale_of
from cortet.folding.fold_figures import BORN, as_real_brains, curves, healthy_fetuses, healthy_hemispheres, real_brains
from cortet.folding.journal import TABLE
from cortet.folding.measurements import shape
from cortet.folding.medial_wall import medial_wall
from cortet.formats.gifti import hemisphere_of, read_surface
from cortet.formats.tsv import MISSING
from cortet.geometry.topology import enclosed_volume
from cortet.measure.usual_size import AREA, HULL, VOLUME, usual
from cortet.meshes import FloatArray, TriSurface

WEEKS = (24.0, 26.0, 28.0, 30.0, 32.0, 34.0, 36.0, 38.0)
#: ages between which a simulated brain should be like a real one, weeks
CHECKED = (26.0, 34.0)
#: weeks from which newborns are of term
TERM = 38.0
#: digits after the point of a table's columns
DIGITS = {"gyrification_index": 3, "concave_share": 3, "sulcal_depth_mm": 2}
AGE = "gestational_age"


class Quantity(NamedTuple):
    """A line of the table: a column of `as_real_brains`."""

    label: str
    digits: int
    #: what is usual by age, where that is known
    law: tuple[float, float, float] | None = None
    #: whether what is more than a real one is a difference, not a part of it
    absolute: bool = False


QUANTITIES = {
    "area_cm2": Quantity("area, cm²", 1, AREA),
    "volume_ml": Quantity("volume, mL", 1, VOLUME),
    "hull_volume_ml": Quantity("hull, mL", 1, HULL),
    "extent_lr_mm": Quantity("left to right, mm", 1),
    "extent_ap_mm": Quantity("back to front, mm", 1),
    "extent_is_mm": Quantity("bottom to top, mm", 1),
    "cortical_thickness_mm": Quantity("thickness, mm", 2),
    "cortex_share": Quantity("share of the cortex", 3, absolute=True),
    "fold_spacing_mm": Quantity("width of folds, mm", 1),
    "fold_wavelength_mm": Quantity("wavelength of folds, mm", 1),
    "sulcal_depth_mm": Quantity("depth, mm", 2),
    "gyrification_index": Quantity("gyrification index", 3, absolute=True),
    "concave_share": Quantity("concave share", 3, absolute=True),
}


class Given(NamedTuple):
    """A real surface as it is named."""

    white: Path
    age: float
    #: L, R, or None for both
    hemisphere: str | None
    pial: Path | None = None


# --- measuring -------------------------------------------------------------------------------------------------------


def of_surface(surface: TriSurface, hemisphere: str | None, cortex_volume: float = float("nan")) -> pd.Series:
    """What `measurements.shape` says of a closed surface in RAS coordinates, medial wall left out, in usual units.

    Parameters
    ----------
    hemisphere : L, R, or None for both, which have no medial wall
    cortex_volume : mm3
    """
    wall = np.zeros(len(surface.points), bool)
    if hemisphere is not None:
        scale = scale_of(surface, hemisphere)
        wall = medial_wall(surface, hemisphere, scale.origin, scale.length).nodes
    found = shape(surface.points, surface.faces, wall, cortex_volume)
    return as_real_brains(pd.DataFrame([found])).astype(float).iloc[0]


def of_pair(pial: TriSurface, white: TriSurface, hemisphere: str | None) -> pd.Series:
    """The same of the white surface, with thickness and share of the cortex between it and the pial surface."""
    between = enclosed_volume(pial.points, pial.faces) - enclosed_volume(white.points, white.faces)
    inside, outside = of_surface(white, hemisphere), of_surface(pial, hemisphere, between)
    cortex = ["cortical_thickness_mm", "cortex_share"]
    inside[cortex] = outside[cortex]
    return inside


def measured(given: Sequence[Given]) -> pd.DataFrame:
    """A row for each real surface, by age; columns of `QUANTITIES`, name and age."""
    rows = []
    for one in given:
        white = read_surface(one.white)
        found = (
            of_pair(read_surface(one.pial), white, one.hemisphere) if one.pial else of_surface(white, one.hemisphere)
        )
        rows.append({"surface": one.white.name.removesuffix(".gii").removesuffix(".surf"), AGE: one.age, **found})
    return pd.DataFrame(rows, columns=["surface", AGE, *QUANTITIES]).sort_values(AGE, kind="stable")


def table_of(folder: Path) -> pd.DataFrame:
    """`real_brains.tsv` as text, measured again from the surfaces somewhere in a folder.

    Raises
    ------
    FileNotFoundError : a surface of the table is not there
    """
    known = real_brains().astype(object)
    for row, name in known["surface"].items():
        file = next(folder.rglob(f"{name}.surf.gii"), None)
        if file is None:
            raise FileNotFoundError(f"{folder}: holds no {name}.surf.gii")
        hemisphere = known.loc[row, "hemi"]
        found = of_surface(read_surface(file), None if hemisphere == "both" else str(hemisphere))
        for column in known.columns.intersection(found.index):
            known.loc[row, column] = _number(float(found[column]), DIGITS.get(column, 1))
    return known


# --- by week ---------------------------------------------------------------------------------------------------------


def at(ages: Sequence[float], rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of known ages at other ages: the mean of those of one age, a line between ages, nothing beyond them."""
    means = rows.groupby(AGE)[list(QUANTITIES)].mean()
    found = {}
    for column in QUANTITIES:
        known = means[column].dropna()
        found[column] = np.interp(ages, known.index, known, left=np.nan, right=np.nan) if len(known) else np.nan
    return pd.DataFrame(found, index=list(ages))


def by_birth(ages: Sequence[float]) -> dict[str, pd.DataFrame]:
    """Healthy fetuses and healthy newborns of `real_brains.tsv` at some ages."""
    healthy, fetuses = healthy_hemispheres(), healthy_fetuses()
    newborns = healthy.drop(fetuses.index)
    parts = {"fetuses": fetuses, "newborns": newborns}
    return {
        name: at(ages, rows.rename(columns={"gestational_age_weeks": AGE}).reindex(columns=[AGE, *QUANTITIES]))
        for name, rows in parts.items()
    }


def simulated(runs: Sequence[Path], ages: Sequence[float]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Mean of some runs at ages, and half of what lies between the lowest and the highest; NaN beyond a run's end."""
    found = [at(ages, curves(run / TABLE)) for run in runs]
    values = np.stack([one.to_numpy(float) for one in found])
    mean, spread = values.mean(axis=0), np.ptp(values, axis=0) / 2
    return tuple(pd.DataFrame(some, index=list(ages), columns=list(QUANTITIES)) for some in (mean, spread))  # type: ignore[return-value]


def fitted(ages: FloatArray, values: FloatArray, first: tuple[float, float, float]) -> tuple[float, ...]:
    """Largest value, rate and latest age of that law of Gompertz from which values at ages differ least, relatively."""

    def logarithm(at: FloatArray, largest: float, rate: float, latest: float) -> FloatArray:
        return np.log(usual((largest, rate, latest), at))

    found, _ = curve_fit(logarithm, ages, np.log(values), p0=first)
    return tuple(found.tolist())


def of_laws() -> pd.DataFrame:
    """The hemispheres of the laws: fetuses, and newborns of term; those of earlier weeks are smaller than fetuses."""
    brains = healthy_hemispheres()
    return brains[(brains["source"] != BORN) | (brains["gestational_age_weeks"] >= TERM)]


def excess(value: float, wanted: float, quantity: Quantity) -> float:
    """How much more a value is than it should be: a part of it, or a difference."""
    return value - wanted if quantity.absolute else value / wanted - 1


# --- printing --------------------------------------------------------------------------------------------------------


def _number(value: float, digits: int) -> str:
    return MISSING if np.isnan(value) else f"{value:.{digits}f}"


def _beside(value: float, wanted: float, quantity: Quantity) -> str:
    """What should be, and in brackets how much more it is."""
    if np.isnan(wanted) or np.isnan(value):
        return _number(wanted, quantity.digits)
    return f"{_number(wanted, quantity.digits)} ({_signed(excess(value, wanted, quantity), quantity)})"


def _signed(part: float, quantity: Quantity) -> str:
    return f"{part:+.2f}" if quantity.absolute else f"{100 * part:+.0f} %"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with columns of even width."""
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |" for line in lines
    )


def weeks_table(mean: pd.DataFrame, spread: pd.DataFrame, real: Mapping[str, pd.DataFrame], *, several: bool) -> str:
    """Lines of simulated brains, of what is usual and of real ones for each quantity; a column for each age.

    Parameters
    ----------
    real : by the name of their line
    """
    rows = []
    for column, quantity in QUANTITIES.items():
        ages, digits = mean.index.to_numpy(float), quantity.digits
        cells = [_number(value, digits) for value in mean[column]]
        if several:
            cells = [
                cell if cell == MISSING else f"{cell} ± {_number(half, digits)}"
                for cell, half in zip(cells, spread[column], strict=True)
            ]
        rows.append([quantity.label, "simulated", *cells])
        wanted: dict[str, FloatArray] = {"usual": usual(quantity.law, ages)} if quantity.law else {}
        wanted |= {name: known[column].to_numpy(float) for name, known in real.items()}
        for name, values in wanted.items():
            if not np.isnan(values).all():
                beside = (_beside(a, b, quantity) for a, b in zip(mean[column], values, strict=True))
                rows.append(["", name, *beside])
    return markdown(["", "", *(f"{age:g} weeks" for age in mean.index)], rows)


def surfaces_table(real: pd.DataFrame) -> str:
    """A line for each real surface, with how much more it is than usual at its age."""
    rows = []
    for _, row in real.iterrows():
        cells = []
        for column, quantity in QUANTITIES.items():
            cell = _number(row[column], quantity.digits)
            if quantity.law:
                wanted = float(usual(quantity.law, np.array(row[AGE], float)))
                cell += f" ({_signed(excess(row[column], wanted, quantity), quantity)})"
            cells.append(cell)
        rows.append([row["surface"], f"{row[AGE]:g}", *cells])
    return markdown(["surface", "weeks", *(quantity.label for quantity in QUANTITIES.values())], rows)


def verdict(mean: pd.DataFrame, real: pd.DataFrame) -> list[str]:
    """Where the mean is farthest from real brains between the ages that are checked."""
    checked = mean[(mean.index >= CHECKED[0]) & (mean.index <= CHECKED[1])]
    lines = []
    for column, quantity in QUANTITIES.items():
        ages = checked.index.to_numpy(float)
        wanted = real.loc[checked.index, column].to_numpy(float)
        differ = np.array([excess(a, b, quantity) for a, b in zip(checked[column], wanted, strict=True)])
        if np.isnan(differ).all():
            continue
        worst = int(np.nanargmax(np.abs(differ)))
        lines.append(f"{quantity.label}: {_signed(differ[worst], quantity)} of real at {ages[worst]:g} weeks")
    return lines


def laws() -> list[str]:
    """The laws that are used, fitted again to their hemispheres, and how far these are from them."""
    brains = of_laws()
    lines = []
    for column, quantity in QUANTITIES.items():
        if quantity.law:
            ages, values = (brains[name].to_numpy(float) for name in ("gestational_age_weeks", column))
            law = fitted(ages, values, quantity.law)
            rms = np.sqrt(((values / usual(quantity.law, ages) - 1) ** 2).mean())
            lines.append(
                f"{quantity.label}: used {', '.join(f'{one:g}' for one in quantity.law)}; of {len(ages)} hemispheres "
                f"{law[0]:.1f}, {law[1]:.4f}, {law[2]:.2f}, from which they differ by {rms:.1%}"
            )
    return lines


# --- the command -----------------------------------------------------------------------------------------------------


def _given(paths: int) -> Callable[[str], Given]:
    """Reads an option of so many paths, an age and a hemisphere, parted by colons."""

    def read(text: str) -> Given:
        parts = text.split(":")
        if len(parts) not in (paths + 1, paths + 2):
            raise SystemExit(f"{text!r} is not {'PIAL:WHITE' if paths > 1 else 'SURFACE'}:AGE:HEMI")
        files, age = [Path(part) for part in parts[:paths]], parts[paths]
        hemisphere = parts[paths + 1] if len(parts) > paths + 1 else hemisphere_of(files[-1])
        if hemisphere not in ("L", "R", "both"):
            raise SystemExit(f"{text!r} is of no hemisphere: end it with :L, :R or :both")
        try:
            weeks = float(age)
        except ValueError:
            raise SystemExit(f"{age!r} in {text!r} is not an age in weeks") from None
        return Given(files[-1], weeks, None if hemisphere == "both" else hemisphere, files[0] if paths > 1 else None)

    return read


def weeks(
    runs: Sequence[Path] = (),
    *,
    real: Sequence[str] = (),
    pair: Sequence[str] = (),
    weeks: Sequence[float] = WEEKS,
    table: Path | None = None,
) -> None:
    """Measure what is given and print the tables.

    Parameters
    ----------
    real
        SURFACE:AGE[:HEMI].
    pair
        PIAL:WHITE:AGE:HEMI.
    table
        Measure the surfaces of real_brains.tsv somewhere in this folder.
    """
    if table:
        table_of(table).to_csv(sys.stdout, sep="\t", index=False, na_rep=MISSING)
        return
    if not (runs or real or pair):
        raise SystemExit("name a run or a real surface")
    known = measured([*map(_given(1), real), *map(_given(2), pair)])
    if len(known):
        print(surfaces_table(known), end="\n\n")
    if runs:
        wanted = {"real": at(weeks, known)} if len(known) else by_birth(weeks)
        mean, spread = simulated(runs, weeks)
        print(weeks_table(mean, spread, wanted, several=len(runs) > 1), end="\n\n")
        named = "the surfaces above" if len(known) else "healthy hemispheres of real_brains.tsv"
        count = f"{len(runs)} run{'s' * (len(runs) > 1)}"
        print(f"{count}; real: interpolated between {named}. From {CHECKED[0]:g} to {CHECKED[1]:g} weeks")
        print("\n".join(f"- {line}" for line in verdict(mean, next(iter(wanted.values())))), end="\n\n")
    print("Laws: largest value, rate per week, latest age in weeks")
    print("\n".join(f"- {line}" for line in laws()))


main = command(__doc__, weeks)

if __name__ == "__main__":
    main()
