"""The FEBio file: as the manual says, in the eyes of another program too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.formats import febio
from cortet.meshes import MeshSets, TetMesh
from cortet.stages.solver_ready import surface_nodes_first

TETRAHEDRON = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, 2, 3]])


@pytest.fixture
def regions() -> TetMesh:
    """A cube with a core and a cortex, fields and a set of 20 nodes."""
    mesh, _ = surface_nodes_first(cube_mesh(3, side=2.0, jitter=0.2))
    deep = mesh.points[mesh.cells].mean(axis=1)[:, 2] < 1
    fields = {"thickness": mesh.points[:, 0] * np.pi, "normal": mesh.points, "pair": mesh.points[:, :2]}
    sets = MeshSets({"some": np.arange(20)}, {}, {"core": np.flatnonzero(deep), "cortex": np.flatnonzero(~deep)})
    return replace(mesh, point_data=fields, sets=sets)


def test_a_single_tetrahedron_as_the_manual_says(tmp_path):
    febio.write(replace(TETRAHEDRON, point_data={"age": np.array([1.5, 2, 3, 4])}), tmp_path / "m.feb")
    assert (tmp_path / "m.feb").read_text().splitlines() == [
        '<?xml version="1.0" encoding="ISO-8859-1"?>',
        '<febio_spec version="4.0">',
        '<Module type="solid"/>',
        "<Material>",
        '<material id="1" name="tissue" type="neo-Hookean"><density>1</density><E>2.8125</E><v>0.40625</v></material>',
        "</Material>",
        "<Mesh>",
        '<Nodes name="nodes">',
        '<node id="1">0,0,0</node>',
        '<node id="2">1,0,0</node>',
        '<node id="3">0,1,0</node>',
        '<node id="4">0,0,0.333333333333</node>',
        "</Nodes>",
        '<Elements type="tet4" name="tissue">',
        '<elem id="1">1,2,3,4</elem>',
        "</Elements>",
        '<Surface name="cortical_surface">',
        '<tri3 id="1">2,3,4</tri3>',
        '<tri3 id="2">1,4,3</tri3>',
        '<tri3 id="3">1,2,4</tri3>',
        '<tri3 id="4">1,3,2</tri3>',
        "</Surface>",
        '<NodeSet name="all_nodes">1,2,3,4</NodeSet>',
        '<NodeSet name="cortical_surface">1,2,3,4</NodeSet>',
        "</Mesh>",
        "<MeshDomains>",
        '<SolidDomain name="tissue" mat="tissue"/>',
        "</MeshDomains>",
        "<MeshData>",
        '<NodeData name="age" node_set="all_nodes" data_type="scalar">',
        '<node lid="1">1.5</node>',
        '<node lid="2">2</node>',
        '<node lid="3">3</node>',
        '<node lid="4">4</node>',
        "</NodeData>",
        "</MeshData>",
        "</febio_spec>",
    ]


def test_another_programs_model_of_the_format_accepts_the_file(tmp_path, regions):
    """PyFEBio describes the 4.0 specification as data classes that take no unknown element."""
    from pyfebio.model import Model

    febio.write(regions, tmp_path / "m.feb")
    model = Model.from_xml((tmp_path / "m.feb").read_bytes())
    (nodes,), (core, cortex) = model.mesh_.nodes, model.mesh_.elements
    assert len(nodes.all_nodes) == len(regions.points)
    assert [len(part.all_elements) for part in (core, cortex)] == [80, 82]
    assert [domain.mat for domain in model.meshdomains_.solid_domains] == ["core", "cortex"]
    assert len(model.mesh_.surfaces[0].all_tri3) == 108
    assert [material.name for material in model.material_.all_materials] == ["core", "cortex"]
    assert [data.name for data in model.meshdata_.node_data] == ["thickness", "normal", "pair_1", "pair_2"]
