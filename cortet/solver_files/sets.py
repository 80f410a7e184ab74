"""Named sets of a mesh on its way to a solver: the parts of its surface, its regions, one set per label.

Regions come first among the sets of tetrahedra, in the order of their numbers (`formats.tags`). The surface of the
brain is divided into `cortical_surface` and `medial_wall`, its tetrahedra into `cortex` and `core`. It is the boundary
of the mesh, or an interface if there is a region around the brain. A label of the surface becomes a set of surface
nodes, a set of faces and a set of cortical tetrahedra, all of the same name. A face or tetrahedron gets the label of
most of its nodes, or that of its first node if there is no majority.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, counted
from cortet.formats.surface_sets import CORE, CORTEX, CORTICAL_SURFACE, INTERFACE, MEDIAL_WALL, OUTER_SURFACE
from cortet.formats.tags import TOO_LARGE, region_numbers
from cortet.formats.tags import regions as regions_of
from cortet.geometry.closest_point import closer_than, closest_points, surface_tree
from cortet.geometry.topology import boundary_faces, interfaces
from cortet.measure.electrodes import ELECTRODE
from cortet.measure.layers import NUMBER, bounds_of, cortex_and_white, cortical_layers
from cortet.meshes import AROUND, BRAIN, REGION, IntArray, MeshSets, TetMesh, is_brain, region_names

#: names of the sets of layers begin so
LAYER = "layer_"
#: some solvers refuse longer names
_LONGEST_NAME = 80
#: ends of files in which sets and numbers of regions are arrays of their own; in others the sets follow from numbers
OF_ARRAYS = (".vtu", ".vtk")


def named_sets(
    mesh: TetMesh,
    *,
    cortex_depth: float = 1.5,
    cortex_layer: bool = True,
    cortex_thickness: str | None = None,
    medial_wall: Mapping[str, Collection[int]] | None = None,
    label_names: Mapping[str, Mapping[int, str]] | None = None,
    inner: Sequence[str] = (),
    tissues: Collection[str] = (),
    tags: str | None = None,
    layers: Sequence[float] | None = None,
) -> TetMesh:
    """The mesh with its sets, which replace those that it had but for sets of contacts of electrodes.

    Parameters
    ----------
    mesh : its labels are the integer fields of its nodes
    cortex_depth : mm; a tetrahedron whose centroid is nearer to the cortical surface than this is cortex
    cortex_layer : false: no tetrahedron is cortex by its distance, as inside a white surface
    cortex_thickness : field of nodes, mm, whose value at the nearest point of the cortical surface replaces
        `cortex_depth`
    medial_wall : label field -> keys that mark the medial wall
    label_names : label field -> key -> name, if there are names
    tissues : integer fields of tetrahedra; each label is a set `FIELD_NAME`, or `FIELD_KEY` where it has no name
    tags : the field whose labels take the place of the regions (`tagged`)
    layers : of the cortex, as `measure.layers.bounds_of` takes them; the mesh then gets their fields, too
    inner : names of the regions of the mesh from 2 on, if it has any. Each region is a set, and so are the faces
        between two. Region 1 is then the cortex, whatever its depth, and the others together are the core. If the
        brain is among them (`meshes.region_names`), region 1 lies around it, neither cortex nor core, and the boundary
        is the set of faces `outer_surface`. Without inner surfaces the cortex is region 1 and the core region 2, unless
        the mesh has numbers of regions already
    """
    number = mesh.cell_data.get(REGION) if inner else None
    names_of = region_names(inner)
    brain = [i for i, name in enumerate(names_of, start=1) if is_brain(name)]
    whole = number is None or names_of[0] == CORTEX  # nothing lies around the brain
    faces = boundary_faces(mesh) if whole else _outer_faces(mesh, brain)
    labels = {name: values for name, values in mesh.point_data.items() if _is_label(values)}
    wall = np.zeros(len(faces), bool)
    for name, keys in (medial_wall or {}).items():
        if name not in labels:
            raise InputError(f"medial wall: the mesh has no label field {name}", remedy=_known(labels))
        wall |= np.isin(face_labels(labels[name], faces), list(keys))
    if wall.all():
        raise InputError("the medial wall covers the entire surface", remedy="name only the keys of the medial wall")
    outer = (
        {CORTICAL_SURFACE: faces[~wall], MEDIAL_WALL: faces[wall]} if whole else {OUTER_SURFACE: boundary_faces(mesh)}
    )
    parts = {name: part for name, part in outer.items() if len(part)}
    sets = MeshSets({name: np.unique(part) for name, part in parts.items()}, parts, {})
    parcels = {
        name: _add_labels(sets, name, values, faces, (label_names or {}).get(name, {}))
        for name, values in labels.items()
    }
    around = np.zeros(len(mesh.cells), bool)
    if number is not None:
        around = np.isin(number, [i for i, name in enumerate(names_of, start=1) if name in AROUND])
        _add_interfaces(sets, mesh, inner)
    if number is None or BRAIN in names_of:
        cortex = ~around & cortex_layer
        if cortex_layer:
            cortex &= _is_cortex(mesh, faces[~wall], cortex_depth, cortex_thickness)
    else:
        cortex = np.isin(number, brain)
    numbered = {set_name(name): one for one, name in enumerate(names_of, start=1)}
    if number is None and REGION in mesh.cell_data:
        numbered = regions_of(mesh)
    if numbered.keys() <= {CORTEX, CORE}:  # by their depth
        numbered = {CORTEX: 1, CORE: 2} if cortex.any() else {CORE: 1}
        number = np.where(cortex, 1, numbered[CORE]).astype(np.int32)
        mesh = replace(mesh, cell_data={**mesh.cell_data, REGION: number})
    of_cell = region_numbers(mesh)
    cells, core = (np.flatnonzero(some).astype(np.int32) for some in (cortex, ~cortex & ~around))
    regions = {name: np.flatnonzero(of_cell == one).astype(np.int32) for name, one in numbered.items()}
    regions |= {CORTEX: cells, CORE: core}
    for field, sets_of in parcels.items():
        of_cells = cell_labels(labels[field], mesh.cells[cells])
        regions |= {name: cells[of_cells == key] for key, name in sets_of.items()}
    for field in tissues:
        names = (label_names or {}).get(field, {})
        for key in np.unique(mesh.cell_data[field]).tolist():
            same = np.flatnonzero(mesh.cell_data[field] == key).astype(np.int32)
            regions[_label_name(field, key, names, regions)] = same
    if layers is not None and cortex_and_white(mesh, inner) is not None:
        mesh, of_layers = with_layers(mesh, inner, layers)
        _require_free(regions, of_layers, "set")
        regions |= of_layers
    filled = {name: members for name, members in regions.items() if len(members)}
    of_contacts = _of_contacts(mesh.sets)
    all_faces, all_cells = sets.faces | of_contacts.faces, filled | of_contacts.cells
    named = replace(mesh, sets=MeshSets(sets.nodes, all_faces, all_cells))
    return tagged(named, tags) if tags else named


def with_layers(mesh: TetMesh, inner: Sequence[str], layers: Sequence[float]) -> tuple[TetMesh, dict[str, IntArray]]:
    """A mesh with the fields of its layers, and the tetrahedra of each layer by the name of its set."""
    bounds = bounds_of(layers)
    found = cortical_layers(mesh, inner, bounds)
    sets = {
        f"{LAYER}{number}": np.flatnonzero(found.number == number).astype(np.int32) for number in range(1, len(bounds))
    }
    _require_free({**mesh.point_data, **mesh.cell_data}, [*found.of_cells, NUMBER], "field")
    of_nodes = {**mesh.point_data, **found.of_nodes}
    of_cells = {**mesh.cell_data, **found.of_cells, NUMBER: found.number}
    return replace(mesh, point_data=of_nodes, cell_data=of_cells), sets


def _require_free(names: Collection[str], layers: Collection[str], what: str) -> None:
    """Raise InputError if the layers would replace a field or set of the mesh."""
    if taken := sorted({*names} & {*layers}):
        said = f"the mesh already has a {what} {taken[0]}, which layers would replace"
        raise InputError(said, remedy=f"give the {what} another name, or omit the layers")


def tagged(mesh: TetMesh, field: str) -> TetMesh:
    """The mesh with the labels of a field of tetrahedra in place of its regions, which remain as sets.

    A label below 1, which several formats take for none, gets the number after the largest.
    """
    values = mesh.cell_data.get(field)
    whole = values is not None and values.ndim == 1 and bool((values == np.round(values)).all())
    if values is None or not whole or not 0 <= values.min() <= values.max() < TOO_LARGE - 1:
        known = [name for name, some in mesh.cell_data.items() if _is_label(some)]
        what = f"the mesh has no field {field} of labels from 0 to {TOO_LARGE - 2} at the tetrahedra"
        raise InputError(what, remedy=_known(known))
    number = values.astype(np.int32)  # of bytes, none comes after 255
    number[number == 0] = number.max() + 1
    sets = {name: cells for name, cells in mesh.sets.cells.items() if name.startswith(f"{field}_")}
    for one, key in zip(*np.unique((number, values), axis=1).astype(int).tolist(), strict=True):
        cells = np.flatnonzero(number == one).astype(np.int32)
        if not any(np.array_equal(cells, named) for named in sets.values()):
            sets[set_name(f"{field}_{key}", mesh.sets.cells)] = cells
    region = {**mesh.cell_data, REGION: number}
    return replace(mesh, cell_data=region, sets=replace(mesh.sets, cells={**sets, **mesh.sets.cells}))


def with_regions(mesh: TetMesh, inner: Sequence[str]) -> TetMesh:
    """The mesh with the numbers of its regions as cell data; files hold them as the sets of `named_sets`.

    Parameters
    ----------
    inner : names of the regions from 2 on
    """
    if REGION in mesh.cell_data and not mesh.sets.cells:
        return mesh
    region, sets = np.zeros(len(mesh.cells), np.int32), mesh.sets.cells
    names = _sets_of_regions(inner, sets)
    for number, name in enumerate(names, start=1):
        region[sets.get(name, [])] = number
    missing = [name for name in names if name not in sets]
    if missing or not region.all():
        what = (
            f"there is no set {missing[0]}"
            if missing
            else (
                f"{counted(np.count_nonzero(region == 0), 'tetrahedron is', 'tetrahedra are')} not in any of "
                f"the sets {', '.join(names)}"
            )
        )
        raise InputError(
            f"cannot tell the regions of the mesh: {what} (its sets: {', '.join(sets) or 'none'})",
            remedy="give a mesh that was made with these inner surfaces",
        )
    return replace(mesh, cell_data={**mesh.cell_data, REGION: region})


def _sets_of_regions(inner: Sequence[str], sets: Collection[str]) -> list[str]:
    """The names of the sets of the regions, in the order of their numbers."""
    names = [*map(set_name, region_names(inner))]
    if len(names) == 2 and names[0] == CORTEX and names[1] not in sets:
        names[1] = CORE  # a single inner region is the core, whatever its surface is called now
    return names


def require_same_regions(mesh: TetMesh, inner: Sequence[str], file: Path | None = None) -> None:
    """Raise InputError if a tetrahedron is in several sets of regions, or its number `region` is not that of its set.

    Numbers that are labels have a set each besides those of the regions, and are not compared (`tagged`).

    Parameters
    ----------
    inner : names of the regions from 2 on; empty: the regions are cortex and core
    file : of the mesh, for messages
    """
    sets = mesh.sets.cells
    names = _sets_of_regions(inner, sets) if inner else [name for name in (CORTEX, CORE) if name in sets]
    if not names or not sets.keys() >= {*names}:
        return  # there is nothing to compare, or `with_regions` says which set is missing
    numbered = {name: number for number, name in enumerate(names, start=1)}
    region, several = np.zeros(len(mesh.cells), np.int32), np.zeros(len(mesh.cells), np.int32)
    for name, number in numbered.items():
        region[sets[name]] = number
        several[sets[name]] += 1
    if len(twice := np.flatnonzero(several > 1)):
        what = (
            f"{counted(len(twice), 'tetrahedron is', 'tetrahedra are')} in several of the sets "
            f"{', '.join(numbered)}, the first is number {twice[0]}"
        )
        raise InputError(what, file=file, remedy="take each out of all sets but one")
    given = mesh.cell_data.get(REGION)
    if given is None or given.shape != region.shape or _are_labels(given, sets, numbered):
        return
    if len(wrong := np.flatnonzero(given != region)):
        first = wrong[0]
        own = names[region[first] - 1] if region[first] else "none of them"
        raise InputError(
            f"the array {REGION} and the sets {', '.join(numbered)} disagree on "
            f"{counted(len(wrong), 'tetrahedron', 'tetrahedra')}, the first is "
            f"number {first}: its {REGION} is {given[first]}, its set is {own}",
            file=file,
            remedy=f"number the sets {', '.join(f'{name} {number}' for name, number in numbered.items())}, or delete "
            "the array or the sets, whichever is wrong",
        )


def _are_labels(given: NDArray[Any], sets: Mapping[str, IntArray], regions: Collection[str]) -> bool:
    """Whether each number has a set of exactly its tetrahedra besides the sets of regions."""
    others = {cells.tobytes() for name, cells in sets.items() if name not in (*regions, CORTEX, CORE)}
    return all(np.flatnonzero(given == number).astype(np.int32).tobytes() in others for number in np.unique(given))


def _of_contacts(sets: MeshSets) -> MeshSets:
    """Those of some sets that belong to contacts of electrodes."""
    kinds = (sets.nodes, sets.faces, sets.cells)
    return MeshSets(*({name: one for name, one in kind.items() if name.startswith(ELECTRODE)} for kind in kinds))


def _outer_faces(mesh: TetMesh, brain: Sequence[int]) -> IntArray:
    """The faces between the brain, given by the numbers of its outermost regions, and what lies around it."""
    found = interfaces(mesh)
    return found.faces[np.isin(found.region, brain)]


def _add_interfaces(sets: MeshSets, mesh: TetMesh, inner: Sequence[str]) -> None:
    """Add a set of nodes and a set of faces for the outside of each region but the first, seen from outside it."""
    found = interfaces(mesh)
    for number in np.unique(found.region).tolist():
        name = set_name(f"{inner[number - 2]}{INTERFACE}", [*sets.nodes, *sets.faces])
        sets.faces[name] = found.faces[found.region == number]
        sets.nodes[name] = np.unique(sets.faces[name])


def face_labels(values: NDArray[np.integer], faces: IntArray) -> NDArray[np.integer]:
    """Label of each face, (k,): that of two of its nodes, or of its first node if all three differ."""
    first, second, third = (values[faces[:, corner]] for corner in range(3))
    return np.where(second == third, second, first)


def cell_labels(values: NDArray[np.integer], cells: IntArray) -> NDArray[np.integer]:
    """Label of each tetrahedron, (k,): that of most of its nodes, the first such if two labels have two nodes each."""
    of_nodes = values[cells]
    votes = (of_nodes[:, :, None] == of_nodes[:, None, :]).sum(axis=2)
    return np.take_along_axis(of_nodes, votes.argmax(axis=1)[:, None], axis=1)[:, 0]


def set_name(text: str, taken: Collection[str] = ()) -> str:
    """A name that every solver accepts, made from any text: letters without accents, digits, - and _, a letter first.

    Parameters
    ----------
    taken : names from which it must differ in more than case, which some solvers ignore
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", plain).strip("_")
    if not name[:1].isalpha():
        name = f"set_{name}"
    name = name[:_LONGEST_NAME]
    folded = {other.lower() for other in taken}
    number, candidate = 2, name
    while candidate.lower() in folded:
        candidate = f"{name[: _LONGEST_NAME - 4]}_{number}"
        number += 1
    return candidate


def _add_labels(
    sets: MeshSets, field: str, values: NDArray[np.integer], faces: IntArray, names: Mapping[int, str]
) -> dict[int, str]:
    """Add a set of nodes and one of faces for each label on the surface; label -> name of its sets."""
    of_face = face_labels(values, faces)
    nodes = np.unique(faces)
    found = {}
    for key in np.unique(values[nodes]).tolist():
        name = _label_name(field, key, names, [*sets.nodes, *sets.faces])
        sets.nodes[name] = nodes[values[nodes] == key]
        found[key] = name
        if len(mine := faces[of_face == key]):
            sets.faces[name] = mine
    return found


def _label_name(field: str, key: int, names: Mapping[int, str], taken: Collection[str]) -> str:
    """The name of a label's sets: the field's name and the label's, or its key if no letter of that can be kept."""
    own = names.get(key, str(key))
    return set_name(f"{field}_{own if set_name(own) != set_name('') else key}", taken)


def _is_cortex(mesh: TetMesh, faces: IntArray, depth: float, thickness: str | None) -> NDArray[np.bool_]:
    centroids = mesh.points[mesh.cells].mean(axis=1)
    tree = surface_tree(mesh.points, faces)
    if thickness is None:
        return closer_than(tree, centroids, depth)
    values = mesh.point_data.get(thickness)
    if values is None or values.ndim != 1 or _is_label(values):
        raise InputError(
            f"the mesh has no scalar field {thickness} for the depth of the cortex",
            remedy=_known(mesh.point_data),
        )
    nearest = closest_points(tree, centroids)
    there = np.einsum("kc,kc->k", nearest.barycentric, values[faces[nearest.faces]])
    return nearest.distances < there


def _is_label(values: NDArray[np.generic]) -> bool:
    return values.ndim == 1 and bool(np.issubdtype(values.dtype, np.integer))


def _known(fields: Collection[str]) -> str:
    return f"name one of {', '.join(fields)}" if fields else "transfer the field to the mesh first"
