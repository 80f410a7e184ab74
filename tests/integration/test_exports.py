"""The workflow writes every format that is asked for, with the fields and sets of the case."""

from __future__ import annotations

import json
from dataclasses import replace

import meshio
import nibabel as nib
import numpy as np
import pytest

from cortet.formats import carp, vtu
from cortet.formats.gifti import read_surface

pytestmark = pytest.mark.thorough

#: end of the name -> solver
EXPORTS = {
    "tetmesh.inp": "abaqus",
    "tetmesh.xdmf": "fenics",
    "tetmesh.pts": "carp",
    "sets.vtu": "vtu",
    "boundary.surf.gii": "gifti",
}


def test_every_format_holds_the_fields_of_the_case_and_says_where_they_came_from(study):
    case = study.cases()[0]
    label = study.folder / "surfaces/area.label.gii"
    height = read_surface(case.surface).points[:, 2]
    table = nib.gifti.GiftiLabelTable()
    for key, name in enumerate(["wall", "rest"]):
        table.labels.append(nib.gifti.GiftiLabel(key))
        table.labels[-1].label = name
    keys = nib.gifti.GiftiDataArray((height > -8).astype(np.int32), "NIFTI_INTENT_LABEL")
    nib.save(nib.gifti.GiftiImage(labeltable=table, darrays=[keys]), label)
    study.write_cases([replace(case, fields={"area": label})])
    study.config["transfer"] = {"enabled": True}
    study.config["export"] = {
        "formats": list(EXPORTS.values()),
        "ten_nodes": ["abaqus", "vtu"],
        "medial_wall": {"area": [0]},
        "cortex_depth": 3.0,
    }
    result = study.run("meshes")
    assert result.returncode == 0, result.stdout + result.stderr

    (of_s2,) = study.files("*desc-latticeTransferred_tetmesh.pts")
    assert np.array_equal(carp.read(of_s2).cells, vtu.read(of_s2.with_suffix(".vtu")).cells)
    (ten_nodes,) = study.files("*desc-latticeSolver_tennodes.vtu")
    numbers = json.loads(ten_nodes.with_suffix(".quadratic.json").read_text())
    assert numbers["least_jacobian"] > 0 and "node_set_area_wall" in meshio.read(ten_nodes).point_data
    assert "*ELSET, ELSET=area_rest" in ten_nodes.with_suffix(".inp").read_text()
    for end, solver in EXPORTS.items():
        (path,) = study.files(f"sub-a*desc-latticeSolver_{end}")
        record = json.loads(path.with_name(path.name + ".json").read_text())
        assert record["fields"]["area"]["source"].endswith("surfaces/area.label.gii")
        if solver in ("abaqus", "fenics", "carp"):
            assert {"cortical_surface", "medial_wall", "area_wall", "area_rest"} == record["sets"]["faces"].keys()
            parcels = {"area_wall", "area_rest"} if solver != "carp" else set()
            assert record["sets"]["cells"].keys() == {"core", "cortex"} | parcels
