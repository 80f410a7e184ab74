"""The cortex below the vertices of a native surface: points and values at depths of its columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cortet.errors import InputError
from cortet.geometry.containing import containing
from cortet.measure.layers import Cortex, bounds_of, cortical_columns
from cortet.meshes import FloatArray
from cortet.solver_files.surface_map import Located, SurfaceMap, ToSurface

#: where a range of depths is sampled: the middles of ten equal parts
_SAMPLES = (np.arange(10) + 0.5) / 10


class Laminar:
    """The columns below the vertices of a native surface.

    A vertex has a column if the nodes have one between which it lies.

    Parameters
    ----------
    found : map of the mesh
    inner : names of the regions of the mesh from 2 on
    equivolumetric : whether depths are shares of the volume of a column, or of its length

    Raises
    ------
    InputError : there is no inner surface `white`
    """

    def __init__(self, found: SurfaceMap, inner: Iterable[str], *, equivolumetric: bool = True) -> None:
        self._map, self._equivolumetric = found, equivolumetric
        self._cortex: Cortex = cortical_columns(found.mesh, inner)
        if not self._cortex.known.any():
            raise InputError("no column leads through the cortex", remedy="mesh with smaller cells")
        number = np.full(len(found.mesh.points), -1)
        number[self._cortex.nodes[self._cortex.known]] = np.flatnonzero(self._cortex.known)
        weights = found.to_surface
        whole = np.ones(len(found.points), bool)
        rows = np.repeat(np.arange(len(found.points)), np.diff(weights.indptr))
        whole[rows[number[weights.indices] < 0]] = False
        kept = whole[rows]
        self._vertices, self._weights = rows[kept], weights.data[kept]
        self._nodes, self._column = np.unique(number[weights.indices[kept]], return_inverse=True)

    def points(self, depth: float) -> FloatArray:
        """Where the columns are at a depth, 0 at the pial and 1 at the white surface: (v, 3) mm, NaN without one."""
        at = self._along(depth)[self._column] * self._weights[:, None]
        found = np.full((len(self._map.points), 3), np.nan)
        found[self._vertices] = 0.0
        np.add.at(found, self._vertices, at)
        return found

    def weights(self, first: float, last: float | None = None) -> ToSurface:
        """What brings values of the mesh from a depth to the vertices, or means over a range of depths."""
        depths = [first] if last is None or last == first else first + (last - first) * _SAMPLES
        every = [self._located(depth) for depth in depths]
        return ToSurface(self._map, Located(*(np.concatenate(some) for some in zip(*every, strict=True))))

    def layer(self, number: int, layers: Sequence[float]) -> ToSurface:
        """What brings means over a layer to the vertices.

        Parameters
        ----------
        number : of the layer, 1 for the outermost
        layers : as `measure.layers.bounds_of`
        """
        ends = [0.0, *bounds_of(layers).tolist(), 1.0]
        if not 0 < number < len(ends):
            raise InputError(f"there is no layer {number}", remedy=f"name one of 1 to {len(ends) - 1}")
        return self.weights(ends[number - 1], ends[number])

    def _along(self, depth: float) -> FloatArray:
        if not 0 <= depth <= 1:
            raise InputError(f"{depth:g} is not a depth in the cortex", remedy="give one from 0, pial, to 1, white")
        nodes = self._nodes.astype(np.int32)
        return self._cortex.columns.at(nodes, depth, equivolumetric=self._equivolumetric)

    def _located(self, depth: float) -> Located:
        """The point of each column, in a tetrahedron of the cortex, with the share that its vertex has in it."""
        wall = self._cortex.columns.wall
        cells, own = containing(wall, self._along(depth))
        cells, own = cells[self._column], own[self._column] * self._weights[:, None]
        held = cells >= 0
        return Located(
            self._vertices[held], np.flatnonzero(self._cortex.cells)[cells[held]].astype(np.int32), own[held]
        )
