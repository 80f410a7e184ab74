"""The adapter of the published cleaner: what it hands over, and that it believes nothing it gets back.

meshtool itself cannot be installed from a package registry; small scripts stand in for its ways to end.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import cube_mesh

from cortet.errors import StageError
from cortet.stages.meshtool import clean_with_meshtool

#: a script in place of the binary: copies the mesh to -outmsh, moved by 0.001 mm, and then does its own `{twist}`
SCRIPT = """#!{python}
import pathlib, sys
option = dict(a.lstrip("-").split("=") for a in sys.argv[1:] if "=" in a)
assert sys.argv[1:3] == ["clean", "quality"] and option["ofmt"] == "carp_txt"
source, target = option["msh"], option["outmsh"]
pts, elem, lon = (pathlib.Path(source + s).read_text().splitlines() for s in (".pts", ".elem", ".lon"))
pts[1:] = [f"{{float(x) + 0.001:.9g}} {{y}} {{z}}" for x, y, z in map(str.split, pts[1:])]
{twist}
for suffix, lines in [(".pts", pts), (".elem", elem), (".lon", lon)]:
    pathlib.Path(target + suffix).write_text("\\n".join(lines) + "\\n")
with open({log!r}, "a") as log:
    print(pathlib.Path.cwd(), option["thr"], file=log)
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put a stand-in on the PATH; returns the file it logs its folder and threshold to."""

    def put(twist: str = "") -> Path:
        folder, log = tmp_path / "bin", tmp_path / "log"
        folder.mkdir()
        binary = folder / "meshtool"
        binary.write_text(SCRIPT.format(python=sys.executable, twist=twist, log=str(log)))
        binary.chmod(0o755)
        monkeypatch.setenv("PATH", str(folder))
        return log

    return put


def test_a_missing_binary_is_named_with_the_remedy(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StageError, match=r"meshtool is not installed.*clean.backend: cortet"):
        clean_with_meshtool(cube_mesh(2), thresholds=[0.7])


def test_one_pass_per_threshold_in_a_folder_of_its_own_that_is_gone_afterwards(install):
    log, mesh = install(), cube_mesh(2)
    result = clean_with_meshtool(mesh, thresholds=[0.7, 0.5, 0.3])
    assert np.allclose(result.points - mesh.points, [0.003, 0, 0], atol=1e-7) and result.cells is mesh.cells
    folders, thresholds = zip(*(line.split() for line in log.read_text().splitlines()), strict=True)
    assert thresholds == ("0.7", "0.5", "0.3")
    assert len(set(folders)) == 1 and not Path(folders[0]).exists()


@pytest.mark.parametrize(
    ("twist", "words"),
    [
        ("sys.exit('cannot read mesh')", "exit code 1 at threshold 0.7: cannot read mesh"),
        ("sys.exit(0)", r"no usable result.*pass1\.pts.*No such file"),
        ("pts = pts[:-1]", "no usable result.*is not complete"),
        ("elem[0] = str(len(elem) - 2); elem.pop(); lon.pop()", "returned 47 tetrahedra of 48"),
        ("pts[0] = str(len(pts)); pts.append('9 9 9')", "returned 28 nodes of 27"),
        ("elem[1] = 'Tt 0 1 2 3 1'", "changed the connectivity"),
        ("pts[1] = '5 5 5'", "inverted [0-9]+ tetrahedra"),
        ("pts[1] = 'nan 0 0'", "no usable result.*1 nodes have coordinates that are not finite"),
    ],
)
def test_every_bad_end_is_an_error_that_says_which(install, twist, words):
    install(twist)
    with pytest.raises(StageError, match=words):
        clean_with_meshtool(cube_mesh(2), thresholds=[0.7])


def test_inverted_tetrahedra_are_found_though_turned_round(install):
    turned = "pts[1] = '5 5 5'; elem[1:] = [' '.join(['Tt', b, a, *r]) for _, a, b, *r in map(str.split, elem[1:])]"
    install(turned)
    with pytest.raises(StageError, match="inverted"):
        clean_with_meshtool(cube_mesh(2), thresholds=[0.7])
