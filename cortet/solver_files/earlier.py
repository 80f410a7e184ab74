"""Files of an earlier cortet, which numbered regions from 0, or the core 1 and the cortex 2.

Their numbers become those of today, by the names of their sets: a number that a user gives means the same everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cortet.errors import InputError
from cortet.formats import read_mesh
from cortet.formats.ownership import json_of
from cortet.formats.surface_sets import CORE, CORTEX, INTERFACE
from cortet.formats.tags import region_numbers, regions, with_names
from cortet.meshes import AROUND, REGION, TetMesh
from cortet.solver_files.fields import without_q
from cortet.solver_files.sets import with_regions
from cortet.solver_files.sidecar import sidecar_path

#: names of the regions of an earlier cortet, by their numbers from 1 on
_TAGS = (CORE, CORTEX, *AROUND)


def read_today(path: Path) -> tuple[TetMesh, list[str]]:
    """The mesh of a file of any format, with the numbers of regions of today; and what was changed, in words.

    Raises
    ------
    InputError
        the file holds a surface, or cannot be read
    """
    record = json_of(sidecar_path(path))
    mesh, told = numbered_today(without_q(read_mesh(path)), record)
    mesh = _named(mesh, record.get("regions"))
    return mesh, [f"{path}: {line}" for line in told]


def numbered_today(mesh: TetMesh, record: Mapping[str, Any]) -> tuple[TetMesh, list[str]]:
    """The mesh with numbers of regions from 1 on, from the outside in; and what was changed, in words.

    Parameters
    ----------
    record : its sidecar; an earlier cortet numbered the core 1 and the cortex 2, whatever lay in the core
    """
    known, earlier = regions(mesh), "sets" in record and "regions" not in record
    if earlier and REGION in mesh.cell_data and CORE not in known and CORTEX not in known:  # their names were implied
        sets = {name: np.flatnonzero(region_numbers(mesh) == tag) for tag, name in enumerate(_TAGS, start=1)}
        cells = {name: some.astype(np.int32) for name, some in sets.items() if len(some)} | mesh.sets.cells
        mesh = replace(mesh, sets=replace(mesh.sets, cells=cells))
    if (earlier and REGION in mesh.cell_data) or known.get(CORE, 2) < known.get(CORTEX, 1):
        return _numbered_anew(mesh)
    if REGION not in mesh.cell_data or (least := int(region_numbers(mesh).min())) >= 1:
        return mesh, []
    region = region_numbers(mesh) + np.int32(1 - least)
    told = f"regions are numbered from 1: {1 - least} more than in the file"
    return replace(mesh, cell_data={**mesh.cell_data, REGION: region}), [told]


def _numbered_anew(mesh: TetMesh) -> tuple[TetMesh, list[str]]:
    """The mesh of an earlier cortet with the numbers of today, by the names of its sets; and the change, in words."""
    named = [*dict.fromkeys([*mesh.sets.faces, *mesh.sets.nodes])]
    inner = [name.removesuffix(INTERFACE) for name in named if name.endswith(INTERFACE)] or ["white"]
    told = f"regions were numbered as by an earlier cortet, {_listed(regions(mesh))}; "
    others = {name: values for name, values in mesh.cell_data.items() if name != REGION}
    bare = replace(mesh, cell_data=others)
    for names in (inner, ["white"]):  # of all inner surfaces, or only the cortex and what is inside it
        try:
            mesh = with_regions(bare, names)
        except InputError:
            continue
        return mesh, [f"{told}now they are {_listed(regions(mesh))}"]
    return bare, [f"{told}they are left out, as the file does not name those of today"]


def _named(mesh: TetMesh, names: Any) -> TetMesh:
    """The mesh with the names of regions that its sidecar has and its format lacks, where all numbers are those."""
    number = mesh.cell_data.get(REGION)
    if number is None or mesh.sets.cells or not isinstance(names, dict):
        return mesh
    if sorted(map(str, names.values())) != [str(one) for one in np.unique(number).tolist()]:
        return mesh
    return replace(mesh, sets=with_names(mesh.sets, number, names))


def _listed(known: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {name}" for name, number in known.items())
