"""Triangles of a surface that pass through each other."""

from __future__ import annotations

import numpy as np

from cortet.geometry.closest_point import tree_of
from cortet.geometry.triangle_intersection import crossing
from cortet.meshes import IntArray, TriSurface


def self_intersections(surface: TriSurface) -> IntArray:
    """Triangles that meet another triangle outside a shared vertex or edge: (f,) int32, ascending.

    Touching counts, and so does a triangle folded flat onto its neighbour. Every pair whose boxes overlap is tested in
    double precision. (PyMeshLab's filter is as fast, but it reports neighbours in flat areas as crossing and misses
    overlaps within a plane.)
    """
    tree = tree_of(surface)
    flagged = crossing(surface.faces[tree.faces], tree.corners, tree.boxes, tree.child, tree.size)
    return np.sort(tree.faces[flagged])
