"""Meshes with a known fault each, and what the commands of cortet find in them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from cubes import cube_mesh

from cortet.config.fold import Settings
from cortet.errors import CortetError
from cortet.folding.run import prepared
from cortet.formats import vtu
from cortet.geometry.quadratic import quadratic
from cortet.geometry.topology import TET_FACES, boundary_surface, compact, neighbours
from cortet.measure.certify import certify
from cortet.measure.quality import oriented
from cortet.meshes import REGION, IntArray, TetMesh, TriSurface
from cortet.solver_files.export import convert
from cortet.stages.solver_ready import surface_nodes_first

SIDE = 12.0
#: commands that see no surface
BLIND = frozenset({"convert", "fold"})


@dataclass(frozen=True)
class Wrong:
    """A mesh with one fault."""

    fault: str
    mesh: TetMesh
    #: the surface that it is said to fill
    surface: TriSurface
    cell_size: float
    #: a check of the certificate that fails
    check: str = ""
    #: commands that cannot know the fault
    unseen_by: frozenset[str] = frozenset()


def sound(n: int) -> Wrong:
    """A cube of 6 n^3 tetrahedra without any fault."""
    mesh, _ = surface_nodes_first(cube_mesh(n, side=SIDE))
    return Wrong("none", mesh, boundary_surface(mesh)[0], SIDE / n)


def wrong_meshes(n: int) -> Iterator[Wrong]:
    """Every fault, in a cube of 6 n^3 tetrahedra; n even and at least 4."""
    good = sound(n)
    mesh = good.mesh
    for fault, (make, check) in FAULTS.items():
        yield replace(good, fault=fault, mesh=make(mesh), check=check)
    yield replace(good, fault="slit", mesh=with_slit(mesh, 1e-2), check="bank_gap", unseen_by=BLIND)
    # no brain is as long as the second one
    for scale, unseen_by in ((1.02, BLIND), (1000.0, BLIND - {"convert"})):
        bigger = replace(mesh, points=mesh.points * scale)
        yield replace(good, fault=f"scale {scale:g}", mesh=bigger, check="node_distance", unseen_by=unseen_by)
    points = good.surface.points
    bulging = points + 0.1 * np.sin(points[:, [1, 2, 0]])
    other = TriSurface(bulging, good.surface.faces)
    yield replace(good, fault="surface of another", surface=other, check="node_distance", unseen_by=BLIND)
    yield swapped_regions(good)


def _central(mesh: TetMesh, share: float = 0.25) -> np.ndarray:
    """Which tetrahedra are in a cube in the middle, whose sides are `share` of those of the mesh, or one cell."""
    middle = (mesh.points.max(axis=0) + mesh.points.min(axis=0)) / 2
    reach = share * np.ptp(mesh.points[:, 0]) / 2
    return (np.abs(mesh.points[mesh.cells].mean(axis=1) - middle) < max(reach, 1e-9)).all(axis=1)


def without_unused(points: np.ndarray, cells: IntArray) -> TetMesh:
    """The mesh of some tetrahedra, surface nodes first."""
    return surface_nodes_first(TetMesh(*compact(points, cells)[:2]))[0]


def with_void(mesh: TetMesh) -> TetMesh:
    """Tetrahedra in the middle are missing."""
    return without_unused(mesh.points, mesh.cells[~_central(mesh, 0.5)])


def with_hidden_void(mesh: TetMesh) -> TetMesh:
    """The same, and as many others are listed twice, all those around the void among them: volumes add up."""
    gone = _central(mesh, 0.5)
    around = np.isin(np.arange(len(gone)), neighbours(mesh)[gone]) & ~gone
    twice = np.concatenate([np.flatnonzero(around), np.flatnonzero(~around & ~gone)])[: gone.sum()]
    return TetMesh(*compact(mesh.points, np.concatenate([mesh.cells[~gone], mesh.cells[twice]]))[:2])


def with_listed_twice(mesh: TetMesh) -> TetMesh:
    """One tetrahedron stands in the list again."""
    return replace(mesh, cells=np.concatenate([mesh.cells, mesh.cells[[len(mesh.cells) // 2]]]))


def with_third_at_a_face(mesh: TetMesh) -> TetMesh:
    """A further tetrahedron stands on an inner face, its apex a node of its own."""
    cell, corner = np.argwhere(neighbours(mesh) >= 0)[len(mesh.cells)]
    face = mesh.cells[cell, TET_FACES[corner]]
    apex = mesh.points[face].mean(axis=0) + 0.3 * (mesh.points[mesh.cells[cell, corner]] - mesh.points[face].mean(0))
    new = np.array([*face[::-1], len(mesh.points)], np.int32)
    return replace(mesh, points=np.vstack([mesh.points, apex]), cells=np.vstack([mesh.cells, new]))


def with_body_inside(mesh: TetMesh) -> TetMesh:
    """A small cube of its own lies inside the large one: they overlap."""
    small = cube_mesh(2, side=SIDE / 5)
    points = np.concatenate([mesh.points, small.points + 0.41 * SIDE])
    return surface_nodes_first(TetMesh(points, np.concatenate([mesh.cells, small.cells + len(mesh.points)])))[0]


def with_hanging_node(mesh: TetMesh) -> TetMesh:
    """One tetrahedron is cut in three through the centre of a face that its neighbour has whole."""
    inside = _deep(mesh)
    cell, corner = inside[len(inside) // 2], 0
    a, b, c = mesh.cells[cell, TET_FACES[corner]]
    apex, node = mesh.cells[cell, corner], len(mesh.points)
    parts = np.array([[apex, *pair, node] for pair in ((a, b), (b, c), (c, a))], np.int32)
    points = np.vstack([mesh.points, mesh.points[[a, b, c]].mean(axis=0)])
    cells = np.concatenate([np.delete(mesh.cells, cell, axis=0), parts])
    return TetMesh(points, oriented(points, cells)[0])


def with_node_twice(mesh: TetMesh) -> TetMesh:
    """One tetrahedron names a node twice."""
    cells = mesh.cells.copy()
    cells[len(cells) // 2, 3] = cells[len(cells) // 2, 0]
    return replace(mesh, cells=cells)


def with_parted_nodes(mesh: TetMesh) -> TetMesh:
    """One half has nodes of its own along the middle plane: a slit without width from side to side."""
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > SIDE / 2
    shared = np.intersect1d(mesh.cells[right], mesh.cells[~right])
    number = np.arange(len(mesh.points), dtype=np.int32)
    number[shared] = len(mesh.points) + np.arange(len(shared))
    cells = np.where(right[:, None], number[mesh.cells], mesh.cells)
    return surface_nodes_first(TetMesh(np.concatenate([mesh.points, mesh.points[shared]]), cells))[0]


def with_unused_node(mesh: TetMesh) -> TetMesh:
    """A node belongs to no tetrahedron."""
    return replace(mesh, points=np.vstack([mesh.points, [1.0, 1.0, 1.0]]))


def with_swapped_nodes(mesh: TetMesh) -> TetMesh:
    """One tetrahedron lists its nodes the wrong way round."""
    cells = mesh.cells.copy()
    cells[len(cells) // 2] = cells[len(cells) // 2][[0, 1, 3, 2]]
    return replace(mesh, cells=cells)


def with_inverted_half(mesh: TetMesh) -> TetMesh:
    """Half of the tetrahedra list their nodes the wrong way round."""
    cells = mesh.cells.copy()
    cells[::2] = cells[::2][:, [0, 1, 3, 2]]
    return replace(mesh, cells=cells)


def with_node_through_a_face(mesh: TetMesh) -> TetMesh:
    """An inner node is on the other side of a face: tetrahedra around it are inverted."""
    points = mesh.points.copy()
    points[_inner_node(mesh)] += 1.4 * SIDE / round((len(mesh.cells) / 6) ** (1 / 3)) * np.array([1.0, 0.3, 0.2])
    return replace(mesh, points=points)


def with_flat_element(mesh: TetMesh) -> TetMesh:
    """An inner node lies in the plane of a face opposite to it."""
    node = _inner_node(mesh)
    cell = np.flatnonzero((mesh.cells == node).any(axis=1))[0]
    points = mesh.points.copy()
    points[node] = points[np.setdiff1d(mesh.cells[cell], node)].mean(axis=0)
    return replace(mesh, points=points)


def touching(mesh: TetMesh, *shift: float) -> TetMesh:
    """Two cubes, one shifted against the other, with common nodes where they touch."""
    points = np.round(np.concatenate([mesh.points, mesh.points + shift]), 9)
    points, number = np.unique(points, axis=0, return_inverse=True)
    cells = number.ravel()[np.concatenate([mesh.cells, mesh.cells + len(mesh.points)])].astype(np.int32)
    return surface_nodes_first(TetMesh(points, cells))[0]


#: fault -> what makes it, and a check of the certificate that fails; none where there is no certificate at all
FAULTS: dict[str, tuple[Callable[[TetMesh], TetMesh], str]] = {
    "void": (with_void, "voids"),
    "void, hidden by elements listed twice": (with_hidden_void, "repeated_tetrahedra"),
    "element listed twice": (with_listed_twice, "volume_balance"),
    "all elements listed twice": (lambda mesh: replace(mesh, cells=np.concatenate([mesh.cells, mesh.cells])), ""),
    "third element at a face": (with_third_at_a_face, "overfull_faces"),
    "body inside the body": (with_body_inside, "overlapping_bodies"),
    "hanging node": (with_hanging_node, "voids"),
    "node named twice": (with_node_twice, "tetrahedra_with_doubled_nodes"),
    "nodes parted along a plane": (with_parted_nodes, "coincident_nodes"),
    "unused node": (with_unused_node, "unused_nodes"),
    "nodes swapped in one element": (with_swapped_nodes, "flat_or_inverted_tetrahedra"),
    "half of the elements inverted": (with_inverted_half, "misoriented_edges"),
    "node through a face": (with_node_through_a_face, "folded_faces"),
    "flat element": (with_flat_element, "flat_or_inverted_tetrahedra"),
    "touching in an edge": (lambda mesh: touching(mesh, SIDE, SIDE, 0), "nonmanifold_edges"),
    "touching in a node": (lambda mesh: touching(mesh, SIDE, SIDE, SIDE), "pinched_vertices"),
}


def with_slit(mesh: TetMesh, width: float) -> TetMesh:
    """A face between two edges of the boundary is opened: a slit one element deep, all its nodes on the surface.

    The node between the two edges, on an edge of the cube, becomes two, `width` mm apart along that edge.
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    middle = np.unique(np.round(mesh.points[:, 0], 9))
    x = middle[len(middle) // 2]
    on_edge = np.isclose(mesh.points, [x, low[1], high[2]], atol=1e-6).all(axis=1)
    node = int(np.flatnonzero(on_edge)[0])
    around = np.flatnonzero((mesh.cells == node).any(axis=1))
    right = around[mesh.points[mesh.cells[around]].mean(axis=1)[:, 0] > x]
    # only tetrahedra that share the one face across the plane are parted
    plane = np.isclose(mesh.points[:, 0], x, atol=1e-6)
    shared = np.flatnonzero(plane[mesh.cells[around]].sum(axis=1) == 3)
    faces = {tuple(sorted(cell[plane[cell]])) for cell in mesh.cells[around[shared]]}
    assert len(faces) == 1, "the two edges of the boundary must belong to one face"
    points = np.vstack([mesh.points, mesh.points[node] + [width / 2, 0, 0]])
    points[node, 0] -= width / 2
    cells = mesh.cells.copy()
    cells[right] = np.where(cells[right] == node, len(mesh.points), cells[right])
    return surface_nodes_first(TetMesh(points, cells))[0]


def swapped_regions(good: Wrong) -> Wrong:
    """The numbers of the two regions are exchanged."""
    mesh = good.mesh
    inner = _central(mesh, 0.5)
    within = without_unused(mesh.points, mesh.cells[inner])
    surface = replace(good.surface, inner={"white": boundary_surface(within)[0]})
    labelled = replace(mesh, cell_data={REGION: 1 + (~inner).astype(np.int32)})
    unseen_by, check = BLIND | {"quadratic"}, "region_volume_change:white"
    return replace(good, fault="regions swapped", mesh=labelled, surface=surface, check=check, unseen_by=unseen_by)


def _deep(mesh: TetMesh) -> IntArray:
    """Tetrahedra none of whose nodes is on the boundary, nor those of its neighbours."""
    outer = np.zeros(len(mesh.points), bool)
    outer[boundary_surface(mesh)[1]] = True
    near = outer[mesh.cells].any(axis=1)
    behind = neighbours(mesh)
    return np.flatnonzero(~near & ~near[behind].any(axis=1) & (behind >= 0).all(axis=1))


def _inner_node(mesh: TetMesh) -> int:
    """The node next to the middle."""
    return int(np.linalg.norm(mesh.points - SIDE / 2, axis=1).argmin())


# --- what the commands find


COMMANDS = ("certify", "convert", "quadratic", "fold")


def is_seen(wrong: Wrong, command: str, folder: Path) -> bool:
    """Whether a command does not let the mesh through."""
    try:
        if command == "certify":
            certificate = certify(wrong.mesh, wrong.surface, cell_size=wrong.cell_size)
            json.dumps(asdict(certificate), allow_nan=False)  # as it is written
            return not certificate.certified
        if command == "convert":
            vtu.write(wrong.mesh, folder / "m.vtu")
            convert(folder / "m.vtu", folder / "m.inp", source_unit="mm")
        elif command == "quadratic":
            quadratic(wrong.mesh, replace(wrong.surface, inner={}))
        else:
            prepared(wrong.mesh, Settings(gestational_age=22.0, end=23.0, thickness=2.0))
    except CortetError:
        return True
    return False
