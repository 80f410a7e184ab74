"""The commands `fold` and `growth`: a mesh folds, a surface has grown."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter, Token

import cortet
from cortet.cli.shared import GROWTH, Configured, Writes, add
from cortet.cli.values import (
    FieldsFile,
    FolderOfFiles,
    Hemisphere,
    InputFile,
    MeshFile,
    Number,
    O,
    Picture,
    number,
    pairs,
)
from cortet.errors import InputError
from cortet.formats.atomic import recorded
from cortet.formats.ownership import may_write
from cortet.geometry.limits import FOLD_AGES


def aged_file(text: str) -> tuple[float, str]:
    """WEEKS=FILE."""
    age, equals, file = text.partition("=")
    if not (equals and file):
        raise ValueError(f"{text!r} is not WEEKS=FILE")
    return Number(*FOLD_AGES).read(age), file


def _weeks(_: object, tokens: Sequence[Token]) -> list[float]:
    """WEEKS,WEEKS."""
    return [Number(*FOLD_AGES).read(text) for text in tokens[-1].value.split(",")]


Age = Annotated[float, number(*FOLD_AGES, "WEEKS")]
Weeks = Annotated[
    Sequence[float],
    Parameter(
        converter=_weeks,
        n_tokens=1,
        metavar="WEEKS",
        help="Ages in weeks at which to write the folded cortex and its maps on the vertices of the input: 28,34.",
    ),
]
Folder = Annotated[FolderOfFiles, O, Parameter(metavar="DIR")]
AgedFiles = Annotated[Sequence[tuple[float, str]], pairs(aged_file, "WEEKS=FILE")]


def add_commands(app: App) -> None:
    """Add `fold` and `growth`."""
    add(app, GROWTH, fold, growth)


def fold(
    file: MeshFile,
    /,
    *,
    output: Folder,
    ga: Age | None = None,
    hemi: Hemisphere | None = None,
    end: Age | None = None,
    time_step: Annotated[float | None, number(0, 1, "DT")] = None,
    real: AgedFiles = (),
    surfaces: Weeks | None = None,
    config: InputFile | None = None,
    threads: Annotated[int | None, number(1, 10_000, "N", whole=True)] = None,
    writes: Writes = Writes(),
) -> int:
    """Fold a mesh by growth of its cortex.

    Parameters
    ----------
    ga
        Gestational age of the mesh (default: from its sidecar).
    hemi
        Hemisphere, for half a brain (default: from its sidecar).
    end
        Gestational age at the end (default: 40).
    time_step
        Dimensionless time step (default: the longest stable one).
    real
        Surface of a real brain of this age to show next to the simulated one; repeatable.
    config
        YAML file whose section fold has the other parameters.
    threads
        Number of threads (default: one per core); the result does not depend on it.

    Examples
    --------
    cortet fold lh.vtu --ga 28 --hemi L -o folded
    """
    from numba import get_num_threads, set_num_threads

    from cortet.api.meshing import tetrahedra
    from cortet.config import load
    from cortet.config.fold import Settings
    from cortet.folding.fold import SAME_AGE, fold
    from cortet.folding.fold_figures import FILM, NUMBERS, PICTURE, draw
    from cortet.folding.folded_surface import write_surfaces
    from cortet.folding.journal import FILES, status
    from cortet.folding.measures import surface_files, weeks_of
    from cortet.folding.plausible import brain_of
    from cortet.formats.gifti import kind_of, read_surface, require_same_hemisphere
    from cortet.solver_files.surface_map import map_of_file

    mesh = tetrahedra(file)
    age, side = brain_of(file, ga, hemi)
    if age is None:
        raise InputError("does not record the gestational age", file=file, remedy="add --ga WEEKS")
    for name in (*FILES, NUMBERS, PICTURE, FILM):  # before the work
        may_write(output / name)
    if threads:
        set_num_threads(min(threads, get_num_threads()))
    chosen = {"end": end, "time_step": time_step, "surfaces": surfaces}
    data = Configured(config).settings()
    data["fold"] = {**(data.get("fold") or {}), **{key: value for key, value in chosen.items() if value is not None}}
    if writes.force:
        data["fold"]["force"] = True
    if real:
        data["fold"]["real_surfaces"] = (data["fold"].get("real_surfaces") or {}) | dict(real)
    loaded = load(data)
    values = {**loaded.fold.values(), "gestational_age": age, "hemisphere": side}
    beside = loaded.fold.real_surfaces_of(side)
    for path in beside.values():  # before the work
        read_surface(path)
        require_same_hemisphere(path, side)
    weeks = weeks_of(loaded.fold.surfaces, age, loaded.fold.end)
    if missed := sorted({*loaded.fold.surfaces} - {*weeks}):
        raise InputError(
            f"the fold goes from {age:g} to {loaded.fold.end:g} weeks, not to {missed[0]:g}",
            file=file,
            remedy="name weeks between them with --surfaces, or another --end",
        )
    home = map_of_file(file, mesh) if weeks else None
    homes = {}
    if home:
        homes = {week: surface_files(output, file.stem, week, kind_of(home[1])) for week in weeks}
        for path in [path for some in homes.values() for path in some.values()]:
            may_write(path)
    live = sys.stdout.isatty()
    verdict = fold(
        mesh,
        output,
        Settings(**values),
        lambda *progress: print(
            f"\r{status(*progress)}" if live else status(*progress), end="" if live else "\n", flush=True
        ),
        print,
    )
    print(f"\n{verdict.reason}")
    there = {week: files for week, files in homes.items() if week <= verdict.gestational_age + SAME_AGE}
    for week, files in there.items():
        if home:
            write_surfaces(output, week, home[0], files, like=home[1], hemi=side)
            print(f"{files['surface']}: written, with {len(files) - 1} maps")
    measure = loaded.fold.picture
    maps = {week: (files["surface"], files[measure]) for week, files in there.items()} if measure else {}
    for path in draw(output, side, beside, maps, measure):
        print(f"{path}: drawn")
    return 0 if verdict.outcome == "folded" else 1


def growth(
    early: Path,
    later: Path,
    /,
    *,
    ages: Annotated[tuple[float, float], number(*FOLD_AGES, "WEEKS")],
    output: Annotated[FieldsFile, O],
    spheres: Annotated[tuple[Path, Path] | None, Parameter(metavar="GII")] = None,
    smooth: Annotated[float | None, number(0, 50, "MM")] = None,
    picture: Picture | None = None,
    _: Writes = Writes(),
) -> int:
    """Measure the growth of a surface between two ages, vertex by vertex.

    Parameters
    ----------
    early
        Surface, GIfTI.
    later
        Surface whose vertices correspond to those of EARLY.
    ages
        Gestational ages of the two surfaces.
    output
        Growth tensors (.func.gii), six values per vertex.
    spheres
        Registered spheres of EARLY and LATER, if their vertices do not correspond.
    smooth
        Full width at half maximum of the smoothing along the surface (default: by the noise).
    picture
        Also draw the map of area growth.

    Examples
    --------
    cortet growth week28.surf.gii week30.surf.gii --ages 28 30 -o growth.func.gii
    """
    from cortet.formats.gifti import read_surface, write_fields

    stem = output.stem.removesuffix(".func").removesuffix(".shape")
    metrics, record = (output.with_name(f"{stem}{ending}") for ending in (".shape.gii", ".growth.json"))
    for path in (metrics, record):
        may_write(path)
    fields, found = cortet.growth(early, later, ages, spheres=spheres, smooth=smooth)
    (name,), (start, end) = fields, ages
    report = {
        "early": {"file": str(early), "gestational_age_weeks": start},
        "later": {"file": str(later), "gestational_age_weeks": end},
        "correspondence": "registered spheres" if spheres else "numbers of the vertices",
        "smoothing_mm": found.width_mm,
        "area_ratio": found.area_ratio,
        "volume_ratio": found.volume_ratio,
        "area_ratio_percentiles": found.percentiles,
        "fields": {
            name: "logarithm of the stretch along the surface: xx, yy, zz, xy, xz, yz",
            "area_ratio": "later area divided by early area",
            "stretch_largest, stretch_smallest": "principal stretches along the surface",
            "beyond_the_whole": "stretch of the square root of the area over that of the cube root of the volume",
        },
    }
    with recorded(report, record) as place:
        write_fields(fields, place(output))
        write_fields(found.metrics, place(metrics))
        if picture:
            from cortet.report.figures import save
            from cortet.report.surface_maps import maps_figure

            save(maps_figure(read_surface(early), {"area ratio": found.metrics["area_ratio"]}), place(picture))
    low, middle, high = (found.percentiles[key] for key in ("5", "50", "95"))
    print(f"from {start:g} to {end:g} weeks the area grows by {found.area_ratio:.3f}, the volume by ", end="")
    print(f"{found.volume_ratio:.3f}; the median vertex by {middle:.2f}, 90 % of them by {low:.2f} to {high:.2f}")
    print(f"smoothed along the surface over {found.width_mm:.1f} mm (full width at half maximum)")
    print(f"{output}: written, with {metrics.name} and {record.name}; pass it to cortet mesh by ", end="")
    print(f"--field {name}={output}")
    return 0
