"""How true are columns, depths and layers of the cortex, and what do they cost?

    python benchmarks/layers.py [--cell-sizes 1.5 1.0 0.75]
    python benchmarks/layers.py pairs PIAL... [--cell-sizes 1.0] [--layers 4]

The first is on shells of 3 mm. Inside out, as in a sulcus, they give the same numbers, since columns do not know which
of their ends is the pial one. Errors are means over the nodes between the surfaces: of the thickness in mm, of both
depths, and of the angle between a column and the radius. `layers_off` is the largest error of the volume of one of
three layers, relative.

`pairs` compares the cortex between `X_white.surf.gii` and `X_pial.surf.gii`, whose vertices correspond, with what
others measure: the thickness of FreeSurfer (the mean of the distances from each surface to the other, B. Fischl and
A. M. Dale, PNAS 97, 2000, 11050-11055), the straight distance between vertices, and at each bound of the layers the
surface of M. D. Waehnert et al., NeuroImage 93, 2014, 210-220, which divides straight lines by the areas around their
ends. It is about vertices that have a column, where the surfaces are half a cell or more apart. `angle` is the median
between a column and the normal of a surface, degrees, `cut` the share of tetrahedra that a bound of the layers cuts.
CPU seconds are those of the layers, and relative to those of the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from _frame import Line, Row, Table, alone, command, config_of, mesh, name_of, print_power, spent

from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.icosphere import icosphere
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_nodes, face_areas, sheet, vertex_normals
from cortet.measure.layers import Cortex, bounds_of, cortical_columns, layer_records
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.solver_files.laminar import Laminar
from cortet.solver_files.surface_map import surface_map

THICKNESS = 3.0
#: outer radii, mm
RADII = (13.0, 23.0, 53.0)
#: the finest cells at which the largest sphere is meshed
LARGE, LARGE_MM = 50.0, 1.0

SHELLS = (
    *("radius_mm", "h_mm", "across", "tets", "columns", "thickness_off", "depth_off", "equivolumetric_off"),
    *("they_differ", "angle_deg", "layers_off", "cpu_seconds", "of_mesh", "why_not"),
)
PAIRS = (
    *("surface", "h_mm", "across", "tets", "columns", "thickness_mm", "freesurfer_mm", "straight_mm", "correlation"),
    *(
        "depth",
        "waehnert_off_median",
        "waehnert_off_p95",
        "crossing",
        "angle_pial",
        "angle_white",
        "cut",
        "cpu_seconds",
        "of_mesh",
    ),
    "why_not",
)


def shells(*, cell_sizes: Sequence[float] = (1.5, 1.0, 0.75)) -> None:
    """Shells of known thickness and depths, by curvature and cell size."""
    table = Table(*SHELLS)
    for radius in RADII:
        sizes = [h for h in cell_sizes if radius < LARGE or h >= LARGE_MM]
        rows = [table.add({"radius_mm": radius, "h_mm": h}, alone(of_shell, radius, h)) for h in sizes]
        print_power(f"{radius:g} mm", rows, "h_mm", "equivolumetric_off")


def of_shell(radius: float, h: float) -> Row:
    """Errors of thickness, depths, directions and layers of one shell."""
    ball, inside = icosphere(6), radius - THICKNESS
    outer, white = (TriSurface(size * ball.points, ball.faces) for size in (radius, inside))
    line = mesh(nested(outer, {"white": white}), config_of(h, smooth_surface={"enabled": False}))
    made = line.made.mesh
    with spent() as used:
        records = layer_records(made, ["white"], [1, 1, 1])
    cortex = cortical_columns(made, ["white"])
    found, r = cortex.columns, np.linalg.norm(cortex.columns.wall.points, axis=1)
    depth, share = (radius - r) / THICKNESS, (radius**3 - r**3) / (radius**3 - inside**3)
    between = np.setdiff1d(np.arange(len(r)), boundary_nodes(found.wall))
    cosine = np.abs(np.einsum("nc,nc->n", found.direction, found.wall.points / r[:, None]))
    volumes = np.array([record.volume_ml for record in records])
    across = line.made.certificate.regions[0].edges_across
    return {
        "across": across.median if across else "",
        "tets": len(found.wall.cells),
        "columns": cortex.known.mean(),
        "thickness_off": np.abs(found.thickness - THICKNESS).mean(),
        "depth_off": np.abs(found.depth(equivolumetric=False)[0] - depth)[between].mean(),
        "equivolumetric_off": np.abs(found.depth(equivolumetric=True)[0] - share)[between].mean(),
        "they_differ": np.abs(depth - share)[between].mean(),
        "angle_deg": np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean(),
        "layers_off": np.abs(volumes / volumes.mean() - 1).max(),
        **cost(line, used),
    }


def cost(line: Line, used: Row) -> Row:
    """CPU seconds of the layers, and relative to the mesh."""
    return {"cpu_seconds": used["cpu_seconds"], "of_mesh": used["cpu_seconds"] / line.used["cpu_seconds"]}


def pairs(pials: Sequence[Path], *, cell_sizes: Sequence[float] = (1.0,), layers: int = 4) -> None:
    """Real pairs of surfaces, beside what FreeSurfer and Waehnert measure."""
    table = Table(*PAIRS)
    for file, h in product(pials, cell_sizes):
        found = alone(of_pair, file, h, layers)
        for row in found.get("bounds", [{}]):
            table.add({"surface": name_of(file), "h_mm": h}, found, row)


def of_pair(file: Path, h: float, layers: int) -> Row:
    """The cortex of one pair, and a row for each bound of its layers."""
    pial, white = (read_surface(str(file).replace("_pial", kind)) for kind in ("_pial", "_white"))
    line = mesh(nested(pial, {"white": white}), config_of(h))
    made, meshed = line.made.mesh, line.made.surface.inner["white"]
    with spent() as used:
        records = layer_records(made, ["white"], [1] * layers)
    cortex = cortical_columns(made, ["white"])
    found = surface_map(made, meshed, white, number=1)
    of_nodes = np.full(len(made.points), np.nan)
    of_nodes[cortex.nodes[cortex.known]] = cortex.columns.thickness[cortex.known]
    thickness = found.on_surface(of_nodes)
    there, back = (
        closest_points(tree_of(one), other.points).distances for one, other in ((pial, white), (white, pial))
    )
    freesurfer, straight = (there + back) / 2, np.linalg.norm(pial.points - white.points, axis=1)
    apart = np.isfinite(thickness) & (freesurfer > h / 2)
    laminar, bounds = Laminar(found, ["white"]), []
    for depth in bounds_of([1] * layers).tolist()[1:-1]:
        points, theirs = laminar.points(depth), waehnert(white, pial, depth)
        off = closest_points(tree_of(TriSurface(theirs, white.faces)), points[apart]).distances
        placed = np.where(np.isfinite(points), points, found.points)
        bounds.append(
            {
                "depth": depth,
                "waehnert_off_median": np.median(off),
                "waehnert_off_p95": np.percentile(off, 95),
                "crossing": len(self_intersections(TriSurface(placed, white.faces))),
            }
        )
    across = line.made.certificate.regions[0].edges_across
    return {
        "across": across.median if across else "",
        "tets": len(made.cells),
        "columns": np.isfinite(thickness).mean(),
        "thickness_mm": np.median(thickness[apart]),
        "freesurfer_mm": np.median(freesurfer[apart]),
        "straight_mm": np.median(straight[apart]),
        "correlation": np.corrcoef(thickness[apart], freesurfer[apart])[0, 1],
        **angles(made, cortex),
        "cut": np.average([one.cut for one in records], weights=[one.tetrahedra for one in records]),
        "bounds": bounds,
        **cost(line, used),
    }


def waehnert(white: TriSurface, pial: TriSurface, depth: float) -> FloatArray:
    """Points of equivolumetric depth on straight lines between corresponding vertices: (v, 3) mm."""
    outside, inside = (around(one) for one in (pial, white))
    share = 1 - depth  # of the volume between the white surface and the point
    root = np.sqrt(share * outside**2 + (1 - share) * inside**2)
    same = np.abs(outside - inside) < 1e-9
    way = np.where(same, share, (root - inside) / np.where(same, 1.0, outside - inside))
    return white.points + way[:, None] * (pial.points - white.points)


def around(surface: TriSurface) -> FloatArray:
    """The area around each vertex, a third of its triangles: (v,) mm2."""
    areas = np.repeat(face_areas(surface.points, surface.faces) / 3, 3)
    return np.bincount(surface.faces.ravel(), areas, minlength=len(surface.points))


def angles(mesh: TetMesh, cortex: Cortex) -> Row:
    """Median angle between columns and the normals of both surfaces, degrees."""
    direction = np.full((len(mesh.points), 3), np.nan)
    direction[cortex.nodes[cortex.known]] = cortex.columns.direction[cortex.known]
    found = {}
    for number, name in enumerate(("pial", "white")):
        surface, nodes = sheet(mesh, number)
        cosine = np.einsum("vc,vc->v", vertex_normals(surface.points, surface.faces), direction[nodes])
        found[f"angle_{name}"] = np.degrees(np.nanmedian(np.arccos(np.clip(cosine, -1, 1))))
    return found


main = command(__doc__, shells, pairs)

if __name__ == "__main__":
    main()
