"""FEBio 4.0: the rules of the User Manual ("Free Format Input", specification 4.0) for what a mesh file holds.

The sections come in the manual's order, each at most once and `Module` first; materials are numbered from 1 and named,
names of one kind are unique; every `Elements` part has a domain, every domain a part and a material; `NodeData` names a
node set of the mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from cortet.formats import febio
from cortet.verify.conventions import AsRead

#: sections of a file, in their order
SECTIONS = (
    "Module",
    "Control",
    "Globals",
    "Material",
    "Mesh",
    "MeshDomains",
    "MeshData",
    "MeshAdaptor",
    "Initial",
    "Boundary",
    "Rigid",
    "Loads",
    "Contact",
    "Constraints",
    "Discrete",
    "LoadData",
    "Output",
    "Step",
)
REQUIRED = ("Module", "Material", "Mesh", "MeshDomains")


def as_read(path: Path) -> AsRead:
    """The file as FEBio sees it; raises InputError where it cannot be read."""
    root, _ = febio.read_xml(path)
    return AsRead(febio.read(path), [*_sections(root), *_names(root), *_domains(root), *_data(root)])


def _sections(root: ElementTree.Element) -> Iterator[str]:
    found = [section.tag for section in root]
    for tag in found:
        if tag not in SECTIONS:
            yield f"<{tag}> is no section of a FEBio file"
    for tag in REQUIRED:
        if tag not in found:
            yield f"there is no section <{tag}>"
    known = [SECTIONS.index(tag) for tag in found if tag in SECTIONS]
    if known != sorted(set(known)):
        yield f"the sections come in the order {', '.join(found)}, or one comes twice; it must be {', '.join(SECTIONS)}"


def _names(root: ElementTree.Element) -> Iterator[str]:
    for kind in (
        "Material/material",
        "Mesh/Elements",
        "Mesh/NodeSet",
        "Mesh/Surface",
        "Mesh/ElementSet",
        "MeshData/NodeData",
    ):
        names = [element.get("name") for element in root.iterfind(kind)]
        tag = kind.partition("/")[2]
        if not all(names):
            yield f"a <{tag}> has no name"
        for name in sorted({str(name) for name in names if names.count(name) > 1}):
            yield f"two <{tag}> are named {name}"
    ids = [material.get("id") for material in root.iterfind("Material/material")]
    if ids != [str(number + 1) for number in range(len(ids))]:
        yield f"materials are numbered {', '.join(map(str, ids))}, not from 1"


def _domains(root: ElementTree.Element) -> Iterator[str]:
    parts = {element.get("name") for element in root.iterfind("Mesh/Elements")}
    materials = {element.get("name") for element in root.iterfind("Material/material")}
    domains = {element.get("name"): element.get("mat") for element in root.iterfind("MeshDomains/SolidDomain")}
    for part in sorted(map(str, parts - domains.keys())):
        yield f"part {part} has no <SolidDomain>"
    for part in sorted(map(str, domains.keys() - parts)):
        yield f"<SolidDomain> {part} is no part of the mesh"
    for name, material in domains.items():
        if material not in materials:
            yield f"<SolidDomain> {name} names the material {material}, which there is not"


def _data(root: ElementTree.Element) -> Iterator[str]:
    sets = {element.get("name") for element in root.iterfind("Mesh/NodeSet")}
    for data in root.iterfind("MeshData/NodeData"):
        if data.get("node_set") not in sets:
            yield f"field {data.get('name')} is of the node set {data.get('node_set')}, which there is not"
