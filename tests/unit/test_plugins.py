"""PyVista and meshio open what cortet writes, with its fields and sets, and what they opened before."""

from __future__ import annotations

import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
from meshio import _helpers
from shapes import ball_mesh

from cortet.errors import InputError
from cortet.formats import format_of
from cortet.formats.plugins import read_with_pyvista, register_with_meshio
from cortet.solver_files.sets import named_sets
from cortet.stages.solver_ready import surface_nodes_first

ROOT = Path(__file__).parents[2]
READERS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][
    "pyvista.readers"
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A ball in every format that has a plugin, and a tetrahedron as Medit writes it."""
    mesh = named_sets(surface_nodes_first(ball_mesh(2, radius=20.0))[0])
    for ending in (*READERS, ".pts"):
        format_of(path := tmp_path / f"ball{ending}").write(mesh, path)
    one = meshio.Mesh(np.eye(4, 3, k=-1), [("tetra", [[0, 1, 2, 3]])])
    meshio.write(tmp_path / "medit.mesh", one, file_format="medit")
    return tmp_path


@pytest.mark.parametrize("ending", READERS)
def test_pyvista_reads_by_the_entry_point(ending: str, folder: Path) -> None:
    reader = EntryPoint(ending, READERS[ending], "pyvista.readers").load()
    grid = reader(str(folder / f"ball{ending}"))
    assert isinstance(grid, pyvista.UnstructuredGrid)
    assert grid.volume == pytest.approx(4 / 3 * np.pi * 20.0**3, rel=0.1)
    assert ("node_set_cortical_surface" in grid.point_data) == (ending != ".mesh")  # which names no nodes


def test_medits_files_are_read_as_before(folder: Path) -> None:
    assert read_with_pyvista(folder / "medit.mesh").n_cells == 1


def test_meshio_reads_them_once_it_is_told(folder: Path) -> None:
    register_with_meshio()
    try:
        for file in folder.glob("ball.*"):
            if file.suffix in (*READERS, ".pts"):
                assert len(meshio.read(file).cells_dict["tetra"]) == len(format_of(file).read(file).cells)
        assert len(meshio.read(folder / "medit.mesh").cells_dict["tetra"]) == 1
        (folder / "cut.feb").write_text("<febio_spec")
        with pytest.raises(InputError, match="cut.feb"):  # and the program goes on
            meshio.read(folder / "cut.feb")
    finally:
        for name in [name for name in _helpers.reader_map if name.startswith("cortet-")]:
            meshio.deregister_format(name)


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    for content in (b"4 0 0 0", b"", b"\xff\xfe\x00junk", b"#\x00\x01junk"):
        (tmp_path / "a.mesh").write_bytes(content)
        with pytest.raises(InputError, match=r"a\.mesh"):
            read_with_pyvista(tmp_path / "a.mesh")
    with pytest.raises(InputError, match="cannot be read"):
        read_with_pyvista(tmp_path / "none.mesh")
