"""`cortet compare`: meshes of one surface side by side, whatever made them, each checked by the same limits."""

from __future__ import annotations

from pathlib import Path

import pytest
from shapes import ball_mesh

from cortet.cli import main
from cortet.formats import msh, vtu
from cortet.formats.gifti import write_surface
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.meshes import TetMesh


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """A mesh, the same with its boundary 1 % larger in the format of another tool, and the surface of the first."""
    mesh = ball_mesh()
    vtu.write(mesh, tmp_path / "exact.vtu")
    msh.write(TetMesh(1.01 * mesh.points, mesh.cells), tmp_path / "larger.msh")
    write_surface(boundary_surface(mesh)[0], tmp_path / "ball.surf.gii")
    return [str(tmp_path / name) for name in ("exact.vtu", "larger.msh", "ball.surf.gii")]


def test_every_mesh_is_checked_by_the_same_limits(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, table = tmp_path / "page.html", tmp_path / "table.tsv"
    limits = ["--q-max", "0.99", "--cell-size", "1"]
    assert main(["compare", *files[:2], "--surface", files[2], "-o", str(page), "--table", str(table), *limits]) == 0

    said = capsys.readouterr().out
    assert "exact: certified\n" in said
    assert "larger: NOT certified: distance of a boundary node to the surface" in said
    rows = read_tsv(table).set_index("number")
    assert list(rows.columns) == ["limit", "exact", "larger"]
    assert rows.loc["Tetrahedra", "exact"] == rows.loc["Tetrahedra", "larger"]
    of_nodes = rows.loc["Distance of a boundary node to the surface, at most"]
    assert of_nodes["limit"] == "at most 0.001 mm"
    # the ball has a radius of 1
    off = [float(of_nodes[name].removesuffix(" mm")) for name in ("exact", "larger")]
    assert off == [pytest.approx(0, abs=1e-6), pytest.approx(0.01, abs=1e-4)], "GIfTI has single precision"

    text = page.read_text()
    assert text.count("<img ") == 6, "a cut and two sides of the surface for each mesh"
    assert text.count('class="wrong"') >= 1 and "ball.surf.gii" in text


def test_meshes_are_told_apart_by_name_and_by_content(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other").mkdir()
    twin, limit = tmp_path / "other/exact.vtu", tmp_path / "limit.vtu"
    for copy in (twin, limit):
        copy.write_bytes(Path(files[0]).read_bytes())
    page = tmp_path / "page.html"
    rest = ["--surface", files[2], "-o", str(page), "--force"]
    assert main(["compare", files[0], str(twin), *rest]) == 0
    assert f"{files[0]}: " in capsys.readouterr().out
    assert main(["compare", files[0], str(limit), *rest]) == 0
    assert '<th scope="col" class="n">limit</th>' in page.read_text(), "it is called as a column of the page is"
    assert main(["compare", files[0], files[0], *rest]) == 1
    assert "given twice" in capsys.readouterr().err
    assert main(["compare", files[0], files[2], *rest]) == 1
    assert "holds a surface" in capsys.readouterr().err
