"""Cubes of tetrahedra, of any number: what benchmarks and tests measure where the shape does not matter."""

from __future__ import annotations

import numpy as np

from cortet.meshes import TetMesh

#: corners of the six tetrahedra of a cube (Kuhn 1960), corner i having the bits of i as coordinates
KUHN = np.array([[0, 1, 3, 7], [0, 5, 1, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 6, 4, 7]])


def cube_mesh(n: int = 4, side: float = 1.0, jitter: float = 0.0) -> TetMesh:
    """A cube [0, side]^3 of 6 n^3 tetrahedra; interior nodes are displaced at random by up to `jitter` spacings."""
    axis = np.arange(n + 1)
    z, y, x = (w.ravel() for w in np.meshgrid(axis, axis, axis, indexing="ij"))
    grid = np.stack([x, y, z], axis=1)
    interior = ((grid > 0) & (grid < n)).all(axis=1)
    points = grid.astype(float)
    points[interior] += np.random.default_rng(0).uniform(-jitter, jitter, (int(interior.sum()), 3))
    origin = grid[(grid < n).all(axis=1)]
    corner = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    hexahedra = (origin[:, None] + corner) @ [1, n + 1, (n + 1) ** 2]
    return TetMesh(points * side / n, hexahedra[:, KUHN].reshape(-1, 4))
