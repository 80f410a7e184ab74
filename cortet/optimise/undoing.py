"""Undo the changes of a mesh around some of its vertices, and nowhere else.

Positions are undone vertex by vertex, connectivity in clusters. The tetrahedra that only one of the two meshes has form
clusters that share faces; within each cluster, both meshes fill the same space. If that leaves a bad tetrahedron
between undone and kept changes, more is undone. The process ends, at worst with everything undone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.topology import TET_FACES, linked, packed
from cortet.measure.quality import quality
from cortet.meshes import IntArray, TetMesh

#: if q of a tetrahedron with some vertices undone exceeds this, the others follow, unless it was as bad before or after
_WORST = 0.5


class _Changes(NamedTuple):
    """The tetrahedra that only one of two meshes has, and the cluster of each."""

    old: NDArray[np.int64]
    new: NDArray[np.int64]
    cluster_of_old: NDArray[np.int32]
    cluster_of_new: NDArray[np.int32]


def undone(before: TetMesh, after: TetMesh, vertices: NDArray[np.integer]) -> tuple[TetMesh, NDArray[np.bool_]]:
    """The mesh `after` with some `vertices` (k,), and the tetrahedra around them, as they were `before`.

    Both meshes have the same vertices. Also returns which tetrahedra have a vertex that was undone: (m,) bool.
    """
    back = np.zeros(len(before.points), np.bool_)
    back[vertices] = True
    changes = _changes(before.cells, after.cells)
    while True:
        kept, returned = _chosen(before, after, changes, back)
        cells = after.cells if not len(changes.old) else np.concatenate([after.cells[kept], before.cells[returned]])
        points = np.where(back[:, None], before.points, after.points)
        touched = back[cells]
        near = touched.any(axis=1)
        near[len(cells) - len(returned) :] = True
        near &= ~touched.all(axis=1)
        mixed = cells[near]
        worst = np.full(len(mixed), _WORST)
        for mesh in (before, after):
            q = quality(mesh.points, mixed)
            worst = np.maximum(worst, np.where(q < 1, q, 0))
        bad = quality(points, mixed) > worst
        if not bad.any():
            break
        back[mixed[bad]] = True
    if not len(changes.old):
        return replace(after, points=points), touched.any(axis=1)

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([after.cell_data[name][kept], before.cell_data[name][returned]])

    mesh = replace(after, points=points, cells=cells, cell_data={name: joined(name) for name in after.cell_data})
    return mesh, touched.any(axis=1)


def _chosen(
    before: TetMesh, after: TetMesh, changes: _Changes, back: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which tetrahedra of the mesh `after` stay, (m,) bool, and the numbers of those of `before` that return."""
    undo = np.zeros(1 + max(changes.cluster_of_old.max(initial=-1), changes.cluster_of_new.max(initial=-1)), np.bool_)
    undo[changes.cluster_of_old[back[before.cells[changes.old]].any(axis=1)]] = True
    undo[changes.cluster_of_new[back[after.cells[changes.new]].any(axis=1)]] = True
    kept = np.ones(len(after.cells), np.bool_)
    kept[changes.new[undo[changes.cluster_of_new]]] = False
    return kept, changes.old[undo[changes.cluster_of_old]]


def _changes(before: IntArray, after: IntArray) -> _Changes:
    """The differences between two sets of tetrahedra on the same vertices."""
    if np.array_equal(before, after):  # where only vertices moved
        rows, clusters = np.zeros(0, np.int64), np.zeros(0, np.int32)
        return _Changes(rows, rows, clusters, clusters)
    corners = np.sort(np.concatenate([before, after]), axis=1).astype(np.int64)
    count = int(corners.max(initial=0)) + 1
    first, second = corners[:, 0] * count + corners[:, 1], corners[:, 2] * count + corners[:, 3]
    order = np.lexsort((second, first))
    twin = (np.diff(first[order]) == 0) & (np.diff(second[order]) == 0)
    alone = np.ones(len(order), np.bool_)
    alone[order[:-1][twin]] = alone[order[1:][twin]] = False
    old, new = np.flatnonzero(alone[: len(before)]), np.flatnonzero(alone[len(before) :])
    cells = np.concatenate([before[old], after[new]])
    face = packed(cells[:, TET_FACES].reshape(-1, 3))
    order = np.argsort(face, kind="stable")
    same = np.diff(face[order]) == 0
    links = order[:-1][same] // 4, order[1:][same] // 4
    cluster = linked(*links, len(cells)) if len(cells) else np.zeros(0, np.int32)
    return _Changes(old, new, cluster[: len(old)], cluster[len(old) :])
