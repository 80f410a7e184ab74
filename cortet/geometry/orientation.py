"""Which way the triangles of a surface face; random directions."""

from __future__ import annotations

import numpy as np

from cortet.geometry.topology import TRI_EDGES, enclosed_volume, linked, packed
from cortet.meshes import FloatArray, IntArray


def outward(points: FloatArray, faces: IntArray) -> IntArray:
    """Turn triangles so that neighbours agree and the enclosed volume is positive; (m, 3) int32.

    Every triangle gives two nodes of a graph: as it is, and turned. An edge of two triangles links the states that run
    through it in opposite directions. A connected surface then gives two components, one the reverse of the other. A
    surface that cannot be oriented gives only one, and keeps edges at which its triangles disagree.
    """
    directed = faces[:, TRI_EDGES].reshape(-1, 2)
    order = np.argsort(packed(directed), kind="stable")
    undirected = np.sort(directed[order], axis=1)
    here = np.flatnonzero((undirected[1:] == undirected[:-1]).all(axis=1))
    first, second = order[here], order[here + 1]
    agree = directed[first, 0] != directed[second, 0]
    first, second, count = first // 3, second // 3, len(faces)
    links = (np.r_[first, first + count], np.r_[np.where(agree, second, second + count), second + count * agree])
    label = linked(*links, 2 * count)
    turned = label[:count] > label[count:]
    result = np.where(turned[:, None], faces[:, ::-1], faces)
    inside_out = enclosed_volume(points, result) < 0
    return np.ascontiguousarray(result[:, ::-1] if inside_out else result)


def random_rotation(seed: int) -> FloatArray:
    """A uniformly distributed random rotation (3, 3) (Mezzadri, Notices of the AMS 54, 2007)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)
