"""Read a file with Gmsh in a separate process, since a damaged file can crash Gmsh (2 of 118 at random did).

`cortet.formats.msh` runs this module as a program. It imports no other module of cortet, so it starts at once.
Arrays go into an .npz file; names of groups and fields go beside them as JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

TRIANGLE, TETRAHEDRON = 2, 4  # Gmsh's element types
KINDS = {"triangle": (TRIANGLE, 2), "tetrahedron": (TETRAHEDRON, 3)}
FIELDS = ("NodeData", "ElementData")


@contextmanager
def session() -> Iterator[None]:
    """An empty, silent Gmsh model on one thread, which reads no arguments, configuration or signals."""
    gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def arrays_of(path: str) -> dict[str, NDArray[Any]]:
    """Tags and coordinates of nodes, tags and nodes of elements, tags of groups and fields, as Gmsh gives them."""
    with session():
        gmsh.open(path)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        arrays: dict[str, NDArray[Any]] = {"node_tags": tags, "coordinates": coordinates.reshape(-1, 3)}
        names: dict[str, list[str]] = {}
        if others := sorted(set(gmsh.model.mesh.getElementTypes(3).tolist()) - {TETRAHEDRON}):
            sys.exit(f"it holds {gmsh.model.mesh.getElementProperties(others[0])[0]} elements, not only Tetrahedron 4")
        for name, (kind, dimension) in KINDS.items():
            arrays[f"{name}_tags"], arrays[f"{name}_nodes"] = gmsh.model.mesh.getElementsByType(kind)
            names[name] = []
            groups = [number for _, number in gmsh.model.getPhysicalGroups(dimension)]
            arrays[f"{name}_groups"] = np.array(groups, np.int64)
            for number in groups:
                entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, number)
                members = [gmsh.model.mesh.getElementsByType(kind, entity)[0] for entity in entities]
                arrays[f"{name}_group_{len(names[name])}"] = np.concatenate([np.empty(0, np.uint64), *members])
                names[name].append(gmsh.model.getPhysicalName(dimension, number) or str(number))
        names |= {kind: [] for kind in FIELDS}
        for view in gmsh.view.getTags():
            kind, tags, values, _, components = gmsh.view.getHomogeneousModelData(view, 0)
            if kind in FIELDS:
                order = np.argsort(tags)
                if kind == "ElementData":  # triangles may also have values
                    order = order[np.isin(tags[order], arrays["tetrahedron_tags"])]
                arrays[f"{kind}_{len(names[kind])}"] = values.reshape(-1, components)[order]
                names[kind].append(gmsh.view.option.getString(view, "Name"))
        return {**arrays, "names": np.array(json.dumps(names))}


def main(source: str, target: str) -> None:
    """Read one file and write the other."""
    try:
        arrays = arrays_of(source)
    except Exception as error:  # the Gmsh API raises plain exceptions
        sys.exit(f"{error}")
    np.savez(target, allow_pickle=False, **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
