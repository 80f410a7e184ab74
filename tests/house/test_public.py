"""The public calls of `cortet`, and the examples of their docstrings."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
import tetgen

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.formats.gifti import write_surface
from cortet.meshes import TetMesh

FUNCTIONS = [name for name in cortet.__all__ if inspect.isfunction(getattr(cortet, name))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A surface, its mesh, and a mesh of TetGen's with slivers."""
    place = tmp_path_factory.mktemp("public")
    shape = cortet.phantom(28, subdivisions=3)
    write_surface(shape, place / "x.surf.gii")
    cortet.mesh(place / "x.surf.gii", cell_size=4.0, ga=28, hemi="L", progress=False).save(place / "x.vtu")
    filled = tetgen.TetGen(np.array(shape.points), np.array(shape.faces))
    filled.tetrahedralize(order=1, mindihedral=10, minratio=1.5, maxvolume=20.0)
    meshio.Mesh(filled.node, [("tetra", filled.elem)]).write(place / "foreign.vtu")
    return place


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_example_of_a_call_runs(name, folder, tmp_path, monkeypatch):
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(cortet, name), name, globs={"cortet": cortet})
    said: list[str] = []
    result = doctest.DocTestRunner().run(example, out=said.append)
    assert result.attempted and not result.failed, "".join(said)


def test_a_mesh_that_was_saved_is_read_with_what_is_known_of_it(folder, tmp_path):
    made = cortet.read(folder / "x.vtu")
    assert made.certified and (made.ga, made.hemi) == (28, "L") and made.cell_size == 4.0
    assert repr(made).count("\n") == repr(made.certificate).count("\n") == 2
    assert "<table>" in made.certificate._repr_html_()
    made.save(tmp_path / "again.vtu")
    assert (tmp_path / "again.vtu").read_bytes() == (folder / "x.vtu").read_bytes()
    with pytest.raises(InputError, match="sidecar.*surface"):
        cortet.read(folder / "foreign.vtu")


def test_other_programs_get_the_arrays_of_the_file(folder):
    made = cortet.read(folder / "x.vtu")
    grid, file = made.to_pyvista(), pyvista.read(folder / "x.vtu")
    assert set(grid.cell_data) == set(file.cell_data) and set(grid.point_data) == set(file.point_data)
    assert np.array_equal(grid.cell_data["q"], made.quality.astype(np.float32))
    for name in ("q", "region"):
        assert np.array_equal(grid.cell_data[name], file.cell_data[name])
    assert made.volume == pytest.approx(grid.volume)


def test_a_mesh_of_another_program_is_improved_and_certified(folder, tmp_path):
    before = cortet.read(folder / "foreign.vtu", folder / "x.surf.gii")
    assert before.certificate.quality.q.max > 0.6 and not before.certified
    words = ["improve", str(folder / "foreign.vtu"), "--surface", str(folder / "x.surf.gii")]
    assert main([*words, "-o", str(tmp_path / "better.vtu")]) == 0
    better = cortet.read(tmp_path / "better.vtu")
    assert better.certified and better.certificate.quality.q.max < 0.6
    in_memory = cortet.improve(before, progress=False)
    assert np.array_equal(in_memory.points, better.points) and np.array_equal(in_memory.cells, better.cells)
    assert next(iter(in_memory.certificate.parameters)) == "clean"
    better.page(tmp_path / "better.html")
    assert "Mesher" not in (tmp_path / "better.html").read_text(), "none of cortet's made it"


def test_what_cannot_be_improved_is_refused(folder):
    made = cortet.read(folder / "x.vtu")
    twice = TetMesh(made.points, np.concatenate([made.cells, made.cells[:1]]))
    flat = np.array(made.points)
    flat[made.cells[7, 0]] = flat[made.cells[7, 1]]
    for mesh, surface, word in (
        (made.mesh, [], "give the surface"),
        (twice, [made.surface], "no valid solid"),
        (TetMesh(flat, made.cells), [made.surface], "no volume"),
        (TetMesh(made.points / 1000, made.cells), [made.surface], "in mm"),
        (TetMesh(made.points + 100, made.cells), [made.surface], "in mm"),
    ):
        with pytest.raises(InputError, match=word):
            cortet.improve(mesh, *surface)


def test_the_order_of_nodes_of_other_programs_does_not_matter(folder):
    made = cortet.read(folder / "x.vtu")
    turned = TetMesh(made.points, made.cells[:, [1, 0, 2, 3]])
    assert cortet.improve(turned, made.surface, 4.0, progress=False).certified
