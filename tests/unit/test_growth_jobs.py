"""`cortet job` for FEBio and FEniCS: growth along the cortex, the same supports, and files that their readers take."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from cubes import cube_mesh
from fold_solver import DOLFINX, ball, by_dolfinx, exact, outward

from cortet.cli import main
from cortet.errors import InputError
from cortet.folding import febio_job, fenics_job
from cortet.folding.body import Material
from cortet.formats import read_mesh, vtu
from cortet.meshes import MeshSets, TetMesh
from cortet.solver_files.sets import named_sets
from cortet.stages.solver_ready import surface_nodes_first


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    cube = named_sets(surface_nodes_first(cube_mesh(4, side=6.0))[0], cortex_depth=1.0)
    wall = np.flatnonzero(cube.points[:, 0] == 0).astype(np.int32)
    walled = cube.sets.faces["cortical_surface"]
    on_wall = (cube.points[walled, 0] == 0).all(axis=1)
    faces = {"cortical_surface": walled[~on_wall], "medial_wall": walled[on_wall]}
    nodes = {**cube.sets.nodes, "cortical_surface": np.unique(walled[~on_wall]), "medial_wall": wall}
    return replace(cube, sets=MeshSets(nodes, faces, cube.sets.cells))


@pytest.fixture(scope="module")
def deck(mesh: TetMesh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("febio")
    vtu.write(mesh, folder / "mesh.vtu")
    job = str(folder / "job")
    assert main(["job", str(folder / "mesh.vtu"), "-o", job, "--solver", "febio", "--growth", "0.3"]) == 0
    return folder / "job/job.feb"


def test_growth_of_the_febio_job_is_along_the_cortex_of_each_element(deck: Path, mesh: TetMesh) -> None:
    """`area growth` as FEBio 4 computes it (FEGrowthTensor.cpp), in the axes that it makes of `mat_axis`."""
    root = ElementTree.parse(deck).getroot()
    (growing,) = (one for one in root.iterfind("Mesh/ElementSet") if one.get("name") == "growing")
    assert np.array_equal(np.array((growing.text or "").split(","), int) - 1, mesh.sets.cells["cortex"])
    (axes,) = root.iterfind("MeshData/ElementData")
    assert (axes.get("type"), axes.get("elem_set"), len(axes)) == (
        "mat_axis",
        "growing",
        len(mesh.sets.cells["cortex"]),
    )
    last = [float(pt.text.split(",")[1]) for pt in root.iterfind("LoadData/load_controller/points/pt") if pt.text][-1]
    for number, element in enumerate(axes, start=1):
        assert element.get("lid") == str(number)
        a, d = (np.array((element.findtext(tag) or "").split(","), float) for tag in "ad")
        stretch = np.sqrt(last)
        grown = stretch * np.eye(3) + np.outer(a, a) * ((2 - stretch) - 1)
        third = np.cross(a, d)
        assert grown @ a == pytest.approx(a, abs=1e-6)
        for within in (np.cross(third, a), third):
            assert grown @ within == pytest.approx(1.3 * within, abs=1e-6)
    grey = next(one for one in root.iterfind("Material/material") if one.get("name") == "cortex")
    assert (grey.get("type"), grey.find("growth").get("type")) == ("kinematic growth", "area growth")  # type: ignore[union-attr]
    young, poisson = float(grey.findtext("elastic/E") or 0), float(grey.findtext("elastic/v") or 0)
    assert young / (2 * (1 + poisson)) == pytest.approx(Material().mu_cortex)
    assert young / (3 * (1 - 2 * poisson)) == pytest.approx(Material().bulk)


def test_another_programs_model_of_febio_accepts_everything_but_what_it_does_not_know(deck: Path) -> None:
    """It (PyFEBio) has neither kinematic growth nor axes of single elements, and writes 0 and 1 but does not read them.

    So the elastic part stands in for the growing material, the axes are left out, and supports are as it writes them.
    """
    from pyfebio.boundary import BCZeroDisplacement
    from pyfebio.model import Model

    text = deck.read_text()
    growth = re.compile(
        r'type="kinematic growth"><density>1</density>\n<elastic type="neo-Hookean">(.*)</elastic>\n<growth.*\n'
    )
    assert len(growth.findall(text)) == 1
    text = growth.sub(r'type="neo-Hookean">\1', text)
    text = re.sub(r"<MeshData>.*</MeshData>\n", "", text, flags=re.DOTALL)
    supports = ElementTree.fromstring(text).findall("Boundary/bc")
    for support, held in zip(supports, ((1, 0, 0), (0, 1, 1), (0, 0, 1)), strict=True):
        dofs = dict(zip(("x_dof", "y_dof", "z_dof"), held, strict=True))
        theirs = ElementTree.fromstring(BCZeroDisplacement(node_set=support.get("node_set", ""), **dofs).to_xml())
        assert support.attrib == theirs.attrib | {"name": support.get("name")}
        assert [(one.tag, one.text) for one in support] == [(one.tag, one.text) for one in theirs]
    assert [one.get("node_set") for one in supports] == ["medial_wall", "centre", "ahead"]
    model = Model.from_xml(re.sub("<Boundary>.*</Boundary>\n", "", text, flags=re.DOTALL).encode())
    assert model.control_.time_steps == 10 and [one.name for one in model.material_.all_materials] == ["core", "cortex"]


def test_the_febio_job_says_what_it_is(deck: Path) -> None:
    assert "grows by 30 %" in (deck.parent / "README.txt").read_text()
    assert len((deck.parent / "README.txt").read_text().splitlines()) == 5


def test_the_fenics_job_has_the_mesh_directions_and_supports(mesh: TetMesh, tmp_path: Path) -> None:
    vtu.write(mesh, tmp_path / "mesh.vtu")
    folder = tmp_path / "job"
    assert main(["job", str(tmp_path / "mesh.vtu"), "-o", str(folder), "--solver", "fenics", "--growth", "0.3"]) == 0
    assert np.array_equal(read_mesh(folder / "mesh.xdmf").cells, mesh.cells)
    length = np.linalg.norm(np.load(folder / "normals.npy"), axis=1)
    assert length[mesh.sets.cells["cortex"]] == pytest.approx(1) and not length[mesh.sets.cells["core"]].any()
    job = json.loads((folder / "job.json").read_text())
    assert (job["growth"], job["steps"]) == (0.3, 15)
    moduli = np.load(folder / "moduli.npy")
    assert (moduli[mesh.sets.cells["cortex"]] == [1.0, 5.0]).all()
    assert (moduli[mesh.sets.cells["core"]] == [1.167, 5.0]).all()
    wall, centre, ahead = job["supports"]
    assert wall == {"axes": [0], "facets": 102} and centre["axes"] == [1, 2] and ahead["axes"] == [2]
    assert centre["point"][0] == ahead["point"][0] == 0
    assert (folder / "job.py").read_text() == fenics_job.PROGRAM.read_text()


@pytest.mark.parametrize("job", [febio_job, fenics_job])
def test_growth_beyond_all_measure_and_meshes_without_cortex_are_refused(job: object, tmp_path: Path) -> None:
    write = job.write_job  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="growth is 1.5, but the material holds for strains of this size"):
        write(named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0), tmp_path, growth=1.5)
    with pytest.raises(InputError, match="no set `cortex`"):
        write(cube_mesh(2), tmp_path, growth=0.1)
    assert not list(tmp_path.iterdir())


def has_dolfinx() -> bool:
    try:
        return not subprocess.run([*DOLFINX, "-c", "import dolfinx"], capture_output=True, check=False).returncode
    except OSError:
        return False


@pytest.mark.skipif(not has_dolfinx(), reason="dolfinx (python3-dolfinx) is not installed for the system's Python")
def test_a_ball_whose_shell_grows_moves_in_dolfinx_as_it_should() -> None:
    mesh, growth = ball(2.5), 0.02
    outside, interface = exact(growth, Material())
    assert outward(mesh, by_dolfinx(mesh, growth)) == (
        pytest.approx(outside, rel=0.02),
        pytest.approx(interface, rel=0.15),
    )
