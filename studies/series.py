"""Surfaces of one brain, or of one atlas, at several ages, whose vertices correspond.

Surfaces are compared after a rigid alignment (Kabsch 1976), since the position of a brain in its file means nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from cortet.errors import InputError
from cortet.folding.body import scale_of
from cortet.folding.medial_wall import medial_wall
from cortet.folding.surface_growth import check_corresponding, through_spheres
from cortet.formats.gifti import read_fields, read_label_names, read_surface
from cortet.geometry.spheres import vertex_areas
from cortet.geometry.topology import enclosed_volume
from cortet.meshes import FloatArray, TriSurface


@dataclass(frozen=True, eq=False)
class Series:
    """Surfaces of one brain at several ages, whose vertices correspond."""

    #: weeks, ascending
    ages: tuple[float, ...]
    surfaces: tuple[TriSurface, ...]
    #: (n,), area around each vertex at the first age, mm2; 0 where there is no cortex
    weights: FloatArray
    #: registered sphere of the vertices
    sphere: TriSurface | None = None
    #: name of a lobe, or of any other parcel -> (n,), whether a vertex is in it
    lobes: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)

    @property
    def first(self) -> TriSurface:
        """The surface that is meshed."""
        return self.surfaces[0]

    def at(self, age: float) -> TriSurface:
        """The surface of an age."""
        return self.surfaces[self.ages.index(age)]

    def volumes(self) -> dict[float, float]:
        """Enclosed volume at each age, mL."""
        return {
            age: abs(enclosed_volume(one.points, one.faces)) / 1000
            for age, one in zip(self.ages, self.surfaces, strict=True)
        }

    def hulls(self) -> dict[float, float]:
        """Volume of the convex hull at each age, mL."""
        return {age: ConvexHull(one.points).volume / 1000 for age, one in zip(self.ages, self.surfaces, strict=True)}


def series_of(
    surfaces: Mapping[float, TriSurface], cortex: FloatArray | None = None, sphere: TriSurface | None = None
) -> Series:
    """The series of surfaces by age, aligned to the first one.

    Parameters
    ----------
    cortex : (n,), above 0 at vertices of the cortex, such as its thickness; None: everywhere
    sphere : registered sphere of the vertices

    Raises
    ------
    InputError : there are fewer than two, or their vertices do not correspond
    """
    if len(surfaces) < 2:
        raise InputError("a series has one surface only", remedy="name surfaces of two ages or more")
    ages = sorted(surfaces)
    first = surfaces[ages[0]]
    for age in ages[1:]:
        check_corresponding(first, surfaces[age])
    weights = vertex_areas(first)
    if cortex is not None:
        weights = np.where(np.asarray(cortex) > 0, weights, 0.0)
    laid: tuple[TriSurface, ...] = (
        first,
        *(replace(surfaces[age], points=aligned(surfaces[age].points, first.points, weights)) for age in ages[1:]),
    )
    return Series(tuple(ages), laid, weights, sphere)


def read_series(
    files: Mapping[float, Path],
    spheres: Sequence[Path],
    hemisphere: str | None,
    labels: Path | None = None,
) -> Series:
    """The series of some files by ascending age, in mm, with one sphere for each file or none at all.

    Parameters
    ----------
    labels : file with a label for each vertex of the first surface, such as its lobe

    Raises
    ------
    InputError : a file cannot be read, vertices correspond neither by number nor through spheres, or labels are of
        another surface
    """
    surfaces = [read_surface(path) for path in files.values()]
    own = [read_surface(path) for path in spheres]
    if own and any(not np.array_equal(surface.faces, surfaces[0].faces) for surface in surfaces):
        surfaces = [through_spheres(surface, sphere, own[0]) for surface, sphere in zip(surfaces, own, strict=True)]
    first = surfaces[0]
    found = series_of(dict(zip(files, surfaces, strict=True)), cortex_of(first, hemisphere), own[0] if own else None)
    return replace(found, lobes=lobes_of(labels, len(first.points))) if labels else found


def lobes_of(labels: Path, count: int) -> dict[str, NDArray[np.bool_]]:
    """Name of each label of a file -> which of `count` vertices have it; labels below 1 are none.

    Raises
    ------
    InputError : the file has no labels, values that are not whole numbers, or another number of them
    """
    values = next(iter(read_fields(labels).values()), np.empty(0))
    if values.shape != (count,):
        raise InputError(
            f"has {len(values)} labels, but the first surface of the series has {count} vertices",
            file=labels,
            remedy="name labels of this very surface",
        )
    if not (np.isfinite(values).all() and (values == np.round(values)).all()):
        raise InputError("has values that are not whole numbers", file=labels, remedy="name a file of labels")
    names, lobes = read_label_names(labels), dict[str, NDArray[np.bool_]]()
    for key in map(int, np.unique(values[values > 0])):
        name = names.get(key, f"{key}")
        lobes[name] = lobes.get(name, False) | (values == key)  # two labels of one name are one lobe
    return lobes


def aligned(points: FloatArray, to: FloatArray, weights: FloatArray) -> FloatArray:
    """Points (n, 3) moved rigidly onto corresponding points, with the least weighted squared distance."""
    middle, other = (np.average(p, axis=0, weights=weights) for p in (points, to))
    rotation, _ = Rotation.align_vectors(to - other, points - middle, weights)
    result: FloatArray = rotation.apply(points - middle) + other
    return result


def cortex_of(first: TriSurface, hemisphere: str | None) -> FloatArray | None:
    """1 at vertices of a hemisphere's cortex, 0 on its medial wall: (n,); None for a whole brain."""
    if hemisphere is None:
        return None
    scale = scale_of(first, hemisphere)
    return np.where(medial_wall(first, hemisphere, scale.origin, scale.length).nodes, 0.0, 1.0)
