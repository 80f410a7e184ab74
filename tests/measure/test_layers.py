"""Layers of a cortex between two spheres, whose volumes are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
from shapes import ball_surface, shell_mesh

from cortet.errors import InputError
from cortet.formats import abaqus, vtu
from cortet.geometry.nesting import nested
from cortet.measure.layers import (
    COLUMN,
    DEPTH,
    EQUIVOLUMETRIC,
    THICKNESS,
    LayerRecord,
    bounds_of,
    cortical_layers,
    layer_records,
    require_layers,
)
from cortet.measure.regions import Across, RegionRecord
from cortet.measure.remarks import remarks
from cortet.meshes import REGION, TetMesh
from cortet.solver_files.sets import named_sets

OUTER, WHITE = 23.0, 20.0


def head(across: int = 3) -> TetMesh:
    """A cortex of 3 mm around white matter, which is hollow."""
    mesh = shell_mesh(OUTER, WHITE - 3.0, 2 * across)
    centres = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    return replace(mesh, cell_data={REGION: np.where(centres > WHITE * 0.995, 1, 2).astype(np.int32)})


def test_bounds_are_shares_of_the_volume():
    assert bounds_of([1] * 4).tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert bounds_of([1, 1, 2]).tolist() == [0, 0.25, 0.5, 1]
    assert bounds_of([0.1] * 17)[-1] == 1, "rounding leads to no depth beyond the white surface"


def test_layers_share_the_volume_of_the_cortex_as_asked():
    records = layer_records(head(6), ["white"], [1, 2])
    volume = 4 / 3 * np.pi * (OUTER**3 - WHITE**3) / 1000
    assert [record.number for record in records] == [1, 2], "the whole cortex has layers"
    assert sum(record.volume_ml for record in records) == pytest.approx(volume, rel=0.02)
    assert [record.volume_ml / volume for record in records] == pytest.approx([1 / 3, 2 / 3], abs=0.04)
    assert 0 < records[0].cut < 0.6 and records[0].depth == (0.0, pytest.approx(1 / 3))


def test_depth_is_0_outside_and_1_inside_and_only_thickness_is_unknown_there():
    mesh = head()
    found = cortical_layers(mesh, ["white"], bounds_of([1, 1]))
    radius = np.linalg.norm(mesh.points, axis=1)
    cortex, inside = radius > WHITE + 1e-6, radius < WHITE - 1e-6
    assert np.abs(found.of_nodes[THICKNESS][cortex] - 3).max() < 0.05
    assert np.isnan(found.of_nodes[THICKNESS][inside]).all()
    assert np.isnan(found.of_cells[THICKNESS][mesh.cell_data[REGION] == 2]).all()
    for name in (DEPTH, EQUIVOLUMETRIC):
        assert (found.of_nodes[name][inside] == 1).all()
        assert found.of_nodes[name][radius > OUTER - 1e-6] == pytest.approx(0, abs=1e-9)
        assert found.of_nodes[name].min() >= 0 and found.of_nodes[name].max() <= 1
    length = np.linalg.norm(found.of_cells[COLUMN], axis=1)
    assert length[mesh.cell_data[REGION] == 1] == pytest.approx(1) and (length[mesh.cell_data[REGION] == 2] == 0).all()
    fields = [*found.of_nodes.items(), *found.of_cells.items()]
    assert all(np.isfinite(values).all() for name, values in fields if name != THICKNESS)
    assert set(np.unique(found.number[mesh.cell_data[REGION] == 2])) == {0}


def test_a_cortex_with_fewer_elements_across_than_layers_is_remarked_on():
    region = RegionRecord("cortex", 1, 1000, 1.0, 0.0, 0.1, 0.3, Across(1, 2.0, 2.0))
    four = [LayerRecord(number, (0.0, 1.0), 100, 1.0, 0.5) for number in (1, 2, 3, 4)]
    assert remarks({}, {}, [region], 1.2, four[:2]) == ()
    (remark,) = remarks({}, {}, [region], 1.2, four)
    assert "4 layers" in remark and "0.6 mm" in remark


@pytest.mark.parametrize(
    ("records", "keyword"),
    [
        ([], "no inner surface white"),
        ([LayerRecord(1, (0.0, 1.0), 90, 9.0, 0.0), LayerRecord(0, (0.0, 1.0), 10, 1.0, 0.0)], "10% of the cortex"),
        ([LayerRecord(1, (0.0, 0.5), 90, 9.0, 0.0), LayerRecord(2, (0.5, 1.0), 0, 0.0, 0.0)], "without tetrahedra: 2"),
    ],
    ids=["none", "a part without", "empty"],
)
def test_layers_that_are_missing_are_remarked_on(records, keyword):
    (remark,) = remarks({}, {}, layers=records)
    assert keyword in remark


def test_without_white_matter_directly_inside_the_cortex_there_are_no_layers():
    mesh = head()
    deep = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1) < 21.2
    region = np.where(mesh.cell_data[REGION] == 2, 3, np.where(deep, 2, 1)).astype(np.int32)
    between = replace(mesh, cell_data={REGION: region})
    for without, inner in ((between, ["deep", "white"]), (mesh, ["ventricle"])):
        assert layer_records(without, inner, [1, 1]) == ()
        with pytest.raises(InputError, match="white"):
            cortical_layers(without, inner, bounds_of([1, 1]))
    surfaces = nested(ball_surface(2, 23.0), {"deep": ball_surface(2, 21.0), "white": ball_surface(2, 20.0)})
    with pytest.raises(InputError, match="deep"):
        require_layers(surfaces)
    pair = nested(ball_surface(2, 23.0), {"white": surfaces.inner["white"]})
    require_layers(pair)
    for name in ("depth", "layer"):
        with pytest.raises(InputError, match=name):
            require_layers(replace(pair, point_data={name: np.ones(len(pair.points))}))


def test_layers_replace_no_field_or_set_of_the_user():
    mesh = head()
    of_nodes = replace(mesh, point_data={"depth": mesh.points[:, 0]})
    labels = np.ones(len(mesh.cells), np.int32)
    labelled = replace(mesh, cell_data={**mesh.cell_data, "layer": labels})
    with pytest.raises(InputError, match="field depth"):
        named_sets(of_nodes, inner=["white"], layers=[1, 1])
    with pytest.raises(InputError, match="field layer"):
        named_sets(labelled, inner=["white"], layers=[1, 1], tissues=["layer"])


def test_sets_and_fields_of_layers_are_read_by_other_programs(tmp_path: Path):
    mesh = named_sets(head(), inner=["white"], layers=[1, 1, 1])
    sets = {name: cells for name, cells in mesh.sets.cells.items() if name.startswith("layer_")}
    assert list(sets) == ["layer_1", "layer_2", "layer_3"]
    vtu.write(mesh, tmp_path / "x.vtu")
    abaqus.write(mesh, tmp_path / "x.inp")
    grid = pyvista.read(tmp_path / "x.vtu")
    assert {COLUMN, THICKNESS, DEPTH, EQUIVOLUMETRIC} <= {*grid.point_data} & {*grid.cell_data}
    ours, theirs = vtu.read(tmp_path / "x.vtu").sets.cells, meshio.read(tmp_path / "x.inp").cell_sets
    for name, cells in sets.items():
        assert np.array_equal(ours[name], cells) and np.array_equal(np.concatenate(theirs[name]), cells)
