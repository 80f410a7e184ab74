"""The FEBio file: as the manual says, in the eyes of another program too."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import febio
from cortet.meshes import MeshSets, TetMesh
from cortet.solver_files.verify import verify
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


def test_regions_sets_and_fields_come_back(tmp_path, regions):
    febio.write(regions, tmp_path / "m.feb")
    assert verify(tmp_path / "m.feb", "febio") == []
    back = febio.read(tmp_path / "m.feb")
    assert np.array_equal(back.cells, regions.cells)
    assert np.allclose(back.points, regions.points, rtol=1e-11)
    assert {name: len(cells) for name, cells in back.sets.cells.items()} == {"core": 80, "cortex": 82}
    assert np.array_equal(back.sets.cells["core"], regions.sets.cells["core"])
    assert np.array_equal(back.sets.nodes["some"], np.arange(20))
    assert back.point_data.keys() == {"thickness", "normal", "pair_1", "pair_2"}
    assert np.allclose(back.point_data["normal"], regions.points, rtol=1e-11)


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


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('version="4.0"', 'version="3.0"', "not <febio_spec version=4.0>"),
        ("</Mesh>", "", "not well-formed XML"),
        ('type="tet4"', 'type="hex8"', "elements of type hex8"),
        (">1,2,3,4</elem>", ">1,2,3</elem>", "<Elements tissue>: entry 1 has 4 fields instead of 5"),
        (">1,2,3,4</elem>", ">1,2,3,9</elem>", "node 9 is named but not defined"),
        (">1,2,4</tri3>", ">1,2,x</tri3>", "<Surface cortical_surface>: entry 3 holds 'x'"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_place(tmp_path, old, new, words):
    path = tmp_path / "m.feb"
    febio.write(TETRAHEDRON, path)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        febio.read(path)
    assert words in verify(path, "febio")[0]


def test_a_set_or_part_that_comes_twice_has_the_members_of_both(tmp_path, regions):
    path = tmp_path / "m.feb"
    febio.write(regions, path)
    text = path.read_text()
    again = '<ElementSet name="more">1,2</ElementSet><ElementSet name="more">2,5</ElementSet>'
    again += '<NodeSet name="some">60</NodeSet>'
    text = text.replace("</Mesh>", f"{again}</Mesh>").replace(
        '<Elements type="tet4" name="cortex">', '<Elements type="tet4" name="core">'
    )
    path.write_text(text)
    sets = febio.read(path).sets
    assert sets.cells["more"].tolist() == [0, 1, 4] and len(sets.cells["core"]) == len(regions.cells)
    assert sets.nodes["some"].tolist() == [*range(20), 59]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</Mesh>", '<NodeSet name="a"><n id="1"/></NodeSet></Mesh>', "holds <n>, not ids separated by commas"),
        ('lid="2"', 'lid="1"', "<NodeData age> does not number its values from 1 to 4"),
        ("</MeshData>", "{again}</MeshData>", "two <NodeData> have the same name"),
    ],
)
def test_what_would_be_read_otherwise_is_refused(tmp_path, old, new, words):
    path = tmp_path / "m.feb"
    febio.write(replace(TETRAHEDRON, point_data={"age": np.arange(4.0)}), path)
    text = path.read_text()
    again = re.search(r"<NodeData.*</NodeData>", text, re.DOTALL)
    path.write_text(text.replace(old, new.format(again=again[0] if again else "")))
    with pytest.raises(InputError, match=words):
        febio.read(path)


def test_a_field_with_a_value_too_many_is_refused(tmp_path):
    path = tmp_path / "m.feb"
    febio.write(replace(TETRAHEDRON, point_data={"age": np.arange(4.0)}), path)
    text = path.read_text()
    (value,) = re.findall(r'<node lid="4">[^<]*</node>', text)
    path.write_text(text.replace(value, value + value))
    with pytest.raises(InputError, match="does not number its values from 1 to 5"):
        febio.read(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<Module type="solid"/>\n', "", "there is no section <Module>"),
        ("<Material>", "<Mesh></Mesh>\n<Material>", "one comes twice"),
        ("<MeshDomains>", "<Domains></Domains>\n<MeshDomains>", "<Domains> is not a section"),
        ('mat="tissue"', 'mat="bone"', "names the material bone, which there is not"),
        ('<SolidDomain name="tissue"', '<SolidDomain name="bone"', "part tissue has no <SolidDomain>"),
        ('material id="1"', 'material id="2"', "materials are numbered 2, not from 1"),
        ('<NodeSet name="cortical_surface"', '<NodeSet name="all_nodes"', "two <NodeSet> are named all_nodes"),
    ],
)
def test_each_broken_rule_of_the_manual_is_named(tmp_path, old, new, words):
    path = tmp_path / "m.feb"
    febio.write(TETRAHEDRON, path)
    path.write_text(path.read_text().replace(old, new, 1))
    assert words in "; ".join(verify(path, "febio"))
