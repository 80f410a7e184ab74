"""A stage and a mesher are a new file each and some lines: a copy of the package runs both through the workflow."""

from __future__ import annotations

import json
import os
import re
import shutil

import yaml

from cortet.cohort.sheet import PHANTOM, Case, write_sheet
from cortet.formats import vtu
from tests.integration import loaded_snakemake
from tests.integration.study import CONFIG, ROOT

SECTION = '''class Mark(Section):
    """Heights of nodes."""

    enabled: bool = True
    """false leaves the stage out."""
    unit: Positive = 2.0
    """Length that counts as 1, mm."""


'''
STAGE = '''"""Mark how high above the lowest node each node lies."""

from __future__ import annotations

from dataclasses import dataclass, replace

from cortet.config.stages import Mark
from cortet.meshes import TetMesh

VERSION: int = 1


@dataclass(frozen=True)
class MarkReport:
    """What came of it."""

    highest: float


def mark(mesh: TetMesh, settings: Mark = Mark()) -> tuple[TetMesh, MarkReport]:
    """The mesh with a field `height` (n,), in units of `settings.unit` mm."""
    height = (mesh.points[:, 2] - mesh.points[:, 2].min()) / settings.unit
    return replace(mesh, point_data={**mesh.point_data, "height": height}), MarkReport(float(height.max()))
'''
ENTRY = """    Stage(
        name="mark",
        does="marks the height of each node",
        label="Marked",
        takes=("mesh",),
        gives="mesh",
    ),
"""
MESHER = '''"""TetGen inside the triangles of the surface as they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cortet.meshes import TriSurface
from cortet.meshers.mesher import Facts, Filled, Mesher

if TYPE_CHECKING:
    from cortet.config.stages import Generate


def fill(surface: TriSurface, settings: Generate, facts: Facts) -> Filled:
    """Tetrahedra of at most the volume of a regular one with edges of the cell size."""
    import tetgen

    from cortet.meshers._filled import checked, well_ordered

    volume = facts.cell_size**3 / (6 * 2**0.5)
    points, cells, *_ = tetgen.TetGen(surface.points, surface.faces).tetrahedralize(switches=f"pq1.2/20YQa{volume:.3f}")
    mesh, flat = well_ordered(points, cells)
    return Filled(mesh, (checked(mesh, surface, flat=flat),), "tetgen")


MESHERS = (Mesher(name="plain", printed="Plain", fill=fill),)
'''
#: file, the text before which a newcomer writes, what he writes
LINES = [
    ("config/stages.py", "class Reconnect(Section):", SECTION),
    ("config/stages.py", '"cgal", "lattice", ', '"plain", '),
    ("config/model.py", "    Reconnect,\n", "    Mark,\n"),
    ("config/model.py", "    reconnect: Reconnect", "    mark: Mark = Mark()\n"),
    ("stages/__init__.py", '    Stage(\n        name="reconnect"', ENTRY),
    ("meshers/__init__.py", "from cortet.meshers.mesher", "from cortet.meshers import plain\n"),
    ("meshers/__init__.py", "*cgal.MESHERS, ", "*plain.MESHERS, "),
    ("cohort/resources.py", '    "reconnect": Cost', '    "mark": Cost((200, 100), (2, 1)),\n'),
    ("report/stage_sentences.py", '    "reconnect": _', '    "mark": lambda _: "Heights were marked.",\n'),
]


def test_a_newcomer_adds_a_stage_and_a_mesher(tmp_path):
    project, study = tmp_path / "project", tmp_path / "study"
    for name in ("cortet", "rules", "scripts", "envs", "profiles"):
        shutil.copytree(ROOT / name, project / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", project)
    (project / "cortet/stages/mark.py").write_text(STAGE)
    (project / "cortet/meshers/plain.py").write_text(MESHER)
    for file, before, text in LINES:
        path = project / "cortet" / file
        content = path.read_text()
        assert content.count(before) == 1, (file, before)
        path.write_text(content.replace(before, text + before))
    rules = (project / "rules/mesh.smk").read_text()
    relocate = re.search(r"^rule relocate:.*?relocate.*?mesh_stage.py\"\n", rules, re.DOTALL | re.MULTILINE)
    assert relocate
    (project / "rules/mesh.smk").write_text(f"{rules}\n\n{relocate[0].replace('relocate', 'mark')}")
    study.mkdir()
    write_sheet([Case("a", None, "L", 26.0, PHANTOM)], study / "cohort.tsv")
    config = {
        **CONFIG,
        "phantom": {"subdivisions": 4},
        "generate": {"cell_size": 4.0, "meshers": ["plain"]},
        "mark": {"unit": 5.0},
        "certify": {"max_boundary_distance": 1.0},
        "export": {"formats": [], "uncertified": True},
    }
    (study / "config.yaml").write_text(yaml.safe_dump(config))
    arguments = ["--snakefile", str(project / "Snakefile"), "--cores", "2"]
    arguments += ["derivatives/cortet/logs/CITATION.md"]  # of all certificates; no tables, figures and pages
    done = loaded_snakemake.run(arguments, study, {**os.environ, "PYTHONPATH": str(project)})
    assert done.returncode == 0, done.stdout + done.stderr

    made = study / "derivatives/cortet"
    (path,) = made.rglob("*_desc-plainMarked_tetmesh.vtu")
    marked = vtu.read(path)
    heights = marked.points[:, 2] - marked.points[:, 2].min()
    assert abs(marked.point_data["height"] * 5.0 - heights).max() < 1e-3
    certificate = json.loads(next(made.rglob("*certificate.json")).read_text())
    assert certificate["parameters"]["mark"] == {"unit": 5.0, "version": 1}
    assert certificate["reports"]["mark"]["highest"] > 1
    methods = (made / "logs/CITATION.md").read_text()
    assert "Heights were marked." in methods and "the mesher plain (1 mesh)" in methods
    assert {"mark", "generate"} <= {path.name for path in (made / "logs").iterdir()}
