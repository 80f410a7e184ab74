"""Prediction of later brains from measured growth, compared with real later brains and with trivial predictions.

A series is one brain, or one atlas, at several ages, with corresponding vertices. The first surface is meshed. Growth
measured between it and later surfaces is imposed on the mesh, which folds by mechanics. Compressed tissue grows less
than imposed, so fixed-point iteration finds the growth to impose: fold, measure the growth of the result in the same
way as that of the real brain, add the difference, repeat.

Predictions of several kinds (`KINDS`) are compared with the real surfaces. Gained depth separates good ones from bad
ones. Depth itself does not: that of a later brain is nearly that of the early one, so "nothing changes" correlates
highly with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from carried import carried
from scipy.spatial.transform import Rotation
from series import Series

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import SAME_AGE, Say, Verdict, fold
from cortet.folding.surface_growth import logarithmic_growth, smoothed
from cortet.formats import vtu
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.interpolation import at_triangles
from cortet.geometry.spheres import barycentric, of_one_radius
from cortet.geometry.topology import boundary_nodes, edges, vertex_normals
from cortet.measure.quality import signed_volumes
from cortet.measure.usual_size import AREA, VOLUME, usual
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.solver_files.names import growth_field
from cortet.stages.transfer import transfer

Kind = Literal["mechanics", "core", "forecast", "uniform", "shuffled", "unmapped", "braingrowth", "path", "nothing"]
#: kinds that are folded
FOLDED: tuple[Kind, ...] = ("mechanics", "core", "forecast", "uniform", "shuffled", "unmapped", "braingrowth")
#: kinds of a model that runs by itself: no growth is measured
_BY_ITSELF: tuple[Kind, ...] = ("unmapped", "braingrowth")
#: kind -> what it is
KINDS: dict[Kind, str] = {
    "mechanics": "growth measured until the last age is imposed",
    "core": "the same, and the core grows as the real later surfaces let it: what knowing it would be worth",
    "forecast": "growth measured until an early age goes on as in usual brains",
    "uniform": "the same growth everywhere, as much as was measured in all",
    "shuffled": "the measured growth, turned at random on the sphere",
    "unmapped": "the model as it is, with no growth measured",
    "braingrowth": "the model of BrainGrowth, in which only the cortex grows, with no growth measured",
    "path": "no mechanics: each vertex goes on as it went until the early age",
    "nothing": "the first surface, scaled to the volume",
}
#: largest logarithmic stretch to impose, so that the iteration does not diverge where the tissue does not follow
_LARGEST = 1.2
#: bounds of volume ratios inside, beyond which the harmonic motion has inverted a tetrahedron; smoothing of the core,
#: full width at half maximum, mm
_PLAUSIBLE, _CORE_WIDTH = (0.2, 20.0), 3.0


# --- what is predicted


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted surfaces, and how they were obtained."""

    kind: Kind
    #: age -> (n, 3) mm
    points: dict[float, FloatArray]
    #: how the last fold ended; None if nothing was folded
    verdict: Verdict | None
    #: for each round, measured minus resulting logarithm of the area, weighted: age -> mean, and spread
    residuals: list[dict[str, float]]
    #: age -> (n, 6), growth imposed in the last round
    imposed: dict[float, FloatArray] = field(default_factory=dict)


def measured_growth(series: Series, ages: Sequence[float], width_mm: float | None) -> dict[float, FloatArray]:
    """Growth from the first surface to those of some ages: age -> (n, 6)."""
    return {
        age: smoothed(logarithmic_growth(series.first, series.at(age)), series.first, width_mm).tensors for age in ages
    }


def uniform_growth(series: Series, maps: Mapping[float, FloatArray]) -> dict[float, FloatArray]:
    """The mean of maps over the cortex, isotropic and the same everywhere: age -> (n, 6)."""
    normals = vertex_normals(series.first.points, series.first.faces)
    plane = (np.eye(3) - normals[:, :, None] * normals[:, None, :])[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return {age: plane * np.log(_whole(series, values)) / 2 for age, values in maps.items()}


def _whole(series: Series, values: FloatArray) -> float:
    """Ratio of the cortical areas that a map (n, 6) gives."""
    return float(np.average(np.exp(values[:, :3].sum(axis=1)), weights=series.weights))


def shuffled_growth(series: Series, maps: Mapping[float, FloatArray], seed: int) -> dict[float, FloatArray]:
    """The areas of maps rotated at random on the sphere (Alexander-Bloch et al. 2018): age -> (n, 6).

    Directions do not rotate with them: growth is isotropic.

    Raises
    ------
    InputError : the series has no sphere
    """
    if series.sphere is None:
        raise InputError(
            "the series has no sphere on which growth could be shuffled", remedy="name the sphere of its first surface"
        )
    sphere = of_one_radius(series.sphere)
    turn = Rotation.random(random_state=np.random.default_rng(seed))
    weights = barycentric(sphere, replace(sphere, points=turn.apply(np.array(sphere.points))))
    even, result = uniform_growth(series, maps), {}
    for age, values in maps.items():
        log_area = values[:, :3].sum(axis=1)
        mean = np.average(log_area, weights=series.weights)
        turned = np.asarray(weights @ np.where(series.weights > 0, log_area, mean))
        result[age] = even[age] * (turned / np.log(_whole(series, values)))[:, None]
    return result


def forecast_growth(
    series: Series, maps: Mapping[float, FloatArray], until: float, ages: Sequence[float]
) -> dict[float, FloatArray]:
    """Growth measured until an early age, extrapolated to later ages by the usual course: age -> (n, 6)."""
    known = [age for age in sorted(maps) if age <= until]
    weeks = np.array(known) - series.ages[0]
    rate = np.tensordot(weeks, np.stack([maps[age] for age in known]), 1) / (weeks @ weeks)  # per week, least squares
    pattern = rate * (until - series.ages[0])
    start, then, *later = np.log(usual(AREA, np.array([series.ages[0], until, *ages])))
    course = [(value - start) / (then - start) for value in later]
    return {age: np.clip(pattern * part, -_LARGEST, _LARGEST) for age, part in zip(ages, course, strict=True)}


def without_mechanics(series: Series, until: float) -> dict[float, FloatArray]:
    """Every vertex continues its path from the first surface to an early one, as fast as usual volumes grow."""
    way = series.at(until).points - series.first.points
    sizes = np.cbrt(usual(VOLUME, np.array([series.ages[0], *series.ages[1:], until])))
    parts = (sizes[1:-1] - sizes[0]) / (sizes[-1] - sizes[0])
    return {age: series.first.points + part * way for age, part in zip(series.ages[1:], parts, strict=True)}


def nothing_changes(series: Series) -> dict[float, FloatArray]:
    """The first surface, scaled to the volume of each age."""
    volumes = series.volumes()
    start = volumes[series.ages[0]]
    return {age: series.first.points * float(np.cbrt(volumes[age] / start)) for age in series.ages[1:]}


def core_growth(series: Series, mesh: TetMesh, age: float) -> FloatArray:
    """Logarithm of the stretch inside if it is as smooth as the surfaces allow: (n,) at the nodes of a mesh.

    The boundary moves from the first surface to that of an age, and the inside moves harmonically.
    """
    from cortet.measure.harmonic import harmonic

    outer = boundary_nodes(mesh)
    found = closest_points(tree_of(series.first), mesh.points[outer])
    way = at_triangles(series.at(age).points - series.first.points, series.first.faces[found.faces], found.barycentric)
    start = np.zeros_like(mesh.points)
    start[outer] = way
    moved = harmonic(mesh, outer, way, start)
    before, after = (signed_volumes(points, mesh.cells) for points in (mesh.points, mesh.points + moved))
    stretch = np.log(np.clip(after / before, *_PLAUSIBLE)) / 3
    total, weight = (
        np.bincount(mesh.cells.ravel(), np.repeat(values, 4), minlength=len(mesh.points))
        for values in (stretch * before, before)
    )
    return _smoothed_inside(total / weight, mesh)


def _smoothed_inside(values: FloatArray, mesh: TetMesh) -> FloatArray:
    """Values at nodes, averaged with those of their neighbours until the smoothing is `_CORE_WIDTH` wide."""
    start, end = edges(mesh.cells).T
    square = ((mesh.points[start] - mesh.points[end]) ** 2).sum(axis=1).mean() / 6
    degree = np.bincount(np.r_[start, end], minlength=len(values))
    for _ in range(int((_CORE_WIDTH / np.sqrt(8 * np.log(2))) ** 2 / square)):
        total = np.bincount(start, values[end], minlength=len(values))
        total = total + np.bincount(end, values[start], minlength=len(values))
        values = (values + total / degree) / 2
    return values


# --- folding


def predict(
    series: Series,
    mesh: TetMesh,
    kind: Kind,
    folder: Path,
    *,
    settings: Settings,
    until: float,
    smoothing: float | None = None,
    rounds: int = 1,
    seed: int = 0,
    say: Say = lambda _: None,
) -> Prediction:
    """Surfaces of the later ages of a series by one of `KINDS`.

    Parameters
    ----------
    mesh : of the first surface
    folder : of the fold; those of earlier rounds are in folders beside it
    settings : of the fold; those of the series replace volume and hull, if the kind may know them
    until : last age that a forecast knows
    smoothing : of growth along the surface, full width at half maximum, mm; None: as much as noise requires
    rounds : of the fixed-point iteration; 1: measured growth is imposed as it is
    """
    if kind == "nothing":
        return Prediction(kind, nothing_changes(series), None, [])
    if not any(age <= until for age in series.ages[1:]):
        raise InputError(f"no surface is known until {until:g} weeks", remedy="set a later prediction.until")
    until = max(age for age in series.ages if age <= until)
    if kind == "path":
        return Prediction(kind, without_mechanics(series, until), None, [])
    if kind != "braingrowth" and settings.model != "growing":
        raise InputError(
            f"the kind {kind} imposes growth on the model growing, but fold.model is {settings.model}",
            remedy="leave out fold.model; prediction.kinds may name braingrowth",
        )
    if kind == "braingrowth":
        settings = _of_braingrowth(settings)
    elif kind not in ("unmapped", "forecast"):
        settings = settings.with_keys(volume=series.volumes(), hull=series.hulls())
    end = series.ages[-1]
    settings = settings.with_keys(end=end)
    wanted = _wanted(series, kind, until, smoothing, seed)
    if not wanted:
        verdict, points = _folded(series, mesh, {}, folder, settings)
        return Prediction(kind, points, verdict, [])
    core = {age: core_growth(series, mesh, age) for age in wanted} if kind == "core" else {}
    imposed, residuals = dict(wanted), []
    whole = kind in ("uniform", "shuffled")
    for number in range(1, rounds + 1):
        maps, last = imposed, number == rounds
        if kind == "forecast" and last:
            maps = imposed | forecast_growth(series, imposed, until, [age for age in series.ages if age > until])
        place = folder if last else folder / f"round-{number}"
        until_then = settings.with_keys(end=end if last else max(wanted))
        verdict, points = _folded(series, mesh, maps, place, until_then, core)
        came = {age: _came_out(series, points[age], smoothing) for age in wanted if age in points}
        residuals.append(_residual(series, wanted, came))
        say(f"round {number}: " + ", ".join(f"{name} {value:.3f}" for name, value in residuals[-1].items()))
        if verdict.outcome != "folded" or last:
            break
        if not _better(residuals):
            say(f"round {number} left more than the one before: the iteration does not converge")
        imposed = {age: corrected(series, imposed[age], wanted[age], came[age], whole=whole) for age in imposed}
    return Prediction(kind, points, verdict, residuals, maps)


def _wanted(series: Series, kind: Kind, until: float, smoothing: float | None, seed: int) -> dict[float, FloatArray]:
    """The growth that should result, by age; none if the model runs by itself."""
    if kind in _BY_ITSELF:
        return {}
    known = [age for age in series.ages[1:] if kind != "forecast" or age <= until]
    found = measured_growth(series, known, smoothing)
    if kind == "uniform":
        return uniform_growth(series, found)
    return shuffled_growth(series, found, seed) if kind == "shuffled" else found


def _of_braingrowth(settings: Settings) -> Settings:
    """The settings with BrainGrowth's model and its constants; only the thickness of the cortex stays."""
    laws = ("growth_rate", "thickness_rate", "core_stiffness", "core_relaxation", "volume", "hull", "envelope")
    return settings.with_keys(model="braingrowth", core_regions={}, region_relaxation={}, **dict.fromkeys(laws))


def _better(residuals: Sequence[Mapping[str, float]]) -> bool:
    """Whether the last of several rounds left a smaller residual than the one before."""
    squares = [sum(value**2 for name, value in one.items() if name.startswith("rms")) for one in residuals]
    return len(squares) < 2 or squares[-1] < squares[-2]


def corrected(
    series: Series, imposed: FloatArray, wanted: FloatArray, came: FloatArray, *, whole: bool = False
) -> FloatArray:
    """The growth to impose next: more where less resulted than was wanted; (n, 6) each.

    Parameters
    ----------
    whole : correct only total growth, so that a kind with no pattern, or a wrong one, does not acquire the right one
    """
    missing = wanted - came
    if whole:
        share = np.average(missing[:, :3].sum(axis=1), weights=series.weights)
        trace = np.average(imposed[:, :3].sum(axis=1), weights=series.weights)
        return imposed * (1 + share / trace)
    return np.clip(imposed + missing, -_LARGEST, _LARGEST)


def _came_out(series: Series, points: FloatArray, width_mm: float | None) -> FloatArray:
    """Growth of a predicted surface, measured as that of the real one: (n, 6)."""
    return smoothed(
        logarithmic_growth(series.first, replace(series.first, points=points)), series.first, width_mm
    ).tensors


def _residual(series: Series, wanted: Mapping[float, FloatArray], came: Mapping[float, FloatArray]) -> dict[str, float]:
    """The residual of the logarithm of the area, by age: mean and root mean square."""
    result = {}
    for age, values in came.items():
        missing = (wanted[age] - values)[:, :3].sum(axis=1)
        result[f"mean_{age:g}"] = float(np.average(missing, weights=series.weights))
        result[f"rms_{age:g}"] = float(np.sqrt(np.average(missing**2, weights=series.weights)))
    return result


def _folded(
    series: Series,
    mesh: TetMesh,
    maps: Mapping[float, FloatArray],
    folder: Path,
    settings: Settings,
    core: Mapping[float, FloatArray] | None = None,
) -> tuple[Verdict, dict[float, FloatArray]]:
    """Fold a mesh by some maps, and carry the first surface along: age -> (n, 3) mm."""
    from cortet.folding.journal import SERIES
    from cortet.folding.journal import series as frames_of

    fields = {growth_field(age): values for age, values in maps.items()}
    grown, _ = transfer(mesh, TriSurface(series.first.points, series.first.faces, fields))
    below = {growth_field(age, core=True): values for age, values in (core or {}).items()}
    grown = replace(grown, point_data={**grown.point_data, **below})
    folder.mkdir(parents=True, exist_ok=True)
    verdict = fold(grown, folder, settings, frames_at=series.ages[1:])
    points = {}
    for file, age in frames_of(folder / SERIES):
        real = min(series.ages[1:], key=lambda one: abs(one - age))
        if abs(real - age) < SAME_AGE:
            points[real] = carried(series.first.points, mesh, vtu.read(file).points)
    return verdict, points
