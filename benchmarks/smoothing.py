"""How far smoothing leads away from a surface, and what a mesh has of it: the paper's method beside ours.

    python benchmarks/smoothing.py SURFACE... [--cell-size 0.6]
    python benchmarks/smoothing.py SURFACE... --voxels 0.5

Two rows per surface: the default line with the smoothing by gestational age of the paper, and with its own. Distances
are those between the boundary of the mesh and the surface as it was read, the larger of both directions. The age is
taken from the file's name (STA28, GW30, week40, GA27, 22w).

With `--voxels` nothing is meshed: the surface is made into a label image with voxels of so many mm and taken out of it
again by marching cubes. A row says how far what each method makes of these stair steps is from the true surface.
"""

from __future__ import annotations

import argparse
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rows import in_own_process, print_row

from cortet.config import SETTINGS, load
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.geometry.winding import winding_numbers
from cortet.meshes import TriSurface
from cortet.pipeline import mesh_surface, warm_up
from cortet.stages.smooth_surface import SmoothReport, smooth_surface

COLUMNS = (
    *("surface", "weeks", "smoothing", "iterations", "native_mean_mm", "native_max_mm", "native_area_change"),
    *("q_max", "certified", "cpu_seconds", "why_not"),
)
VOXEL_COLUMNS = ("surface", "weeks", "smoothing", "iterations", "true_mean_mm", "true_max_mm", "true_area_change")
METHODS: dict[str, dict[str, Any]] = {"published": SETTINGS["published"]["smooth_surface"], "taubin": {}}


def age_of(file: Path) -> float | None:
    """Gestational age in weeks, as the name of a file says."""
    found = re.search(r"(?:STA|GW|GA|week|_w)(\d{2})|(\d{2})w", file.name)
    return float(found[1] or found[2]) if found else None


def measure(file: Path, cell_size: float, method: str, answer) -> None:  # type: ignore[no-untyped-def]
    """Run the line in this process and send back the row of its mesh."""
    row = {"surface": file.name.removesuffix(".surf.gii"), "weeks": age_of(file), "smoothing": method}
    warm_up()
    began = time.process_time()
    try:
        config = load({"generate": {"cell_size": cell_size}, "smooth_surface": METHODS[method]})
        made = mesh_surface(read_surface(file), config, gestational_age=age_of(file), source=file)
    except CortetError as error:
        answer.send(row | {"why_not": str(error)})
        return
    certificate = made.certificate
    native, checks = certificate.native, {check.name: check.value for check in certificate.checks}
    answer.send(
        row
        | {
            "iterations": certificate.reports.get("smooth_surface", {}).get("chosen_iterations", ""),
            "native_mean_mm": checks["distance between the boundary and the native surface, on average"],
            "native_max_mm": checks["distance between the boundary and the native surface, at most"],
            "native_area_change": native.relative_area_change if native else "",
            "q_max": certificate.quality.q.max,
            "certified": certificate.certified,
            "cpu_seconds": time.process_time() - began,
            "why_not": "; ".join(reason.split(";")[0] for reason in certificate.reasons),
        }
    )


def with_steps(surface: TriSurface, voxel: float) -> TriSurface:
    """The surface as the boundary of a label image with voxels of so many mm."""
    import pyvista

    low = surface.points.min(axis=0) - 2 * voxel
    count = np.ceil((surface.points.max(axis=0) - low) / voxel).astype(int) + 3
    grid = pyvista.ImageData(dimensions=count, spacing=(voxel,) * 3, origin=low)
    inside = (winding_numbers(surface, np.asarray(grid.points)) > 0.5).astype(float)
    found = grid.contour([0.5], inside, method="flying_edges").clean()
    made = TriSurface(np.asarray(found.points, float), found.faces.reshape(-1, 4)[:, 1:].astype(np.int32))
    return made if enclosed_volume(made.points, made.faces) > 0 else replace(made, faces=made.faces[:, ::-1])


def print_voxel_rows(file: Path, voxel: float) -> None:
    """What is left of the stair steps of one surface: without smoothing, and by each method."""
    true, age = read_surface(file), age_of(file)
    steps = with_steps(true, voxel)
    made: dict[str, tuple[TriSurface, SmoothReport | None]] = {"none": (steps, None)}
    possible = {method: keys for method, keys in METHODS.items() if method != "published" or age is not None}
    made |= {method: smooth_surface(steps, gestational_age=age, **keys) for method, keys in possible.items()}
    true_area = face_areas(true.points, true.faces).sum()
    for method, (surface, report) in made.items():
        distances = closest_points(tree_of(true), surface.points).distances
        print_row(
            VOXEL_COLUMNS,
            {
                "surface": file.name.removesuffix(".surf.gii"),
                "weeks": age,
                "smoothing": method,
                "iterations": report.chosen_iterations if report else "",
                "true_mean_mm": float(distances.mean()),
                "true_max_mm": float(distances.max()),
                "true_area_change": float(face_areas(surface.points, surface.faces).sum() / true_area - 1),
            },
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--cell-size", type=float, default=0.6)
    parser.add_argument("--voxels", type=float, metavar="MM", help="mesh nothing: smooth stair steps of this size")
    options = parser.parse_args()
    print(*(VOXEL_COLUMNS if options.voxels else COLUMNS), sep="\t")
    for file in options.surfaces:
        if options.voxels:
            print_voxel_rows(file, options.voxels)
            continue
        for method in METHODS:
            print_row(COLUMNS, in_own_process(measure, file, options.cell_size, method))


if __name__ == "__main__":
    main()
