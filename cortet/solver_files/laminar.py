"""The cortex below the vertices of a native surface: points and values at depths of its columns."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cortet.errors import InputError
from cortet.geometry.containing import containing
from cortet.measure.layers import cortical_columns
from cortet.meshes import FloatArray
from cortet.solver_files.surface_map import SAMPLES, Located, SurfaceMap, ToSurface


class Laminar:
    """The columns below the vertices of a native surface.

    A vertex has a column if the nodes have one between which it lies.

    Parameters
    ----------
    found : map of the mesh
    inner : names of the regions of the mesh from 2 on
    equivolumetric : whether depths are shares of the volume of a column, or of its length
    """

    def __init__(self, found: SurfaceMap, inner: Iterable[str], *, equivolumetric: bool = True) -> None:
        self._map, self._equivolumetric = found, equivolumetric
        self._cortex = cortical_columns(found.mesh, inner)
        if not self._cortex.known.any():
            raise InputError("no column crosses the cortex", remedy="mesh with smaller cells")
        number = np.full(len(found.mesh.points), -1, np.int32)
        number[self._cortex.nodes[self._cortex.known]] = np.flatnonzero(self._cortex.known)
        mixed = found.to_surface.tocoo()
        known = np.bincount(mixed.row, number[mixed.col] < 0, minlength=len(found.points)) == 0
        kept = known[mixed.row]
        self._vertices, self._weights = mixed.row[kept], mixed.data[kept]
        self._nodes, self._column = np.unique(number[mixed.col[kept]], return_inverse=True)

    def points(self, depth: float) -> FloatArray:
        """Where the columns are at a depth, 0 at the pial and 1 at the white surface: (v, 3) mm, NaN without one."""
        found = np.full((len(self._map.points), 3), np.nan)
        found[self._vertices] = 0.0
        np.add.at(found, self._vertices, self._along(depth)[self._column] * self._weights[:, None])
        return found

    def weights(self, first: float, last: float | None = None) -> ToSurface:
        """What brings values of the mesh from a depth to the vertices, or means over a range of depths."""
        depths = [first] if last is None or last == first else first + (last - first) * SAMPLES
        every = [self._located(depth) for depth in depths]
        return ToSurface(self._map, Located(*(np.concatenate(some) for some in zip(*every, strict=True))))

    def _along(self, depth: float) -> FloatArray:
        if not 0 <= depth <= 1:
            raise InputError(f"{depth:g} is not a depth in the cortex", remedy="give a depth from 0, pial, to 1, white")
        return self._cortex.columns.at(self._nodes, depth, equivolumetric=self._equivolumetric)

    def _located(self, depth: float) -> Located:
        """The point of each column, in a tetrahedron of the cortex, with the share that its vertex has in it."""
        cells, own = containing(self._cortex.columns.wall, self._along(depth))
        cells, own = cells[self._column], own[self._column] * self._weights[:, None]
        held = cells >= 0
        in_mesh = np.flatnonzero(self._cortex.cells).astype(np.int32)
        return Located(self._vertices[held], in_mesh[cells[held]], own[held])
