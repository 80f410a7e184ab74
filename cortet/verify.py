"""Check a written solver file against the conventions of its solver, from the bytes on disk and nothing else."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.braingrowth import read_tables
from cortet.mesh import IntArray, TetMesh
from cortet.quality import signed_volumes
from cortet.topology import boundary_faces


def braingrowth(path: str | Path) -> list[str]:
    """Name every convention of the BrainGrowth solver that the file breaks; an empty list means it may be run.

    The five: tetrahedron lines have 5 fields; volumes are negative; the surface nodes are the first N; the triangles
    are exactly the boundary faces; they face outward (all in the coordinates of the file).
    """
    try:
        points, tetrahedra, triangles = read_tables(path)
    except InputError as error:
        return [error.what]
    for kind, rows in [("tetrahedra", tetrahedra), ("triangles", triangles)]:
        if len(rows) == 0:
            return [f"there are no {kind}"]
        if rows[:, 1:].min() < 1 or rows[:, 1:].max() > len(points):
            return [f"{kind} name nodes outside 1..{len(points)}"]
    cells, faces = ((rows[:, 1:] - 1).astype(np.int32) for rows in (tetrahedra, triangles))

    problems = []
    volumes = signed_volumes(points, cells)
    wrong = np.flatnonzero(~(volumes < 0))
    if len(wrong):
        line = len(points) + 3 + wrong[0]
        problems.append(f"{len(wrong)} of {len(cells)} tetrahedra have no negative volume, the first on line {line}")
    surface_nodes = np.unique(faces)
    if surface_nodes[-1] != len(surface_nodes) - 1:
        last = surface_nodes[-1] + 1
        problems.append(f"the {len(surface_nodes)} surface nodes are not the first nodes: they reach up to node {last}")

    # outward is a matter of coordinates, whichever way round a tetrahedron is listed
    positive = np.where(volumes[:, None] < 0, cells[:, [0, 1, 3, 2]], cells)
    boundary = boundary_faces(TetMesh(points, positive))
    same_nodes = np.unique(np.sort(np.concatenate([boundary, faces]), axis=1), axis=0, return_inverse=True)[1].ravel()
    true, listed = same_nodes[: len(boundary)], same_nodes[len(boundary) :]
    first_line = len(points) + len(cells) + 4
    if repeated := len(listed) - len(np.unique(listed)):
        problems.append(f"{repeated} triangles are listed more than once")
    if missing := len(np.setdiff1d(true, listed)):
        problems.append(f"{missing} boundary faces are missing from the triangles")
    known = np.isin(listed, true)
    if not known.all():
        line = first_line + int(np.argmin(known))
        problems.append(f"{np.count_nonzero(~known)} triangles are no boundary face, the first on line {line}")
    order = np.argsort(true)
    partners = boundary[order[np.searchsorted(true, listed[known], sorter=order)]]
    inward = np.flatnonzero(known)[~_same_turn(faces[known], partners)]
    if len(inward):
        problems.append(f"{len(inward)} triangles face inward, the first on line {first_line + inward[0]}")
    return problems


def _same_turn(first: IntArray, second: IntArray) -> NDArray[np.bool_]:
    """Whether triangles of the same three nodes run through them in the same direction."""
    turned = (np.roll(second, shift, axis=1) for shift in range(3))
    return functools.reduce(np.logical_or, ((first == other).all(axis=1) for other in turned))
