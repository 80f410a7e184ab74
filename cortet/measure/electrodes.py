"""Contacts of electrodes on a mesh: the load of each node, what a contact touches, and how far it was moved.

The loads of a contact sum to 1. So a current through the contact, times its field, is the right-hand side of linear
finite elements; and the field times a potential is the mean potential below the contact.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from cortet.errors import InputError, counted, place_mm
from cortet.formats.electrodes import Contact
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.containing import containing
from cortet.geometry.discs import Disc, disc
from cortet.geometry.interpolation import is_label
from cortet.geometry.limits import CELL_SIZE_MM
from cortet.geometry.mending import measurable
from cortet.geometry.topology import TRI_EDGES, boundary, boundary_surface
from cortet.geometry.winding import winding_numbers
from cortet.measure.layers import EQUIVOLUMETRIC, bounds_of, cortex_and_white, cortical_layers
from cortet.meshes import FILLED, REGION, FloatArray, IntArray, TetMesh, TriSurface, region_names

#: names of fields and sets of contacts begin so
ELECTRODE = "electrode_"
#: a contact with a radius is put on the outer surface up to this distance from it, mm; so is one outside
MOST_MOVED = 2.0
#: a remark is given if a disc's area differs from that of its circle by more than this share: it hangs over a sulcus
_HANGING = 0.1
#: and if its radius is less than this many edges of the mesh, so that the field below it is coarse
_EDGES = 2.5
#: the cell size, over the radius, with which it has so many
_FINE = 0.85


@dataclass(frozen=True)
class ElectrodeRecord:
    """A contact on a mesh."""

    name: str
    #: `disc` on the boundary, or a `point`
    kind: Literal["disc", "point"]
    #: on or in the mesh
    location_mm: tuple[float, float, float]
    #: from the given coordinates
    moved_mm: float
    #: faces that it touches; 0 for a point in a tetrahedron
    faces: int
    #: where it lies; None for a mesh of a single region
    region: str | None
    #: None for a point, as are the next three
    radius_mm: float | None = None
    #: along the boundary, and of a plane circle
    area_mm2: float | None = None
    nominal_area_mm2: float | None = None
    #: over the mean edge of the faces that the disc touches
    radius_over_edge: float | None = None
    #: by name of an integer field or volume: the label with most of the contact, or of the tetrahedron below it
    labels: dict[str, int] = field(default_factory=dict)
    #: equivolumetric depth in the cortex and number of the layer there, if layers are asked for
    depth: float | None = None
    layer: int | None = None


def seated(contacts: Sequence[Contact], surface: TriSurface) -> FloatArray:
    """Where contacts lie after those near the outer surface are put onto it: (k, 3) mm.

    Parameters
    ----------
    surface : to be meshed; its coordinates need not be finite

    Raises
    ------
    InputError : a contact is outside by more than `MOST_MOVED`, or two overlap
    """
    whole, given = measurable(surface), np.array([contact.point for contact in contacts])
    nearest = closest_points(tree_of(whole), given)
    outside = np.abs(winding_numbers(whole, given)) < 0.5
    if far := np.flatnonzero(outside & (nearest.distances > MOST_MOVED)).tolist():
        one = contacts[far[0]]
        raise InputError(
            f"electrode {one.name} at {place_mm(one.point)} lies {nearest.distances[far[0]]:.1f} mm outside the "
            f"surface, more than {MOST_MOVED:g} mm{_too([contacts[other].name for other in far[1:]])}",
            remedy="give coordinates in the space and unit of the surface, or leave the contacts outside out",
        )
    moves = [_is_seated(*one) for one in zip(contacts, nearest.distances.tolist(), outside.tolist(), strict=True)]
    points = np.where(np.array(moves)[:, None], nearest.points, given)
    if pairs := list(_overlaps(contacts, points)):
        (first, second, distance), *others = pairs
        raise InputError(
            f"electrodes {first} and {second} overlap: on or in the mesh their centres are {distance:.3g} mm apart"
            f"{_too([f'{one} and {other}' for one, other, _ in others])}",
            remedy="correct their coordinates or radii, or leave one out",
        )
    return points


def _too(others: Sequence[str]) -> str:
    """The end of a sentence that holds for others, too."""
    return f"; likewise {', '.join(others)}" if others else ""


def around_contacts(contacts: Sequence[Contact], surface: TriSurface) -> tuple[tuple[float, float, float, float], ...]:
    """Location and radius, mm, of each contact around which cells are to become smaller, as `seated` checks them."""
    if not contacts:
        return ()
    located = zip(contacts, seated(contacts, surface).tolist(), strict=True)
    return tuple((x, y, z, contact.radius) for contact, (x, y, z) in located if contact.radius is not None)


def with_electrodes(
    mesh: TetMesh, contacts: Sequence[Contact], inner: Iterable[str] = (), layers: Sequence[float] | None = None
) -> tuple[TetMesh, tuple[ElectrodeRecord, ...]]:
    """The mesh with a field of its nodes and a set of faces or tetrahedra for each contact, and what is known of each.

    Parameters
    ----------
    inner : names of the regions of the mesh from 2 on
    layers : of the cortex, as `bounds_of` takes them

    Returns
    -------
    field `electrode_NAME`, (n,), sum 1; set `electrode_NAME` of the faces that a disc touches, or of the tetrahedron
    that holds a point
    """
    if not contacts:
        return mesh, ()
    outer, nodes = boundary_surface(mesh)
    given = np.array([contact.point for contact in contacts])
    nearest, (cells, weights) = closest_points(tree_of(outer), given), containing(mesh, given)
    names, depths = region_names(inner), _depths(mesh, list(inner), layers)
    fields: dict[str, FloatArray] = {}
    faces: dict[str, IntArray] = {}
    holding: dict[str, IntArray] = {}
    records = []
    for number, contact in enumerate(contacts):
        name, load, cell = f"{ELECTRODE}{contact.name}", np.zeros(len(mesh.points)), int(cells[number])
        location = given[number]
        about: dict[str, Any] = {"kind": "point", "faces": 0}
        if _is_seated(contact, float(nearest.distances[number]), cell < 0):
            location, face, at = nearest.points[number], int(nearest.faces[number]), nearest.barycentric[number]
            cell = int(boundary(mesh).cells[face])
            touched = np.array([face])
            load[nodes[outer.faces[face]]] = at
            if contact.radius is not None:
                found = disc(outer, face, at, contact.radius)
                load[:] = 0
                load[nodes[found.vertices]], touched = found.loads, found.faces
                about = _of_disc(outer, found, contact.radius)
            faces[name] = nodes[outer.faces[touched]]
            about["faces"] = len(touched)
        else:
            holding[name] = np.array([cell], np.int32)
            load[mesh.cells[cell]] = np.maximum(weights[number], 0)
        fields[name] = load / load.sum()
        x, y, z = location.tolist()
        records.append(
            ElectrodeRecord(
                name=contact.name,
                location_mm=(x, y, z),
                moved_mm=float(np.linalg.norm(location - given[number])),
                region=names[mesh.cell_data[REGION][cell] - 1] if len(names) > 1 else None,
                labels=_labels(mesh, fields[name], cell),
                **about,
                **depths(fields[name], cell),
            )
        )
    sets = replace(mesh.sets, faces={**mesh.sets.faces, **faces}, cells={**mesh.sets.cells, **holding})
    return replace(mesh, point_data={**mesh.point_data, **fields}, sets=sets), tuple(records)


def electrode_remarks(mesh: TetMesh, records: Sequence[ElectrodeRecord]) -> list[str]:
    """What a user should know of the contacts of a mesh, by name.

    Parameters
    ----------
    mesh : from `with_electrodes`
    """
    told = []
    made, coarse = mesh.point_data.get(FILLED), []
    for one in records:
        load = mesh.point_data.get(f"{ELECTRODE}{one.name}")
        if made is not None and load is not None and (share := float(load[made > 0].sum())) > 0:
            told.append(f"electrode {one.name}: {share:.0%} of it lies on a part of the surface that repair made")
        if one.area_mm2 is None or one.nominal_area_mm2 is None or one.radius_over_edge is None:
            continue
        share = one.area_mm2 / one.nominal_area_mm2
        if abs(share - 1) > _HANGING:
            told.append(f"electrode {one.name} touches {share:.0%} of the area of its circle: the surface bends there")
        if one.radius_over_edge < _EDGES:
            coarse.append((one.radius_over_edge, one.radius_mm or 0.0, one.name))
    if coarse:
        least, others = min(coarse), f" and {counted(len(coarse) - 1, 'other')}" if len(coarse) > 1 else ""
        size = _FINE * min(radius for _, radius, _ in coarse)
        remedy = f"a cell size of {size:.2g} mm" if size >= CELL_SIZE_MM[0] else "a point: leave the radius out"
        told.append(
            f"electrode {least[2]}{others}: only {least[0]:.2g} edges of the mesh span the radius, too few for the "
            f"field right below (remedy: {remedy})"
        )
    contacts = [Contact(one.name, one.location_mm, one.radius_mm) for one in records]
    points = np.array([one.location_mm for one in records]).reshape(-1, 3)
    told += [f"electrodes {first} and {second} overlap on the mesh" for first, second, _ in _overlaps(contacts, points)]
    return told


def _is_seated(contact: Contact, distance: float, outside: bool) -> bool:
    """Whether a contact is put onto the outer surface, at this distance from it, mm."""
    return outside or (contact.radius is not None and distance <= MOST_MOVED)


def _overlaps(contacts: Sequence[Contact], points: FloatArray) -> Iterable[tuple[str, str, float]]:
    """Names of any two contacts that overlap or coincide, and the distance of their centres, mm."""
    radius = np.array([contact.radius or 0.0 for contact in contacts])
    for first in range(len(contacts)):
        distance = np.linalg.norm(points[first + 1 :] - points[first], axis=1)
        # contacts that touch do not overlap; coordinates in files are rounded
        near = distance < np.maximum((radius[first] + radius[first + 1 :]) * (1 - 1e-3), 1e-6)
        for second in np.flatnonzero(near).tolist():
            yield contacts[first].name, contacts[first + 1 + second].name, float(distance[second])


def _of_disc(surface: TriSurface, found: Disc, radius: float) -> dict[str, Any]:
    ends = surface.points[surface.faces[found.faces][:, TRI_EDGES]]
    edge = float(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).mean())
    areas = {"area_mm2": found.area, "nominal_area_mm2": float(np.pi * radius**2)}
    return {"kind": "disc", "radius_mm": radius, **areas, "radius_over_edge": radius / edge}


def _labels(mesh: TetMesh, load: FloatArray, cell: int) -> dict[str, int]:
    """The labels at a contact, from its loads and its tetrahedron."""
    there, found = np.flatnonzero(load), {}
    for name, values in (mesh.cell_data | mesh.point_data).items():
        if name in (REGION, FILLED) or values.ndim != 1 or not is_label(values):
            continue
        if name in mesh.point_data:
            known, numbers = np.unique(values[there], return_inverse=True)
            found[name] = int(known[np.bincount(numbers, load[there]).argmax()])
        else:
            found[name] = int(values[cell])
    return found


def _depths(mesh: TetMesh, inner: list[str], layers: Sequence[float] | None) -> Any:
    """A function of a contact's loads and its tetrahedron, that gives depth and layer as keywords of a record."""
    if layers is None or cortex_and_white(mesh, inner) is None:
        return lambda *_: {}
    found = cortical_layers(mesh, inner, bounds_of(layers))

    def of_contact(load: FloatArray, cell: int) -> dict[str, Any]:
        return {"depth": float(load @ found.of_nodes[EQUIVOLUMETRIC]), "layer": int(found.number[cell])}

    return of_contact
