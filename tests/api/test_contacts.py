"""Contacts from the call and the command to the files of solvers."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from scipy.sparse.linalg import spsolve
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.formats import read_mesh
from cortet.formats.gifti import write_surface
from cortet.geometry.quadratic import quadratic
from cortet.measure.harmonic import stiffness
from cortet.solver_files.ten_nodes import write_ten_nodes

CONTACTS = {"A1": (0, 0, 14.5, 3.0), "B1": (2.0, 1.0, -3.0)}
#: A, into each contact
CURRENTS = {"A1": 1e-3, "A2": -0.7e-3, "A3": -0.3e-3}
#: fields that sum to one, and sets
NAMES = ["electrode_A1", "electrode_B1"]


@pytest.fixture(scope="module")
def made() -> cortet.Mesh:
    return cortet.mesh(ball_surface(4, radius=14.0), 3.0, electrodes=CONTACTS, progress=False)


def test_a_mesh_with_contacts_is_certified_and_has_a_table_of_them(made):
    table = made.electrodes().set_index("name")
    assert made.certified
    assert list(table.kind) == ["disc", "point"]
    assert table.moved_mm["A1"] == pytest.approx(0.5, abs=0.1)
    assert table.area_mm2["A1"] == pytest.approx(table.nominal_area_mm2["A1"], rel=0.03)
    assert table.faces["A1"] == len(made.named().sets.faces["electrode_A1"])


@pytest.mark.parametrize("file", ["x.vtu", "x.xdmf", "x.msh"])
def test_meshio_reads_loads_that_sum_to_one(made, tmp_path, file):
    back = meshio.read(made.save(tmp_path / file))
    for name in NAMES:
        assert np.asarray(back.point_data[name]).sum() == pytest.approx(1, abs=1e-6)


def test_a_file_keeps_loads_and_sets_when_it_is_read_and_saved_again(made, tmp_path):
    made.save(tmp_path / "x.vtu")
    cortet.read(tmp_path / "x.vtu").save(tmp_path / "y.vtu")
    back = read_mesh(tmp_path / "y.vtu")
    for name in NAMES:
        assert back.point_data[name].sum() == pytest.approx(1, abs=1e-12)
    assert len(back.sets.faces["electrode_A1"]) == made.electrodes().faces[0]
    assert len(back.sets.cells["electrode_B1"]) == 1


def test_a_file_that_is_read_or_checked_again_keeps_the_table_of_its_contacts(made, tmp_path):
    file = made.save(tmp_path / "x.vtu")
    expected = made.certificate.electrodes
    again = cortet.read(file)
    assert (
        again.certificate.electrodes == cortet.certify(file).electrodes == cortet.certify(made).electrodes == expected
    )
    assert [one for one in made.certificate.remarks if "electrode" in one] == list(again.certificate.remarks)
    again.save(tmp_path / "y.vtu")
    assert json.loads((tmp_path / "y.certificate.json").read_text())["electrodes"][0]["name"] == "A1"
    cortet.mesh(ball_surface(4, radius=14.0), 4.0, progress=False).save(tmp_path / "z.vtu")
    (tmp_path / "z.certificate.json").write_text((tmp_path / "x.certificate.json").read_text())
    assert cortet.read(tmp_path / "z.vtu").certificate.electrodes == (), "contacts of another mesh"


def test_contacts_of_a_certificate_that_was_edited_are_not_believed(made, tmp_path, caplog):
    file = made.save(tmp_path / "x.vtu")
    certificate = json.loads((tmp_path / "x.certificate.json").read_text())
    electrodes = [{**certificate["electrodes"][0], "faces": 7}]
    (tmp_path / "x.certificate.json").write_text(json.dumps({**certificate, "electrodes": electrodes}))
    assert cortet.read(file).certificate.electrodes == ()
    assert "x.certificate.json: was edited" in caplog.text


def test_abaqus_has_the_faces_of_a_disc_and_the_loads_of_all(made, tmp_path):
    made.save(tmp_path / "x.inp")
    text = (tmp_path / "x.inp").read_text()
    assert "*SURFACE, TYPE=ELEMENT, NAME=electrode_A1" in text and "*ELSET, ELSET=electrode_B1" in text
    assert len([line for line in (tmp_path / "x_fields.inp").read_text().splitlines() if line.startswith("*INIT")]) == 2


@pytest.mark.skipif(not shutil.which("ccx"), reason="calculix-ccx is not installed")
def test_calculix_solves_for_the_potential_of_a_current_between_two_contacts(tmp_path):
    near = {"A1": (0, 1.2, 14, 1.1), "A2": (0, -1.2, 14, 1.1), "A3": (9, 0, 9)}  # the first two share nodes
    made = cortet.mesh(ball_surface(4, radius=14.0), 3.0, electrodes=near, progress=False)
    made.save(tmp_path / "x.inp")
    mesh = made.named()
    current = sum(ampere * mesh.point_data[f"electrode_{name}"] for name, ampere in CURRENTS.items())
    lines = ["*INCLUDE, INPUT=x.inp", "*MATERIAL, NAME=all", "*CONDUCTIVITY", "0.33e-3"]
    lines += ["*SOLID SECTION, ELSET=all_elements, MATERIAL=all", "*STEP", "*HEAT TRANSFER, STEADY STATE", "1., 1."]
    lines += ["*BOUNDARY", "1, 11, 11, 0.", "*CFLUX"]
    lines += [f"{node + 1}, 11, {current[node]:.12g}" for node in np.flatnonzero(current)]
    lines += ["*NODE PRINT, NSET=all_nodes", "NT", "*END STEP"]
    (tmp_path / "job.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True)
    rows = [line.split() for line in (tmp_path / "job.dat").read_text().splitlines()]
    found = np.array([row[1] for row in rows if len(row) == 2 and row[0].isdecimal()], float)

    matrix = 0.33e-3 * stiffness(mesh)
    expected = np.concatenate([[0], spsolve(matrix[1:, 1:].tocsc(), current[1:])])
    assert np.abs(found - expected).max() < 1e-4 * np.ptp(expected)


def test_ten_node_files_leave_out_loads_which_are_those_of_four_nodes(made, tmp_path):
    named = made.named()
    told = write_ten_nodes(named, quadratic(named, made.surface), tmp_path / "x.vtu")
    assert any("four-node elements: electrode_A1, electrode_B1" in line for line in told)
    assert not set(NAMES) & set(meshio.read(tmp_path / "x.vtu").point_data)


def test_the_command_takes_a_table_or_single_contacts(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_surface(ball_surface(3, radius=14.0), Path("x.surf.gii"))
    rows = pd.DataFrame([{"name": "A1", "x": 0, "y": 0, "z": 14, "size": 28.0}])
    rows.to_csv("x_electrodes.tsv", sep="\t", index=False)
    mesh = ["mesh", "x.surf.gii", "--cell-size", "4"]
    assert main([*mesh, "--electrodes", "x_electrodes.tsv", "-o", "a.vtu"]) == 0
    assert "electrode A1: disc, moved" in capsys.readouterr().out
    assert main([*mesh, "--electrode", "A1=0,0,14,2.985", "-o", "b.vtu"]) == 0
    one, other = (json.loads(Path(f"{name}.certificate.json").read_text())["electrodes"] for name in "ab")
    assert one[0]["faces"] == other[0]["faces"] > 3
    assert main([*mesh, "--electrode", "A1=0,0,14", "--electrodes", "x_electrodes.tsv", "-o", "c.vtu"]) != 0
    assert "exclude each other" in capsys.readouterr().err


def test_a_contact_outside_is_refused_before_the_work():
    with pytest.raises(InputError, match="electrode A1 .* lies 6.0 mm outside the surface"):
        cortet.mesh(ball_surface(4, radius=14.0), 3.0, electrodes={"A1": (0, 0, 20)}, progress=False)
