"""From the vertices of a surface to those of a common sphere, and means over the parcels of a surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.gifti import read_fields, read_label_names, read_surface
from cortet.geometry.interpolation import is_label
from cortet.geometry.spheres import Weights, barycentric, flaws, of_one_radius, same_triangles, vertex_areas
from cortet.meshes import TriSurface


@dataclass(frozen=True)
class Parcels:
    """Parcels of a surface."""

    #: (v,) key of the parcel of each vertex
    keys: NDArray[np.integer]
    #: key -> name
    names: Mapping[int, str]
    #: (v,) mm2
    areas: NDArray[np.float64]

    def means(self, values: NDArray[Any]) -> dict[str, float]:
        """Mean of values (v,) over the area of each parcel, by its name; NaN where no vertex has a value.

        Parcels of one name are one parcel.
        """
        names, place = self._places
        weights = np.where(np.isfinite(values), self.areas, 0.0)
        total = np.bincount(place, weights * np.nan_to_num(values))
        area = np.bincount(place, weights)
        means = np.divide(total, area, out=np.full(len(names), np.nan), where=area > 0)
        return dict(zip(names, means.tolist(), strict=True))

    @property
    def _places(self) -> tuple[list[str], NDArray[np.intp]]:
        """Names of parcels, and which of them each vertex belongs to."""
        keys, of_key = np.unique(self.keys, return_inverse=True)
        names, place = np.unique([self.names.get(int(key), str(key)) for key in keys], return_inverse=True)
        return names.tolist(), place[of_key]


def read_parcels(file: Path, surface: TriSurface) -> Parcels:
    """The parcels of a label file."""
    labels = next((values for values in read_fields(file).values() if is_label(values) and values.ndim == 1), None)
    if labels is None:
        raise InputError("holds no labels", file=file, remedy="give a .label.gii or an .annot of this surface")
    if len(labels) != len(surface.points):
        raise InputError(
            f"has {len(labels):,} labels for {len(surface.points):,} vertices",
            file=file,
            remedy="give labels of the surface as it was read",
        )
    return Parcels(labels, read_label_names(file), vertex_areas(surface))


def onto_common(surface: TriSurface, sphere: Path, common: TriSurface) -> Weights:
    """Barycentric weights from the vertices of a surface to those of a common sphere, as `stages.resample` has them.

    Parameters
    ----------
    surface : as it was read
    sphere : registered sphere of this surface
    common : the sphere that it is registered to
    """
    own = read_surface(sphere)
    if not same_triangles(own, surface):
        raise InputError(
            f"the sphere has {len(own.points):,} vertices, the surface {len(surface.points):,}, or triangles differ",
            file=sphere,
            remedy="give the registered sphere of this surface",
        )
    if found := flaws(own):
        raise InputError(f"is not a sphere: {'; '.join(found)}", file=sphere, remedy="give a registered sphere")
    return barycentric(of_one_radius(own), of_one_radius(common))
