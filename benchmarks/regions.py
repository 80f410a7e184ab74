"""Meshes of two regions: white inside pial. How good they are, how near both surfaces, and what that costs.

    python benchmarks/regions.py PIAL... [--cell-sizes 1.0] [--inner white] [--min-gaps 0.5] [--elements-across 1]
                                         [--shell MM] [--cavity SHARE] [--keep FOLDER]

The inner surface of `X_pial.surf.gii` is `X_white.surf.gii` beside it. One row per pair, cell size, gap and number of
elements, of the whole line on the surfaces as they are (not smoothed) and the certificate. `moved` is what `separate`
did to the inner surface. With a shell, or a cavity out of a label volume in the middle of the white matter, these are
regions, too; columns on interfaces are about the worst of them. Each row comes from a process of its own with kernels
compiled; CPU seconds are those of all threads, without reading and the certificate; MB those above the idle process.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from rows import in_own_process, print_row
from scipy import ndimage

from cortet.config import load
from cortet.errors import CortetError
from cortet.formats import vtu
from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import tree_of
from cortet.geometry.label_surface import label_surfaces
from cortet.geometry.nesting import depths, nested
from cortet.measure.certify import certify
from cortet.measure.quality import quality
from cortet.meshes import REGION, TetMesh, TriSurface, single_precision
from cortet.pipeline import run
from cortet.report.stage_table import peak_memory_mb, reset_peak_memory
from cortet.solver_files.label_surfaces import with_shell

COLUMNS = (
    *("pair", "h_mm", "min_gap_h", "across", "certified", "tets", "q_max", "q_mean", "q_mean_cortex"),
    *("above_0.45", "euler"),
    *("nodes_off_max_mm", "interface_nodes_off_max_mm", "surface_off_max_h", "interface_off_max_h"),
    *("cortex_volume_change", "edges_across_least", "edges_across_p5", "edges_across_median"),
    *("moved", "moved_mean_mm", "moved_max_mm", "cortex_ml_before", "cortex_ml", "edge_length_h"),
    *("cpu_seconds", "tets_per_cpu_second", "MB_per_million_tets", "why_not"),
)

#: of the label volume of a cavity, mm
VOXEL = 0.8


def ball(radius: float) -> TriSurface:
    """A sphere about the origin, mm."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return TriSurface(sphere.vertices, sphere.faces)


def cavity(white: TriSurface, share: float) -> TriSurface:
    """A ventricle-like cavity: the largest piece of what is deeper than a share of the deepest, in voxels of 0.8 mm.

    The depth is smoothed over 2 mm, or the cavity would have the ridges of a skeleton.
    """
    low, high = white.points.min(axis=0), white.points.max(axis=0)
    shape = np.ceil((high - low) / VOXEL).astype(int) + 1
    centres = low + VOXEL * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    depth, _, _ = depths(tree_of(white), white, centres.reshape(-1, 3))
    affine = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    affine[:3, 3] = low
    smooth = ndimage.gaussian_filter(depth.reshape(shape), 2.0 / VOXEL)
    made, _ = label_surfaces(smooth > share * smooth.max(), affine)
    return single_precision(made[0].surface)


def compile_kernels() -> None:
    """Mesh one ball inside another."""
    list(run(nested(ball(20.0), {"white": ball(16.0)}), load({"generate": {"cell_size": 3.0}})))


def measure(file: Path, values: tuple[float, float, int], options: argparse.Namespace, answer) -> None:  # type: ignore[no-untyped-def]
    """Run the line in this process and send back the row of its mesh."""
    cell_size, min_gap, across = values
    row: dict[str, Any] = {"pair": file.name.removesuffix("_pial.surf.gii")}
    row |= {"h_mm": cell_size, "min_gap_h": min_gap, "across": across}
    compile_kernels()
    inner_file = file.with_name(file.name.replace("_pial.", f"_{options.inner}."))
    surface = nested(read_surface(file), {options.inner: read_surface(inner_file)})
    if options.cavity:
        surface = nested(surface, {**surface.inner, "cavity": cavity(surface.inner[options.inner], options.cavity)})
    if options.shell:
        surface = with_shell(surface, options.shell)
    reset_peak_memory()
    idle, began = peak_memory_mb() or 0, time.process_time()
    try:
        regions = {"min_gap": min_gap, "elements_across": across}
        config = load({"generate": {"cell_size": cell_size}, "regions": regions})
        for step in run(surface, config, source=file, inner_sources={options.inner: inner_file}):
            if step.stage == "separate":
                (did,) = (one for one in step.report["surfaces"] if one["name"] == options.inner)
                row |= {"moved": did["vertices_moved"], "cortex_ml_before": did["around_before_ml"]}
                row |= {key: did[key] for key in ("moved_mean_mm", "moved_max_mm")} | {"cortex_ml": did["around_ml"]}
            if step.stage == "generate":
                row["edge_length_h"] = step.report["edge_length_mm"] / cell_size
    except CortetError as error:
        answer.send(row | {"why_not": str(error)})
        return
    seconds, memory = time.process_time() - began, (peak_memory_mb() or 0) - idle
    mesh = step.result
    assert isinstance(mesh, TetMesh)  # the line ends with a mesh
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        vtu.write(mesh, options.keep / f"{row['pair']}_{cell_size:g}_{across}.vtu")
    verdict = certify(mesh, step.surface, **config.arguments("certify", {"cell_size": cell_size}))
    (cortex,) = (one for one in verdict.regions if one.name == "cortex")
    q, edges = quality(mesh.points, mesh.cells), cortex.edges_across
    assert edges is not None  # the cortex has the white surface inside it
    answer.send(
        row
        | {
            "certified": "yes" if verdict.certified else "no",
            "tets": len(q),
            "q_max": q.max(),
            "q_mean": q.mean(),
            "q_mean_cortex": q[np.asarray(mesh.cell_data[REGION]) == cortex.number].mean(),
            "above_0.45": int((q > 0.45).sum()),
            "euler": ", ".join(str(one.topology.euler_number) for one in (verdict, *verdict.interfaces)),
            "nodes_off_max_mm": verdict.fidelity.nodes_to_surface_mm.max,
            "interface_nodes_off_max_mm": max(one.nodes_to_surface_mm.max for one in verdict.interfaces),
            "surface_off_max_h": verdict.fidelity.surface_to_boundary_mm.max / cell_size,
            "interface_off_max_h": max(one.surface_to_interface_mm.max for one in verdict.interfaces) / cell_size,
            "cortex_volume_change": cortex.relative_volume_change,
            "edges_across_least": edges.least,
            "edges_across_p5": edges.p5,
            "edges_across_median": edges.median,
            "cpu_seconds": seconds,
            "tets_per_cpu_second": len(q) / seconds,
            "MB_per_million_tets": memory / len(q) * 1e6,
            "why_not": "; ".join(verdict.reasons),
        }
    )


def main() -> None:
    """Mesh every pair at every cell size and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pials", nargs="+", type=Path)
    parser.add_argument("--cell-sizes", nargs="+", type=float, default=[1.0])
    parser.add_argument("--inner", default="white")
    parser.add_argument("--min-gaps", nargs="+", type=float, default=[0.5], help="values of regions.min_gap")
    parser.add_argument("--elements-across", nargs="+", type=int, default=[1], help="of regions.elements_across")
    parser.add_argument("--shell", type=float, help="mm from the pial surface to that of a region csf around it")
    parser.add_argument("--cavity", type=float, help="what lies deeper than this share of the deepest is a cavity")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the meshes there")
    options = parser.parse_args()
    print(*COLUMNS, sep="\t")
    for file in options.pials:
        for values in product(options.cell_sizes, options.min_gaps, options.elements_across):
            print_row(COLUMNS, {"pair": file.name} | in_own_process(measure, file, values, options))


if __name__ == "__main__":
    main()
