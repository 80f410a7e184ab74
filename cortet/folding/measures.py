"""What is measured on the folded cortex, and the names of its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

#: map -> what it is, and its unit; `folded_surface.maps_of` defines it
MEASURES: Mapping[str, tuple[str, str]] = {
    "depth": ("Distance from the convex hull", "mm"),
    "mean_curvature": ("Mean curvature, positive on gyri", "1/mm"),
    "gaussian_curvature": ("Gaussian curvature", "1/mm2"),
    "local_gyrification": ("Area within a ball over that of its great circle", ""),
    "thickness": ("Thickness of the cortex", "mm"),
    "area_growth": ("Area over that at the start", ""),
    **{
        f"{tissue}_{name}": (f"{what}, {where}", "")
        for tissue, where in {"cortex": "mean over the cortex", "white": "mean over as much tissue below it"}.items()
        for name, what in {
            "stress": "Largest principal stress over the shear modulus of the cortex",
            "direction": "Unit vector of the largest principal stress",
            "pressure": "Pressure over the shear modulus of the cortex",
            "stretch": "Largest principal elastic stretch",
        }.items()
    },
}


def surface_files(folder: Path, stem: str, week: float | str, kind: str | None = "white") -> dict[str, Path]:
    """Files of a week: `surface`, and one for each of `MEASURES`.

    Parameters
    ----------
    kind : of the surface that was meshed; None: unknown
    """
    begin = f"{stem}_week-{week if isinstance(week, str) else f'{week:g}'}"
    named = {name: folder / f"{begin}_{name.replace('_', '')}.shape.gii" for name in MEASURES}
    return {"surface": folder / f"{begin}_{kind or 'surface'}.surf.gii", **named}


def weeks_in(folder: Path) -> list[list[Path]]:
    """Files of each week of each mesh in a folder."""

    def week(path: Path) -> str:
        return path.name.rpartition("_")[0]

    patterns = surface_files(Path(), "*", "*", "*").values()
    files = {path for pattern in patterns for path in folder.glob(str(pattern))}
    return [list(some) for _, some in groupby(sorted(files, key=lambda path: (week(path), path)), week)]


def weeks_of(surfaces: Sequence[float], start: float, end: float) -> list[float]:
    """The weeks of `fold.surfaces` that a fold reaches, rising."""
    return sorted({week for week in surfaces if start <= week <= end})
