"""The adapter of the published cleaner: what it hands over, and that it believes nothing it gets back.

meshtool itself cannot be installed from a package registry; small scripts stand in for its ways to end.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import StageError
from cortet.measure.quality import quality
from cortet.meshes import TetMesh
from cortet.stages._meshtool import clean_with_meshtool

#: a script in place of the binary. As the real one does, it writes nothing and exits with 0 when no element is above
#: the threshold; else it copies the mesh to -outmsh, moved by 0.001 mm, and then does its own `{twist}`
SCRIPT = """#!{python}
import pathlib, sys
option = dict(a.lstrip("-").split("=") for a in sys.argv[1:] if "=" in a)
assert sys.argv[1:3] == ["clean", "quality"] and option["ofmt"] == "carp_txt"
source, target = option["msh"], option["outmsh"]
pts, elem, lon = (pathlib.Path(source + s).read_text().splitlines() for s in (".pts", ".elem", ".lon"))
with open({log!r}, "a") as log:
    print(pathlib.Path.cwd(), option["thr"], source, file=log)
if {worst} <= float(option["thr"]):
    sys.exit(0)
pts[1:] = [f"{{float(x) + 0.001:.9g}} {{y}} {{z}}" for x, y, z in map(str.split, pts[1:])]
{twist}
for suffix, lines in [(".pts", pts), (".elem", elem), (".lon", lon)]:
    pathlib.Path(target + suffix).write_text("\\n".join(lines) + "\\n")
"""


def bad_mesh() -> TetMesh:
    """A cube of 48 flattened tetrahedra, the worst of them above every threshold that is used here."""
    cube = cube_mesh(2)
    return TetMesh(cube.points * [1, 1, 0.1], cube.cells)


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put a stand-in on the PATH; returns the file it logs its folder and threshold to."""

    def put(twist: str = "") -> Path:
        folder, log = tmp_path / "bin", tmp_path / "log"
        folder.mkdir()
        binary = folder / "meshtool"
        worst = quality(bad_mesh().points, bad_mesh().cells).max()
        binary.write_text(SCRIPT.format(python=sys.executable, worst=worst, twist=twist, log=str(log)))
        binary.chmod(0o755)
        monkeypatch.setenv("PATH", str(folder))
        return log

    return put


TURNED = "pts[1] = '5 5 5'; elem[1:] = [' '.join(['Tt', b, a, *r]) for _, a, b, *r in map(str.split, elem[1:])]"


def test_one_pass_per_threshold_in_a_folder_of_its_own_that_is_gone_afterwards(install):
    log, mesh = install(), bad_mesh()
    result = clean_with_meshtool(mesh, thresholds=[0.7, 0.5, 0.3])
    assert np.allclose(result.points - mesh.points, [0.003, 0, 0], atol=1e-7) and result.cells is mesh.cells
    folders, thresholds, _ = zip(*(line.split() for line in log.read_text().splitlines()), strict=True)
    assert thresholds == ("0.7", "0.5", "0.3")
    assert len(set(folders)) == 1 and not Path(folders[0]).exists()


@pytest.mark.parametrize(
    ("twist", "words"),
    [
        ("sys.exit('cannot read mesh')", "cannot read mesh"),
        ("sys.exit(0)", "0.7"),
        ("pts = pts[:-1]", "no usable result"),
        ("elem[0] = str(len(elem) - 2); elem.pop(); lon.pop()", "tetrahedra .*to 47"),
        ("pts[0] = str(len(pts)); pts.append('9 9 9')", "nodes .*to 28"),
        ("elem[1] = 'Tt 0 1 2 3 1'", "connectivity"),
        (TURNED, "inverted"),
        ("pts[1] = 'nan 0 0'", "finite"),
    ],
)
def test_every_bad_end_is_an_error_that_says_which(install, monkeypatch, tmp_path, twist, words):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StageError, match="meshtool"):  # it is not installed yet
        clean_with_meshtool(bad_mesh(), thresholds=[0.7])
    install(twist)
    with pytest.raises(StageError, match=words):
        clean_with_meshtool(bad_mesh(), thresholds=[0.7])
