"""The commands `fold` and `growth`: a mesh folds, a surface has grown."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter, Token

import cortet
from cortet.cli.shared import GROWTH, Writes, add
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
)
from cortet.errors import counted
from cortet.formats.ownership import may_write
from cortet.geometry.limits import FOLD_AGES


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
    surfaces: Weeks | None = None,
    config: InputFile | None = None,
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
    config
        YAML file whose section fold has the other parameters.

    Examples
    --------
    cortet fold lh.vtu --ga 28 --hemi L -o folded
    """
    from cortet.api.given import sections
    from cortet.config import load
    from cortet.folding.fold_figures import FILM, NUMBERS, PICTURE, draw
    from cortet.folding.journal import FILES, SERIES, TABLE, status
    from cortet.folding.sentences import cells_in_words
    from cortet.formats.gifti import read_surface, require_same_hemisphere

    for name in (*FILES, NUMBERS, PICTURE, FILM):  # before the work
        may_write(output / name)
    chosen = {"end": end, "surfaces": surfaces, "force": writes.force or None}
    data = sections(config)
    keys = {**(data.get("fold") or {}), **{key: value for key, value in chosen.items() if value is not None}}
    settings = load({**data, "fold": keys}).fold
    for path in settings.real_surfaces_of(hemi).values():  # before the work, too
        read_surface(path)
        require_same_hemisphere(path, hemi)
    live = sys.stdout.isatty()

    def progress(*now: Any) -> None:
        print(f"\r{status(*now)}" if live else status(*now), end="" if live else "\n", flush=True)

    folded = cortet.fold(file, ga, hemi, folder=output, progress=progress, **keys)
    print(f"\n{folded.verdict['reason']}")
    if cells := cells_in_words(folded.verdict):
        print(cells)
    print(f"{output / SERIES}: the frames, for ParaView; {output / TABLE}: every number by age")
    for files in folded.surfaces.values():
        print(f"{files['surface']}: written, with {counted(len(files) - 1, 'map')}")
    measure = settings.picture
    maps = {week: (files["surface"], files[measure]) for week, files in folded.surfaces.items()} if measure else {}
    for path in draw(output, folded.hemi, settings.real_surfaces_of(folded.hemi), maps, measure):
        print(f"{path}: drawn")
    return 0 if folded.verdict["outcome"] == "folded" else 1


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

    metrics = output.with_name(f"{output.stem.removesuffix('.func').removesuffix('.shape')}.shape.gii")
    may_write(metrics)  # before the work
    fields, found = cortet.growth(early, later, ages, spheres=spheres, smooth=smooth)
    (name,), (start, end) = fields, ages
    write_fields(fields, output)
    write_fields(found.metrics, metrics)
    if picture:
        from cortet.report.figures import save
        from cortet.report.surface_maps import maps_figure

        save(maps_figure(read_surface(early), {"area ratio": found.metrics["area_ratio"]}), picture)
    low, middle, high = (found.percentiles[key] for key in ("5", "50", "95"))
    print(f"from {start:g} to {end:g} weeks the area grows by {found.area_ratio:.3f}, the volume by ", end="")
    print(f"{found.volume_ratio:.3f}; the median vertex by {middle:.2f}, 90 % of them by {low:.2f} to {high:.2f}")
    print(f"smoothed along the surface over {found.width_mm:.1f} mm (full width at half maximum)")
    print(f"{output}: written, with {metrics.name}; pass it to cortet mesh by ", end="")
    print(f"--field {name}={output}")
    return 0
