"""Directions, moduli and supports for the jobs of all solvers in which the cortex of a mesh grows along itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cortet.errors import InputError
from cortet.folding.body import Material, Scale, body_of
from cortet.formats.surface_sets import CORE, CORTEX, INTERFACE, MEDIAL_WALL
from cortet.geometry.topology import boundary_nodes
from cortet.meshes import AROUND, FloatArray, IntArray, TetMesh, is_brain
from cortet.solver_files.holes import part


class Support(NamedTuple):
    """Nodes that keep some of their coordinates."""

    name: str
    #: (k,) int32
    nodes: IntArray
    #: the coordinates that stay: 0 for x, 1 for y, 2 for z
    axes: tuple[int, ...]


def growing(mesh: TetMesh, growth: float, *, most: float) -> tuple[IntArray, FloatArray]:
    """The tetrahedra of the cortex, (k,), and the direction across it in each of them, (k, 3) unit vectors.

    Parameters
    ----------
    growth : relative growth along the cortex
    most : largest growth for which the solver's material holds

    Raises
    ------
    InputError : growth is not above 0 and at most `most`, or the mesh has no cortex
    """
    if not 0 < growth <= most:
        strains = "small strains" if most < 1 else "strains of this size"
        raise InputError(f"growth is {growth:g}, but the material holds for {strains}", remedy=f"0.01 to {most:g}")
    cortex = mesh.sets.cells.get(CORTEX, np.zeros(0, np.int32))
    if not len(cortex):
        remedy = "read one that cortet exported; of a white surface, one with export.cortex_layer: true"
        raise InputError("the mesh has no set `cortex`", remedy=remedy)
    inside = np.ones(len(mesh.cells), bool)
    for name in AROUND:
        inside[mesh.sets.cells.get(name, [])] = False
    brain = mesh if inside.all() else part(mesh, inside)
    faces = {name: some for name, some in brain.sets.faces.items() if not is_brain(name.removesuffix(INTERFACE))}
    brain = replace(brain, sets=replace(brain.sets, faces=faces))  # the surface of the brain is the boundary now
    return cortex, body_of(brain, Scale(np.zeros(3), 1.0)).normals[brain.sets.cells[CORTEX]]


class Part(NamedTuple):
    """Tetrahedra of one material."""

    #: name of the set of tetrahedra that it belongs to
    name: str
    #: (k,) int32
    cells: IntArray
    #: moduli, in units of the shear modulus of the cortex
    shear: float
    bulk: float


def parts(mesh: TetMesh, moduli: Mapping[str, tuple[float, float | None]], material: Material) -> list[Part]:
    """The materials of a mesh, each tetrahedron in one: the cortex first, then the core, then the given sets.

    Parameters
    ----------
    moduli : set of tetrahedra -> shear and bulk modulus, in units of the cortex's shear modulus; bulk None is that of
        `material`. If two sets share tetrahedra, the later set gets them, but cortex stays cortex

    Raises
    ------
    InputError : the mesh has no such set, or others take all its tetrahedra; or a region around the brain has no moduli
    """
    sets = mesh.sets.cells
    if unknown := [name for name in moduli if name not in sets]:
        raise InputError(f"the mesh has no set of tetrahedra {unknown[0]}", remedy=f"name one of {', '.join(sets)}")
    every = {CORTEX: (material.mu_cortex, None), CORE: (material.mu_core, None), **moduli}
    owner = np.full(len(mesh.cells), -1)
    for number, name in enumerate(every):
        cells = sets.get(name, np.zeros(0, np.int32))
        owner[cells if name == CORTEX else cells[owner[cells] != 0]] = number
    for name in moduli:
        number, cells = list(every).index(name), sets[name]
        if not (owner[cells] == number).any():
            others = ", ".join(list(every)[other] for other in np.unique(owner[cells]))
            raise InputError(
                f"no tetrahedron gets the material of {name}: all are in {others}, too",
                remedy="name the smaller set last; what is cortex has the material of the cortex",
            )
    if (bare := np.flatnonzero(owner < 0)).size:
        name = next((name for name in AROUND if np.isin(bare, sets.get(name, ())).any()), "no set")
        raise InputError(
            f"{len(bare)} tetrahedra have no material: they are in {name}", remedy=f"give one: --material {name}=0.01"
        )
    found = [
        Part(name, np.flatnonzero(owner == number).astype(np.int32), shear, material.bulk if bulk is None else bulk)
        for number, (name, (shear, bulk)) in enumerate(every.items())
    ]
    return [one for one in found if len(one.cells)]


def along(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors perpendicular to each of (k, 3) unit normals and to each other."""
    start = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, start)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def young_and_poisson(shear: float, bulk: float) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio."""
    return 9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)


def supports(mesh: TetMesh) -> list[Support]:
    """Supports that hold the body without pressing it.

    They fix six displacements of three nodes: one in the middle, one ahead of it and one above it. With a medial wall,
    whose nodes keep their x, the three nodes are on the wall, and only three more displacements are fixed.
    """
    wall: IntArray = mesh.sets.nodes.get(MEDIAL_WALL, np.zeros(0, np.int32))
    among = wall if len(wall) else np.setdiff1d(np.arange(len(mesh.points), dtype=np.int32), boundary_nodes(mesh))
    places = mesh.points[among]
    middle, reach = places.mean(axis=0), np.ptp(places, axis=0) / 3
    centre, ahead, above = (
        among[[np.linalg.norm(places - middle - reach * way, axis=1).argmin()]]
        for way in ([0, 0, 0], [0, 1, 0], [0, 0, 1])
    )
    if len(wall):
        return [Support(MEDIAL_WALL, wall, (0,)), Support("centre", centre, (1, 2)), Support("ahead", ahead, (2,))]
    return [Support("centre", centre, (0, 1, 2)), Support("ahead", ahead, (0, 2)), Support("above", above, (0,))]
