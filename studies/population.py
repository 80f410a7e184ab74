"""What folds of many brains say of a population: maps on the common mesh, and a general linear model of them.

Vertices of the common mesh with the same number are the same location of the cortex in every fold. The statistics are
nilearn's (`permuted_ols`): t at each vertex by ordinary least squares, and p corrected over all vertices by the largest
|t| of random permutations of the residuals without the tested column (Freedman and Lane 1983; Winkler et al.,
NeuroImage 92, 2014).
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from common_sphere import Parcels, onto_common, read_parcels
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.cohort.ages import number
from cortet.cohort.sheet import Case
from cortet.errors import InputError
from cortet.folding.measures import MEASURES, USUAL, surface_files
from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.gifti import read_fields, read_surface, write_fields, write_surface
from cortet.formats.tables import Column, write_table
from cortet.formats.tsv import MISSING, write_tsv
from cortet.geometry.icosphere import icosphere
from cortet.geometry.spheres import vertex_areas
from cortet.meshes import FloatArray, TriSurface
from cortet.report.figures import PAGE, drawn, save
from cortet.report.surface_maps import map_view, usual_range

#: column of the model that compares the variants of `fold` within cases
VARIANT = "variant"
#: name of the parcel that is the whole surface
WHOLE = "all"
#: columns of `population.tsv`
COLUMNS = (
    Column("case", "Name of the case"),
    Column("variant", "Variant of fold"),
    Column("hemi", "Hemisphere"),
    Column("week", "Gestational age of the folded cortex", "weeks"),
    Column("parcel", f"Parcel; {WHOLE}: the whole surface"),
    Column("measure", "What was measured", levels={name: what for name, (what, _) in MEASURES.items()}),
    Column("value", "Mean over the area of the folded parcel, in the unit of the measure"),
)
#: cells that hold no value, in lower case
_UNKNOWN = {"", MISSING, "na", "nan", "null", "-", ".", "?"}
#: differences of values below this share of the largest value are rounding: files hold float32
_ROUNDING = 1e-6
#: p from which on the figure is grey, and the number of colours of p
_SHOWN, _COLOURS = 0.05, 512


# --- one fold


@dataclass(frozen=True, eq=False)
class Fold:
    """A folded cortex of one week on the common mesh."""

    #: what the sheet says of it: `case`, `variant`, `hemi`, `week`, `scan_age`, and columns of its own
    row: Mapping[str, Any]
    surface: TriSurface
    #: measure -> (v,)
    maps: Mapping[str, FloatArray]
    #: `parcel`, `measure`, `value`: means over the parcels
    means: Sequence[Mapping[str, Any]]

    @property
    def name(self) -> str:
        """Its name in a stack."""
        usual = self.row["variant"] == USUAL
        return str(self.row["case"]) if usual else f"{self.row['case']}_{self.row['variant']}"


def on_common(
    row: Mapping[str, Any],
    folded: Path,
    maps: Mapping[str, Path],
    sphere: Path,
    common: TriSurface,
    parcels: Path | None = None,
) -> Fold:
    """Bring a folded cortex and its maps onto the common mesh.

    Parameters
    ----------
    folded : the folded surface, on the vertices of the native one
    maps : measure -> its file
    sphere : registered sphere of the native surface
    common : sphere whose vertices all cases share
    parcels : labels of the native surface

    Raises
    ------
    InputError : as `onto_common` and `read_parcels`
    """
    surface = read_surface(folded)
    weights = onto_common(surface, sphere, common)
    values = {name: next(iter(read_fields(file).values())).astype(np.float64) for name, file in maps.items()}
    known = [Parcels(np.zeros(len(surface.points), np.int32), {0: WHOLE}, vertex_areas(surface))]
    known += [read_parcels(parcels, surface)] if parcels else []
    means = [
        {"parcel": parcel, "measure": name, "value": value}
        for one in known
        for name, some in values.items()
        for parcel, value in one.means(some).items()
    ]
    there = TriSurface(weights @ surface.points, common.faces, frame=surface.frame)
    return Fold(row, there, {name: weights @ some for name, some in values.items()}, means)


def read_folds(
    sheet: Sequence[Case],
    folds: Path,
    *,
    weeks: Sequence[float],
    measures: Sequence[str],
    parcels: str | None,
    subdivisions: int,
) -> list[Fold]:
    """The folds of a cohort at some weeks, of its included cases that have a sphere.

    Parameters
    ----------
    folds : output folder of the workflow of cortet
    parcels : field of the sheet with labels of the surface
    subdivisions : of the icosahedron that is the common mesh

    Raises
    ------
    InputError : no case has a fold at these weeks, or as `on_common`
    """
    common, found = icosphere(subdivisions), []
    for case in sheet:
        runs = folds.glob(f"{case.folder}/simulation/{case.name}_res-*_desc-*Folded*") if case.include else ()
        for run, week in itertools.product(sorted(runs), weeks):
            files = surface_files(run, case.name, week)
            if case.sphere is None or not files["surface"].is_file():
                continue
            row: dict[str, Any] = {"case": case.name, "variant": run.name.rpartition("Folded")[2].lower() or USUAL}
            row |= {"hemi": case.hemi, "week": week, "scan_age": case.scan_age, **case.extra}
            labels = case.fields.get(parcels) if parcels else None
            wanted = {name: files[name] for name in measures}
            found.append(
                on_common(row, files["surface"], wanted, Path(case.sphere), common, Path(labels) if labels else None)
            )
    if not found:
        raise InputError(
            f"no case with a sphere has a fold at {', '.join(f'{week:g}' for week in weeks)} weeks",
            file=folds,
            remedy="fold cases with a column sphere, and name the weeks in fold.surfaces",
        )
    return found


# --- the model


class Design(NamedTuple):
    """Columns of a general linear model, of s folds."""

    #: names of the k columns that are tested, `group[b]` for a word: that group against the first
    names: list[str]
    #: (s, k), and (s, c) columns that are held and not tested; an intercept comes to them
    tested: FloatArray
    held: FloatArray


def design_of(rows: Sequence[Mapping[str, Any]], model: Sequence[str], *, of: str = "") -> Design:
    """The columns of a model, from rows of values: numbers are taken from their mean, words become indicators.

    Parameters
    ----------
    rows : one for each fold, with `case` and the columns of the model
    of : name of these folds, for errors

    Raises
    ------
    InputError : a column is missing, has no value for a fold, holds numbers and words, or does not differ; or the folds
        are too few
    """
    remedy, begin = "mend population.model, or the column in the cohort sheet", f"{of}: " if of else ""
    if VARIANT in model and len(model) > 1:
        raise InputError(
            "population.model: variant compares folds of one case, and other columns compare cases",
            remedy="name variant alone, or leave it out",
        )
    names, columns = [], []
    for name in model:
        values = [str(row.get(name, MISSING)) for row in rows]
        named = [(str(row["case"]), value) for row, value in zip(rows, values, strict=True)]
        if empty := [case for case, value in named if value.lower() in _UNKNOWN or value == "None"]:
            raise InputError(f"{begin}population.model: {', '.join(empty)} without a value of {name}", remedy=remedy)
        words = [f"{case} has {value!r}" for case, value in named if name == VARIANT or number(value) is None]
        if 0 < len(words) < len(values):
            raise InputError(
                f"{begin}population.model: {name} is a number, but {', '.join(words)}",
                remedy="give each case a number or leave it out; for groups, give words alone",
            )
        found = _indicators(values, first=USUAL if name == VARIANT else None, words=bool(words))
        if not found:
            raise InputError(f"{begin}population.model: {name} is {values[0]} in all folds", remedy=remedy)
        names += [name if level is None else f"{name}[{level}]" for level in found]
        columns += list(found.values())
    held = list(_indicators([str(row["case"]) for row in rows], words=True).values()) if VARIANT in model else []
    made = Design(names, np.array(columns, float).T, np.array(held, float).reshape(len(held), len(rows)).T)
    every = np.column_stack([made.tested, made.held, np.ones(len(rows))])
    if np.linalg.matrix_rank(every) < every.shape[1] or len(rows) < every.shape[1] + 2:
        raise InputError(
            f"{begin}population.model: {len(rows)} folds for {every.shape[1]} columns ({', '.join(names)}, the mean"
            f"{', cases' if held else ''}), which are too few, or say the same",
            remedy="leave out columns, or add cases",
        )
    return made


def _indicators(values: Sequence[str], *, first: str | None = None, words: bool) -> dict[str | None, Any]:
    """Numbers less their mean, under None; of words an indicator of each but the first; empty if all are the same."""
    if len(set(values)) < 2:
        return {}
    if not words:
        numbers = np.array(values, float)
        return {None: numbers - numbers.mean()}
    levels = sorted(set(values))
    levels.remove(levels[0] if first is None else first)
    return {level: [float(value == level) for value in values] for level in levels}


def effects(
    values: FloatArray, design: Design, *, permutations: int, seed: int
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """t and corrected p of each tested column at each vertex, two-sided: name -> (v,), (v,).

    A vertex without a value in some fold, or with the same in all but for rounding, is NaN.

    Parameters
    ----------
    values : (s, v), a row for each fold
    permutations, seed : of nilearn's `permuted_ols`; the smallest p is 1 / (permutations + 1)
    """
    from nilearn.mass_univariate import permuted_ols

    known = np.isfinite(values).all(axis=0)
    known &= np.ptp(values, axis=0) > _ROUNDING * np.abs(values[:, known]).max(initial=0)
    found = {}
    for column, name in enumerate(design.names):
        t, p = np.full(values.shape[1], np.nan), np.full(values.shape[1], np.nan)
        others = np.column_stack([np.delete(design.tested, column, axis=1), design.held])
        if known.any():
            result = permuted_ols(
                design.tested[:, [column]],
                values[:, known],
                others if others.shape[1] else None,
                n_perm=permutations,
                random_state=seed,
                output_type="dict",
            )
            t[known], p[known] = result["t"][0], 10.0 ** -result["logp_max_t"][0]
        found[name] = t, p
    return found


# --- all folds of a hemisphere at a week


def write_population(
    folds: Sequence[Fold],
    model: Sequence[str],
    folder: Path,
    *,
    permutations: int,
    seed: int,
    of: str,
) -> dict[str, Any]:
    """Write stacks, means, spreads, effects, the order of the folds, PALM's design and a figure; returns a record.

    Parameters
    ----------
    of : begin of the names of files

    Raises
    ------
    InputError : as `design_of`
    """
    rows = [fold.row for fold in folds]
    design = design_of(rows, model, of=of) if model else None
    hemi = rows[0]["hemi"]
    mean = replace(folds[0].surface, points=np.mean([fold.surface.points for fold in folds], axis=0))
    write_tsv(rows, list(rows[0]), folder / f"{of}.tsv")
    write_surface(mean, folder / f"{of}_white.surf.gii")
    shown: dict[str, dict[str, NDArray[Any]]] = {}
    record: dict[str, Any] = {"folds": len(folds), "vertices": len(mean.points), "effects": {}}
    for name in folds[0].maps:
        values = np.stack([fold.maps[name] for fold in folds])
        plain = name.replace("_", "")
        stack = {fold.name: one for fold, one in zip(folds, values, strict=True)}
        write_fields(stack, folder / f"{of}_{plain}.func.gii", hemisphere=hemi)
        maps = {"mean": values.mean(axis=0), "spread": values.std(axis=0, ddof=1 if len(values) > 1 else 0)}
        if design:
            for effect, (t, p) in effects(values, design, permutations=permutations, seed=seed).items():
                maps |= {f"t_{effect}": t, f"p_{effect}": p}
                record["effects"].setdefault(effect, {})[name] = {
                    "smallest_p": float(np.nanmin(p)) if np.isfinite(p).any() else None,
                    "vertices_below_0.05": int((p < _SHOWN).sum()),
                }
        write_fields(maps, folder / f"{of}_{plain}.shape.gii", hemisphere=hemi)
        shown[name] = maps
    if design:
        _write_palm(design, folder / f"{of}_design.mat", folder / f"{of}_design.con")
    save(population_figure(mean, shown, hemi), folder / f"figure_{of}.png")
    return record


def _write_palm(design: Design, matrix: Path, contrasts: Path) -> None:
    """The design in the format of FSL, which PALM reads beside the stacks: tested columns, held ones, the mean."""
    every = np.column_stack([design.tested, design.held, np.ones(len(design.tested))])
    names = "".join(f"/ContrastName{column}\t{name}\n" for column, name in enumerate(design.names, start=1))
    for path, head, rows in (
        (matrix, f"/NumWaves\t{every.shape[1]}\n/NumPoints\t{len(every)}\n", every),
        (
            contrasts,
            f"{names}/NumWaves\t{every.shape[1]}\n/NumContrasts\t{len(design.names)}\n",
            np.eye(len(design.names), every.shape[1]),
        ),
    ):
        with atomic_path(path) as temporary:
            lines = "".join("\t".join(f"{value:.9g}" for value in row) + "\n" for row in rows)
            temporary.write_text(f"{head}/Matrix\n{lines}", encoding="utf-8")


def population_figure(
    mean: TriSurface, maps: Mapping[str, Mapping[str, NDArray[Any]]], hemi: Literal["L", "R"] | None
) -> Figure:
    """Each measure a row on the mean surface: mean and spread from outside, and -log10 of p from both sides, in grey
    where p is 0.05 or more.
    """
    effects = [name.removeprefix("p_") for name in next(iter(maps.values())) if name.startswith("p_")]
    outside: Literal["L", "R"] = hemi or "L"
    inside: Literal["L", "R"] = "R" if outside == "L" else "L"
    with drawn(PAGE, 1.35 * len(maps) + 0.3) as figure:
        axes = figure.subplots(len(maps), 2 + 2 * len(effects), squeeze=False)
        for number, (measure, some) in enumerate(maps.items()):
            panels = [("mean", some["mean"], outside), ("spread", some["spread"], outside)]
            for name in effects:
                panels += [
                    (f"{name}: $-\\log_{{10}} p$", -np.log10(some[f"p_{name}"]), side) for side in (outside, inside)
                ]
            for axis, (title, values, side) in zip(axes[number], panels, strict=True):
                of_p = title not in ("mean", "spread")
                image, colours = (
                    _view_of_p(mean, values, side) if of_p else map_view(mean, values, side, usual_range(values))
                )
                axis.imshow(image, interpolation="antialiased")
                axis.set_axis_off()
                if number == 0:
                    axis.set_title(title)
                bar = figure.colorbar(colours, ax=axis, shrink=0.7)
                if of_p:
                    bar.ax.axhline(-np.log10(_SHOWN), color="black", linewidth=0.8)
            first = axes[number, 0]
            first.text(-0.05, 0.5, measure.replace("_", "\n"), transform=first.transAxes, ha="right", va="center")
    return figure


def _view_of_p(mean: TriSurface, logarithm: NDArray[Any], side: Literal["L", "R"]) -> tuple[Any, ScalarMappable]:
    """A picture of -log10 p at vertices, as `map_view`."""
    high = max(float(np.nanmax(logarithm, initial=0)), 2.0)
    grey = round(_COLOURS * -np.log10(_SHOWN) / high)
    below = colormaps["Greys"](np.linspace(0.1, 0.5, grey))
    above = colormaps["viridis"](np.linspace(0, 1, _COLOURS - grey))
    return map_view(mean, logarithm, side, (0.0, high), ListedColormap(np.concatenate([below, above])))


def write_study(
    sheet: Sequence[Case],
    folds: Path,
    folder: Path,
    *,
    weeks: Sequence[float],
    model: Sequence[str] = (),
    parcels: str | None = None,
    measures: Sequence[str] = ("depth", "area_growth"),
    subdivisions: int = 6,
    permutations: int = 1000,
    seed: int = 0,
) -> None:
    """Write `population.tsv`, its sidecar with the record of the model, and files for each hemisphere and week.

    Parameters
    ----------
    folds : output folder of the workflow of cortet
    model : columns of the sheet; `variant` alone compares variants of a fold within cases; empty: means and spread only

    Raises
    ------
    InputError : as `read_folds` and `design_of`
    """
    read = read_folds(sheet, folds, weeks=weeks, measures=measures, parcels=parcels, subdivisions=subdivisions)
    groups: dict[str, list[Fold]] = {}
    for fold in read:
        if VARIANT in model or fold.row["variant"] == USUAL:
            groups.setdefault(f"hemi-{fold.row['hemi']}_week-{fold.row['week']:g}", []).append(fold)
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"model": list(model), "permutations": permutations, "seed": seed}
    for of, some in groups.items():
        record[of] = write_population(some, model, folder, permutations=permutations, seed=seed, of=of)
    keys = ("case", "variant", "hemi", "week")
    rows = [{**{key: fold.row[key] for key in keys}, **mean} for fold in read for mean in fold.means]
    write_table(COLUMNS, rows, folder / "population.tsv", folder / "population.json")
    said = json.loads((folder / "population.json").read_text(encoding="utf-8"))
    write_json({**said, "Model": record}, folder / "population.json")
