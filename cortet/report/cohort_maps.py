"""Means of surface, fields and distance to the mesh over a cohort, on the mesh that its surfaces share.

A case that was resampled has a value at each vertex of the common mesh. Vertices with the same number are the same
location of the cortex in every case, so means over cases are meaningful.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import mode

from cortet.errors import InputError
from cortet.formats.atomic import write_json
from cortet.formats.gifti import read_surface, write_fields, write_surface
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.interpolation import at_triangles, is_label
from cortet.geometry.spheres import same_triangles
from cortet.geometry.topology import boundary_surface
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.transfer import THICKNESS, with_thickness

VERSION: int = 4

#: name of the map of distances from the surface that was meshed to the boundary of the mesh, mm
DISTANCE = "distance_to_boundary"
#: labels of maps whose unit is known
_LABELS = {DISTANCE: "distance to the boundary (mm)", THICKNESS: "thickness (mm)"}


def case_map(resampled: TriSurface, meshed: TriSurface, mesh: TetMesh) -> TriSurface:
    """The surface of a case at the vertices of the common mesh, with its fields and its distance to the mesh.

    Where a repair changed triangles, a vertex takes the nearest point of the surface that was meshed.

    Parameters
    ----------
    resampled : the surface as it was resampled onto the common mesh
    meshed : with its inner surfaces and fields; the distance to a corresponding inner surface is a field `thickness`
    mesh : the mesh of `meshed`
    """
    fields, points = with_thickness(meshed).point_data, meshed.points
    if not same_triangles(meshed, resampled):
        found = closest_points(tree_of(meshed), resampled.points)
        corners = meshed.faces[found.faces]
        fields = {name: at_triangles(values, corners, found.barycentric) for name, values in fields.items()}
        points = found.points
    distance = closest_points(tree_of(boundary_surface(mesh)[0]), points).distances
    return TriSurface(points, resampled.faces, {**fields, DISTANCE: distance}, resampled.frame)


def mean_map(cases: Sequence[TriSurface]) -> tuple[TriSurface, dict[str, int]]:
    """The mean surface with the mean of each field (the most frequent label), and the number of cases in each mean.

    Parameters
    ----------
    cases : from `case_map`, all on one mesh; a field may be missing in some of them
    """
    if not cases:
        raise InputError("no case is on the common mesh yet", remedy="see what failed in cohort_status.tsv")
    if {one.faces.shape for one in cases} != {cases[0].faces.shape}:
        raise InputError("the cases are not all on one common mesh", remedy="delete their maps and run again")
    counts = Counter(name for one in cases for name in one.point_data)
    fields = {name: _mean([one.point_data[name] for one in cases if name in one.point_data]) for name in counts}
    mean = TriSurface(_mean([one.points for one in cases]), cases[0].faces, fields)
    return mean, dict(counts)


def _mean(values: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The mean over cases, (n,) or (n, k); for labels the most frequent one, the smallest in a tie."""
    stacked = np.stack(values)
    if all(map(is_label, values)):
        return np.asarray(mode(stacked).mode)
    return np.asarray(stacked.mean(axis=0, dtype=np.float64))


def write_maps(
    cases: Sequence[tuple[str, str]],
    hemi: Literal["L", "R"],
    surface: str | Path,
    maps: str | Path,
    sidecar: str | Path,
    *pictures: str | Path,
) -> None:
    """Write the mean surface, its maps, a sidecar that names the cases, and pictures.

    Parameters
    ----------
    cases : name of a case, and file of its `case_map`
    hemi : their hemisphere
    """
    from cortet.report.figures import save  # no job on a case draws
    from cortet.report.surface_maps import maps_figure

    mean, counts = mean_map([read_surface(path) for _, path in cases])
    write_surface(replace(mean, point_data={}), surface)
    write_fields(mean.point_data, maps)
    write_json(
        {
            "Description": "Means over cases on the common mesh: of labels the most frequent one",
            "Cases": [name for name, _ in cases],
            "CasesOfMap": counts,
            "Units": {name: "mm" for name in _LABELS if name in mean.point_data},
        },
        sidecar,
    )
    scalars = {name: values for name, values in mean.point_data.items() if values.ndim == 1}
    labelled = {_LABELS.get(name, name.replace("_", " ")): values for name, values in scalars.items()}
    save(maps_figure(mean, labelled, hemi), *pictures)
