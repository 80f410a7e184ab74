"""A fold comes home: the folded cortex on the vertices of the surface that its mesh was made from, with maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, counted
from cortet.folding.fields import THICKNESS_FIELD
from cortet.folding.journal import SERIES, series
from cortet.folding.measurements import depth_below_hull, gaussian_curvature, local_gyrification, mean_curvature
from cortet.formats import vtu
from cortet.formats.gifti import write_fields, write_surface
from cortet.formats.values import in_components
from cortet.formats.volumes import matrices
from cortet.geometry.interpolation import applied
from cortet.geometry.spheres import vertex_areas
from cortet.geometry.topology import vertex_normals
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.solver_files.results import invariants
from cortet.solver_files.surface_map import SurfaceMap

VERSION: int = 2

#: mm by which the start of a frame may differ from the mesh, and weeks by which its age may from that asked for
_SAME = 1e-6


def folded_surface(frame: TetMesh, found: SurfaceMap) -> TriSurface:
    """The native surface as it is folded in a frame, mm: each vertex moves as its point of the mesh does.

    Parameters
    ----------
    frame : of `fold`, for a week of `fold.surfaces`: the mesh of `found`, moved
    found : map of the mesh that was folded
    """
    start = frame.points - frame.point_data["displacement"]
    if start.shape != found.mesh.points.shape or np.abs(start - found.mesh.points).max() > _SAME:
        raise InputError(
            "the fold is of another mesh", remedy="name the mesh that was folded, or fold this mesh into a new folder"
        )
    moved = applied(found.to_surface, frame.point_data["displacement"])
    points = found.native.points + moved
    if lost := int((~np.isfinite(points).all(axis=1)).sum()):
        raise InputError(
            f"{counted(lost, 'vertex of the surface has', 'vertices of the surface have')} no position",
            remedy="repair the surface with `cortet repair`",
        )
    return replace(found.native, points=points)


def maps_of(frame: TetMesh, start: TetMesh, found: SurfaceMap) -> tuple[TriSurface, dict[str, FloatArray]]:
    """The folded surface of a frame, and the values of `MEASURES` at its vertices: (v,), of directions (v, 3).

    - depth: distance from the convex hull of the folded surface (`measurements.depth_below_hull`).
    - mean and Gaussian curvature: gradient of the area, lacking angle (Meyer et al. 2003; not smoothed).
    - local gyrification: Toro et al., Cerebral Cortex 18, 2008 (`measurements.local_gyrification`).
    - thickness: that at the start, times how much longer the line across the cortex has become since then.
    - growth of area: area of a vertex, a third of that of its triangles, over that at the start.
    - stress: largest eigenvalue of the mean Cauchy stress; pressure: minus a third of its trace (Holzapfel, Nonlinear
      Solid Mechanics, 2000, sections 3.3 and 6.4); positive stress is tension, along which fibres lie (Xu et al.,
      Journal of Biomechanical Engineering 132, 2010). The direction points outward.
    - stretch: mean of the largest stretch of the elastic deformation, without growth.

    Values of the mechanics are means over the cortex as it was at the start, and over an equal depth of tissue below
    it. A vertex where the mesh is too thin for that is NaN.

    Parameters
    ----------
    frame, start : as in `folded_surface`; `start` is the first one of the fold
    """
    surface = folded_surface(frame, found)
    if not {"stress", "stretch", THICKNESS_FIELD} <= frame.cell_data.keys():
        raise InputError("the frame holds no stress", remedy="name its week in fold.surfaces, and fold again")
    points, faces = surface.points, surface.faces
    thick = found.on_surface(frame.cell_data[THICKNESS_FIELD])
    at_depth = found.weights(thick).nodes

    def across(moved: FloatArray) -> FloatArray:
        """Length of what was the straight line across the cortex in the user's mesh."""
        line = thick[:, None] * found.normals + applied(found.to_surface, moved) - applied(at_depth, moved)
        return np.asarray(np.linalg.norm(line, axis=1))

    normals = vertex_normals(points, faces)
    maps = {
        "depth": depth_below_hull(points),
        "mean_curvature": mean_curvature(points, faces),
        "gaussian_curvature": gaussian_curvature(points, faces),
        "local_gyrification": local_gyrification(points, faces),
        "thickness": thick * across(frame.point_data["displacement"]) / across(start.point_data["displacement"]),
        "area_growth": vertex_areas(surface) / vertex_areas(folded_surface(start, found)),
    }
    for tissue, above in {"cortex": 0 * thick, "white": thick}.items():
        matrix = found.weights((above, above + thick)).cells
        tensors = matrices(applied(matrix, frame.cell_data["stress"]))
        of_stress = invariants(tensors)
        maps |= {
            f"{tissue}_stress": of_stress["principal_1"],
            f"{tissue}_direction": _largest_direction(tensors, normals),
            f"{tissue}_pressure": of_stress["pressure"],
            f"{tissue}_stretch": applied(matrix, frame.cell_data["stretch"]),
        }
    return surface, maps


def _largest_direction(tensors: NDArray[np.float64], outward: FloatArray) -> FloatArray:
    """Unit eigenvectors (k, 3) of the largest eigenvalues of tensors (k, 3, 3), on the side of a vector (k, 3)."""
    known = np.isfinite(tensors).all(axis=(1, 2))
    found = np.full((len(tensors), 3), np.nan)
    found[known] = np.linalg.eigh(tensors[known])[1][:, :, 2]
    return np.where((found * outward).sum(axis=1, keepdims=True) < 0, -found, found)


def write_surfaces(
    folder: Path,
    week: float,
    found: SurfaceMap,
    files: Mapping[str, Path],
    *,
    like: Path,
    hemi: Literal["L", "R"] | None,
) -> None:
    """Write the folded surface of a week, and its maps.

    Parameters
    ----------
    folder : of the fold
    found : map of the mesh that was folded
    files : of `surface_files`
    like : file of the native surface, whose metadata the folded one has
    """
    frames = series(folder / SERIES)
    frame = next((file for file, age in frames if abs(age - week) < _SAME), None)
    if frame is None:
        raise InputError(
            f"has no frame at {week:g} weeks; the last frame is at {frames[-1][1]:g}",
            file=folder,
            remedy="set fold.surfaces to weeks before an element inverts, and fold again",
        )
    surface, maps = maps_of(vtu.read(frame), vtu.read(frames[0][0]), found)
    write_surface(surface, files["surface"], like=like)
    for name, values in maps.items():
        columns = in_components({name: values}, {1})
        write_fields({key: column[:, 0] for key, column in columns.items()}, files[name], hemisphere=hemi)
