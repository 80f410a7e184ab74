"""How near is a mesh to its surfaces, everywhere and in both directions, and what does that cost?

    python benchmarks/fidelity.py SURFACE... [--cell-sizes 1.0 0.6] [--setting default] [--mesher lattice]
    python benchmarks/fidelity.py regions PIAL... [--cell-sizes 1.0] [--inner white] [--min-gaps 0.5]
                                  [--elements-across 1] [--keep FOLDER]

One row per surface and cell size, of the whole line, without an age. Distances are those of the vertices and face
centres of the surface that was meshed to the boundary of the mesh, and of the boundary's nodes and face centres to that
surface. The smallest altitude is the time step of an explicit solver, but for the speed of sound. Each row comes from a
process of its own with kernels compiled; CPU seconds are those of all threads, MB those above the idle process.

`regions` meshes white inside pial: the inner surface of `X_pial.surf.gii` is `X_white.surf.gii` beside it. `moved` is
what `separate` did to it. Columns on interfaces are about the worst of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from _frame import Line, Row, Table, alone, command, config_of, mesh, name_of

from cortet.formats import vtu
from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.nesting import nested
from cortet.geometry.topology import TET_FACES, boundary_surface, enclosed_volume, face_areas
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, FloatArray, TetMesh, TriSurface

COLUMNS = (
    *("surface", "h_mm", "tets", "q_max", "q_mean", "above_0.35"),
    *("surface_off_max_mm", "surface_off_mean_mm", "surface_off_max_h", "surface_off_mean_h"),
    *("nodes_off_max_mm", "face_centres_off_max_mm", "area_change", "volume_change"),
    *("altitude_min_mm", "altitude_min_h", "edge_length_h", "refined", "rounds", "cpu_seconds", "peak_MB", "why_not"),
)


def fidelity(
    surfaces: Sequence[Path], *, cell_sizes: Sequence[float] = (1.0,), setting: str = "default", mesher: str = ""
) -> None:
    """Mesh every surface at every cell size.

    Parameters
    ----------
    mesher
        Another one than the setting's.
    """
    table = Table(*COLUMNS)
    for file, h in product(surfaces, cell_sizes):
        table.add({"surface": name_of(file), "h_mm": h}, alone(of_surface, file, h, setting, mesher))


def of_surface(file: Path, cell_size: float, setting: str, mesher: str) -> Row:
    """Run the line in this process; the row of its mesh."""
    line = mesh(read_surface(file), config_of(cell_size, mesher, setting=setting), source=str(file))
    generated = line.reports["generate"]
    refinement = generated.get("refinement") or {}
    return {
        "edge_length_h": (generated["edge_length_mm"] or np.nan) / cell_size,
        "refined": refinement.get("vertices_refined", ""),
        "rounds": refinement.get("rounds", ""),
        **line.used,
        **measured(line.made.mesh, line.made.surface, cell_size),
    }


def measured(mesh: TetMesh, surface: TriSurface, cell_size: float) -> dict[str, Any]:
    """The numbers of a row that follow from the mesh and the surface it fills."""
    boundary, _ = boundary_surface(mesh)
    lost = closest_points(surface_tree(boundary.points, boundary.faces), with_centres(surface)).distances
    off = closest_points(surface_tree(surface.points, surface.faces), with_centres(boundary)).distances
    area, given_area = (face_areas(s.points, s.faces).sum() for s in (boundary, surface))
    volume, given_volume = (enclosed_volume(s.points, s.faces) for s in (boundary, surface))
    q, least = quality(mesh.points, mesh.cells), altitudes(mesh).min()
    return {
        "tets": len(q),
        "q_max": q.max(),
        "q_mean": q.mean(),
        "above_0.35": int((q > 0.35).sum()),
        "surface_off_max_mm": lost.max(),
        "surface_off_mean_mm": lost.mean(),
        "surface_off_max_h": lost.max() / cell_size,
        "surface_off_mean_h": lost.mean() / cell_size,
        "nodes_off_max_mm": off[: len(boundary.points)].max(),
        "face_centres_off_max_mm": off[len(boundary.points) :].max(),
        "area_change": area / given_area - 1,
        "volume_change": volume / given_volume - 1,
        "altitude_min_mm": least,
        "altitude_min_h": least / cell_size,
    }


def with_centres(surface: TriSurface) -> FloatArray:
    """Vertices, then face centres: (k, 3) mm."""
    return np.concatenate([surface.points, surface.points[surface.faces].mean(axis=1)])


def altitudes(mesh: TetMesh) -> FloatArray:
    """Smallest altitude of each tetrahedron: (m,) mm."""
    areas = [face_areas(mesh.points, mesh.cells[:, corners]) for corners in TET_FACES]
    return 3 * signed_volumes(mesh.points, mesh.cells) / np.max(areas, axis=0)


# --- two regions and more --------------------------------------------------------------------------------------------

REGION_COLUMNS = (
    *("pair", "h_mm", "min_gap_h", "across", "certified", "tets", "q_max", "q_mean", "q_mean_cortex"),
    *("above_0.45", "euler"),
    *("nodes_off_max_mm", "interface_nodes_off_max_mm", "surface_off_max_h", "interface_off_max_h"),
    *("cortex_volume_change", "edges_across_least", "edges_across_p5", "edges_across_median"),
    *("moved", "moved_mean_mm", "moved_max_mm", "cortex_ml_before", "cortex_ml", "edge_length_h"),
    *("cpu_seconds", "tets_per_cpu_second", "MB_per_million_tets", "why_not"),
)


def regions(
    pials: Sequence[Path],
    *,
    cell_sizes: Sequence[float] = (1.0,),
    inner: str = "white",
    min_gaps: Sequence[float] = (0.5,),
    elements_across: Sequence[int] = (1,),
    keep: Path | None = None,
) -> None:
    """Mesh every pair at every cell size.

    Parameters
    ----------
    keep
        Folder for the meshes.
    """
    table = Table(*REGION_COLUMNS)
    for file, h, gap, across in product(pials, cell_sizes, min_gaps, elements_across):
        row = {"pair": file.name.removesuffix("_pial.surf.gii"), "h_mm": h, "min_gap_h": gap, "across": across}
        table.add(row, alone(of_pair, file, inner, row, keep))


def of_pair(file: Path, inner: str, row: dict[str, Any], keep: Path | None) -> Row:
    """Run the line in this process; the row of its mesh."""
    inner_file = file.with_name(file.name.replace("_pial.", f"_{inner}."))
    surface = nested(read_surface(file), {inner: read_surface(inner_file)})
    config = config_of(row["h_mm"], regions={"min_gap": row["min_gap_h"], "elements_across": row["across"]})
    small = nested(ball(20.0), {"white": ball(16.0)})
    line = mesh(surface, config, small=small, source=str(file), inner={inner: str(inner_file)})
    if keep:
        keep.mkdir(parents=True, exist_ok=True)
        vtu.write(line.made.mesh, keep / f"{row['pair']}_{row['h_mm']:g}_{row['across']}.vtu")
    did = next((one for one in line.reports.get("separate", {}).get("surfaces", ()) if one["name"] == inner), None)
    moved = {key: did[key] for key in ("moved_mean_mm", "moved_max_mm")} if did else {}
    if did:
        moved |= {"moved": did["vertices_moved"], "cortex_ml_before": did["around_before_ml"]}
        moved |= {"cortex_ml": did["around_ml"]}
    return moved | of_regions(line, row["h_mm"])


def of_regions(line: Line, cell_size: float) -> dict[str, Any]:
    """What a mesh of regions took, and what its certificate says."""
    mesh, verdict = line.made.mesh, line.made.certificate
    (cortex,) = (one for one in verdict.regions if one.name == "cortex")
    q, edges = quality(mesh.points, mesh.cells), cortex.edges_across
    assert edges is not None  # the cortex has the white surface inside it
    return {
        "edge_length_h": line.reports["generate"]["edge_length_mm"] / cell_size,
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
        "cpu_seconds": line.used["cpu_seconds"],
        "tets_per_cpu_second": len(q) / line.used["cpu_seconds"],
        "MB_per_million_tets": line.used["peak_MB"] / len(q) * 1e6,
        "why_not": "; ".join(verdict.reasons),
    }


def ball(radius: float) -> TriSurface:
    """A sphere about the origin, mm."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return TriSurface(sphere.vertices, sphere.faces)


main = command(__doc__, fidelity, regions)

if __name__ == "__main__":
    main()
