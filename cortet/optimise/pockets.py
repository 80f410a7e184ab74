"""Cut out the few pockets of a mesh with its worst tetrahedra, so that many attempts there cost little.

Each pocket is checked alone, and keeps its best attempt.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cortet.geometry.topology import compact, component_labels
from cortet.measure.quality import quality
from cortet.meshes import FloatArray, IntArray, TetMesh

#: layers of tetrahedra around the worst ones that belong to a pocket
_RINGS = 4
#: fields of a part: the number of each node in the whole mesh, and the number of each tetrahedron's pocket
_NODE, _POCKET = "node of the whole", "pocket"


class Part(NamedTuple):
    """Places that share no vertex, as a mesh of their own."""

    #: has every field of the whole mesh, and two that lead back to it
    mesh: TetMesh
    #: vertices that tetrahedra outside share: (k,) int32
    rim: IntArray
    #: (m,) bool, the tetrahedra of the whole mesh that were cut out
    taken: NDArray[np.bool_]


def cut_out(mesh: TetMesh, seeds: NDArray[np.bool_]) -> Part:
    """Cut out the pockets around the tetrahedra `seeds` (m,)."""
    taken: NDArray[np.bool_] = seeds
    for _ in range(_RINGS):
        near = np.zeros(len(mesh.points), np.bool_)
        near[mesh.cells[taken]] = True
        taken = np.asarray(near[mesh.cells].any(axis=1))
    points, cells, nodes = compact(mesh.points, mesh.cells[taken])
    outside = np.zeros(len(mesh.points), np.bool_)
    outside[mesh.cells[~taken]] = True
    pocket = component_labels(cells)[cells[:, 0]].astype(np.int32)
    part = TetMesh(
        points,
        cells,
        {name: values[nodes] for name, values in mesh.point_data.items()} | {_NODE: nodes},
        {name: values[taken] for name, values in mesh.cell_data.items()} | {_POCKET: pocket},
    )
    return Part(part, np.flatnonzero(outside[nodes]).astype(np.int32), taken)


def rim_of(part: Part, mesh: TetMesh) -> IntArray:
    """The vertices of the rim of a part, in the later mesh of that part: (k,) int32."""
    nodes = part.mesh.point_data[_NODE][part.rim]
    return np.flatnonzero(_is_old(mesh) & np.isin(mesh.point_data[_NODE], nodes)).astype(np.int32)


def numbers_in(part: Part, nodes: IntArray) -> IntArray:
    """The vertices of a part that are among the given `nodes` (k,) of the whole mesh: (j,) int32."""
    return np.flatnonzero(np.isin(part.mesh.point_data[_NODE], nodes)).astype(np.int32)


def nodes_near(part: Part, points: FloatArray) -> IntArray:
    """The numbers, in the whole mesh, of the vertices of a part nearest to `points` (k, 3), mm: (k,) int32."""
    nodes: IntArray = part.mesh.point_data[_NODE][KDTree(part.mesh.points).query(points)[1]]
    return nodes


def better_of_each(first: TetMesh, second: TetMesh, threshold: float) -> TetMesh:
    """For each pocket, the try with the smaller sum of fourth powers of what its tetrahedra exceed `threshold` by.

    The first if they are equal. The second try may lack pockets; there the first one stays.
    """
    count = _count(first)
    return mixed(first, second, _excess(second, count, threshold) < _excess(first, count, threshold))


def mixed(first: TetMesh, second: TetMesh, chosen: NDArray[np.bool_]) -> TetMesh:
    """The second try in the `chosen` pockets, (pockets,) or more, and the first try in the others."""
    if not chosen.any():
        return first
    kept = [~chosen[first.cell_data[_POCKET]], chosen[second.cell_data[_POCKET]]]
    cells = np.concatenate([first.cells[kept[0]], second.cells[kept[1]] + np.int32(len(first.points))])
    points, cells, used = compact(np.concatenate([first.points, second.points]), cells)
    return TetMesh(
        points,
        cells,
        {name: _joined(values, second.point_data[name])[used] for name, values in first.point_data.items()},
        {name: _joined(values[kept[0]], second.cell_data[name][kept[1]]) for name, values in first.cell_data.items()},
    )


def promising(mesh: TetMesh, threshold: float, most: int) -> TetMesh:
    """The pockets of a try that have at least one and at most `most` tetrahedra with q above `threshold`."""
    count = bad_in_each(mesh, threshold)
    return only(mesh, (count > 0) & (count <= most))


def bad_in_each(mesh: TetMesh, threshold: float) -> IntArray:
    """How many tetrahedra of each pocket have q above `threshold`: (pockets,)."""
    bad = quality(mesh.points, mesh.cells) > threshold
    return np.bincount(mesh.cell_data[_POCKET][bad], minlength=_count(mesh)).astype(np.int32)


def only(mesh: TetMesh, chosen: NDArray[np.bool_]) -> TetMesh:
    """The `chosen` pockets of a part, (pockets,) or more."""
    taken = chosen[mesh.cell_data[_POCKET]]
    if taken.all():
        return mesh
    points, cells, used = compact(mesh.points, mesh.cells[taken])
    return TetMesh(
        points,
        cells,
        {name: values[used] for name, values in mesh.point_data.items()},
        {name: values[taken] for name, values in mesh.cell_data.items()},
    )


def pockets_at(mesh: TetMesh, points: FloatArray) -> NDArray[np.bool_]:
    """Which pockets of a part own the vertices nearest to `points` (k, 3), mm: (pockets,)."""
    pocket = np.empty(len(mesh.points), np.int32)
    pocket[mesh.cells] = mesh.cell_data[_POCKET][:, None]
    chosen = np.zeros(_count(mesh), np.bool_)
    chosen[pocket[KDTree(mesh.points).query(points)[1]]] = True
    return chosen


def put_back(mesh: TetMesh, part: Part, improved: TetMesh) -> TetMesh:
    """The whole mesh with a part replaced by the `improved` one; new vertices come last."""
    old = _is_old(improved)
    node = improved.point_data[_NODE].copy()
    node[~old] = len(mesh.points) + np.arange(np.count_nonzero(~old))
    moved = mesh.points.copy()
    moved[node[old]] = improved.points[old]
    cells = np.concatenate([mesh.cells[~part.taken], node[improved.cells]])
    points, cells, used = compact(np.concatenate([moved, improved.points[~old]]), cells)
    return replace(
        mesh,
        points=points,
        cells=cells,
        point_data={
            name: _joined(values, improved.point_data[name][~old])[used] for name, values in mesh.point_data.items()
        },
        cell_data={
            name: _joined(values[~part.taken], improved.cell_data[name]) for name, values in mesh.cell_data.items()
        },
    )


def _is_old(mesh: TetMesh) -> NDArray[np.bool_]:
    """Whether each vertex of a part belongs to the whole mesh; inserted vertices repeat the number of an old one."""
    old = np.zeros(len(mesh.points), np.bool_)
    old[np.unique(mesh.point_data[_NODE], return_index=True)[1]] = True
    return old


def _count(mesh: TetMesh) -> int:
    """How many pockets a part has, or had before some were left out."""
    return int(mesh.cell_data[_POCKET].max(initial=-1)) + 1


def _excess(mesh: TetMesh, count: int, threshold: float) -> FloatArray:
    """Sum over each of `count` pockets of the fourth power of what q exceeds `threshold` by; infinite if it lacks one.

    The power makes the worst tetrahedron count most, without many new ones just below it.
    """
    pocket, q = mesh.cell_data[_POCKET], quality(mesh.points, mesh.cells)
    total = np.bincount(pocket, np.maximum(q - threshold, 0) ** 4, minlength=count)
    return np.where(np.bincount(pocket, minlength=count) == 0, np.inf, total)


def _joined(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([first, second])
