"""Commands answer in words and exit codes; errors are one line without a traceback."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh, ball_surface

import cortet
from cortet.cli import commands, main
from cortet.cohort.sheet import read_sheet
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface, surface_topology
from cortet.meshes import TriSurface


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    write_surface(ball_surface(subdivisions=3, radius=15.0), tmp_path / "ball.surf.gii")
    return tmp_path / "ball.surf.gii"


HEAVY = ("numpy", "numba", "gmsh", "pyvista", "pydantic", "scipy", "pandas", "nibabel")


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("from cortet.cli import main; main(['--help']); main(['fold', '--help'])", HEAVY),
        ("import cortet.pipeline, cortet.cohort.jobs, cortet.api", ["cyclopts"]),  # which is the command's
        ("import cortet.over_all", ["numba", "gmsh", "pyvista", "scipy", "pandas", "nibabel"]),  # as each job plans
    ],
)
def test_the_command_and_a_job_load_only_what_they_use(code, absent):
    asked = f"import sys; {code}; print(*set({absent}) & set(sys.modules))"
    shown = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True).stdout
    assert not shown.splitlines()[-1]


#: words of a command beside `ball.surf.gii` and `ball.vtu`, its exit code, and a keyword of its complaint
REFUSED = [
    *((words, 2, "usage: cortet") for words in ("", "mesh", "mesh x.gii", "cohort", "unknown")),
    ("phantom --ga old -o x", 2, "usage: cortet"),
    ("run in out --formats vtu,,inp", 2, "usage: cortet"),
    ("mesh ball.surf.gii -o y.vtu --slices y.png", 2, "--slices"),
    ("mesh ball.surf.gii -o y.vtu --inner a=a.gii --inner a=b.gii", 2, "--inner names a"),
    ("growth a.gii b.gii --ages 30 28 -o y.func.gii", 2, "later age"),
    ("workflow .", 1, "not empty"),
    ("cohort scan none -o sheet.tsv", 1, "none: no such folder"),
    ("mesh none.surf.gii -o y.vtu", 1, "none.surf.gii: cannot be read"),
    ("mesh ball.surf.gii -o y.obj", 1, "y.obj"),
    ("mesh ball.surf.gii -o y.vtu --config none.yaml", 1, "none.yaml: cannot be read"),
    ("mesh ball.surf.gii -o y.vtu --field thickness=none.shape.gii", 1, "none.shape.gii"),
    *((words, 1, "is a folder") for words in ("quality ''", "certify .", "picture '' -o y.png")),
    *((f"mesh ball.surf.gii -o y.vtu --cell-size={size}", 2, "--cell-size") for size in ("1e308", "nan", "-1", "x")),
    ("phantom --ga 26 --subdivisions 40 -o y.surf.gii", 2, "--subdivisions"),
    ("convert ball.vtu y.vtk", 1, ".vtu"),
    ("convert ball.vtu y.bpts", 1, ".pts"),
    ("convert x.feb y.vtu", 1, ".vtu"),
    ("run sheet.tsv out --formats gmsh_v2", 2, "gmsh"),
]


@pytest.mark.parametrize(("words", "code", "keyword"), REFUSED)
def test_what_cannot_be_done_is_refused_before_any_work(words, code, keyword, ball, monkeypatch, capsys):
    monkeypatch.chdir(ball.parent)
    vtu.write(ball_mesh(2, radius=20.0), ball.with_name("ball.vtu"))
    before = sorted(ball.parent.iterdir())
    try:
        ended = main(shlex.split(words))
    except SystemExit as stopped:
        ended = stopped.code
    shown = capsys.readouterr()
    assert (ended, keyword in shown.err, "seconds" in shown.out) == (code, True, False), shown
    assert len(shown.err.splitlines()) == 1 or "usage" in keyword
    assert sorted(ball.parent.iterdir()) == before


@pytest.mark.parametrize(("words", "command"), [pytest.param(*one, id=one[0]) for one in commands()])
def test_the_help_of_a_command_ends_with_an_example(words, command, monkeypatch, capsys):
    """The example is one line of a narrow terminal, and the command takes it."""
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*words.split()[1:], "--help"]) == 0
    shown = capsys.readouterr().out
    *_, head, example = shown.splitlines()
    assert head == "Example:" and example.startswith(f"  {words}") and max(map(len, shown.splitlines())) <= 80
    command.parse_args(shlex.split(example.removeprefix(f"  {words}")), print_error=False, exit_on_error=False)


def test_gate_gives_one_verdict_per_file(ball, tmp_path, capsys):
    surface = read_surface(ball)
    opened = tmp_path / "open.surf.gii"
    write_surface(TriSurface(surface.points, surface.faces[2:]), opened)
    empty = tmp_path / "empty.surf.gii"
    empty.touch()
    assert main(["gate", str(ball), str(opened), str(empty)]) == 1
    accepted, *refused = capsys.readouterr().out.splitlines()
    assert accepted.startswith(f"accepted  {ball}: 642 vertices")
    assert [line.split()[:2] for line in refused] == [["refused", f"{opened}:"], ["refused", f"{empty}:"]]
    assert "open edges" in refused[0]


def test_repair_writes_the_surface_and_its_report(ball, tmp_path, capsys):
    surface = read_surface(ball)
    points = surface.points.copy()
    points[3] = np.nan
    broken, out = tmp_path / "broken.surf.gii", tmp_path / "out.surf.gii"
    write_surface(TriSurface(points, surface.faces), broken)
    assert main(["repair", str(broken), "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "1 vertex without finite coordinates removed" in shown
    assert surface_topology(read_surface(out).faces).is_closed_manifold
    assert json.loads((tmp_path / "out.surf.repair.json").read_text())["repaired"]


def test_quality_prints_a_table_and_the_record_on_request(tmp_path, capsys):
    vtu.write(cube_mesh(2, side=20.0), tmp_path / "cube.vtu")
    assert main(["quality", str(tmp_path / "cube.vtu")]) == 0
    table = capsys.readouterr().out
    assert re.search("^Tetrahedra +48$", table, re.MULTILINE) and "Stable time step" in table
    assert main(["quality", str(tmp_path / "cube.vtu"), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["tets"] == 48 and f"{record['q']['max']:.4f}" in table


def test_certify_checks_a_mesh_by_its_surface(tmp_path, capsys):
    mesh = cube_mesh(3, side=20.0)
    surface, _ = boundary_surface(mesh)
    vtu.write(mesh, tmp_path / "cube.vtu")
    write_surface(TriSurface(surface.points + np.array([0, 0, 0.5]), surface.faces), tmp_path / "cube.surf.gii")
    files = [str(tmp_path / "cube.vtu"), str(tmp_path / "cube.surf.gii")]
    assert main(["certify", *files]) == 1, "it has the limits of the workflow"
    assert "FAIL  largest distance from a boundary node" in capsys.readouterr().out
    assert main(["certify", *files, "--setting", "published", "-o", str(tmp_path / "c.json")]) == 0
    assert json.loads((tmp_path / "c.json").read_text())["certified"] is True
    (tmp_path / "strict.yaml").write_text("certify: {q_max: 0.1}\n")
    assert main(["certify", *files, "--setting", "published", "--config", str(tmp_path / "strict.yaml")]) == 1


def test_a_white_surface_is_meshed_without_a_cortex_and_that_is_said(tmp_path, capsys):
    """In words, in the sidecar, on the page and in its sets; a layer that is asked for is there."""
    given, out, page = tmp_path / "lh.white.surf.gii", tmp_path / "x.vtu", tmp_path / "x.html"
    write_surface(ball_surface(3, 14.0), given)
    command = ["mesh", str(given), "--cell-size", "5", "-o", str(out)]
    assert main([*command, "--page", str(page)]) == 0
    assert "white matter without the cortex" in capsys.readouterr().out
    record = json.loads((tmp_path / "x.vtu.json").read_text())
    assert record["made_from"]["surface"] == "white"
    assert record["sets"]["cells"].keys() == {"core"}
    assert "white, with the cortex outside it" in page.read_text(encoding="utf-8")
    (tmp_path / "layer.yaml").write_text("export: {cortex_layer: true}\n")
    assert main([*command, "--config", str(tmp_path / "layer.yaml")]) == 0
    assert json.loads((tmp_path / "x.vtu.json").read_text())["sets"]["cells"].keys() == {"core", "cortex"}
    made = cortet.mesh(given, 5.0, progress=False)
    assert made.origin.kind == "white" and made.named().sets.cells.keys() == {"core"}


def test_cohort_scan_replaces_no_sheet_unasked(tmp_path, capsys):
    def found(participant: str) -> None:
        folder = tmp_path / "release" / f"sub-{participant}" / "anat"
        folder.mkdir(parents=True)
        (folder / f"sub-{participant}_hemi-left_wm.surf.gii").touch()

    found("A")
    sheet = tmp_path / "cohort.tsv"
    command = ["cohort", "scan", str(tmp_path / "release"), "-o", str(sheet)]
    assert main(command) == 0
    scanned = sheet.read_bytes()
    edited = scanned.replace(b"yes\tn/a", b'no\tthe "left" one')
    sheet.write_bytes(edited)
    found("B")
    assert main(command) == 1
    assert re.search(r"already exists.*--update.*--force", capsys.readouterr().err, re.DOTALL)
    assert sheet.read_bytes() == edited
    assert main([*command, "--update"]) == 0
    shown = capsys.readouterr().out
    assert "2 surfaces, 1 new and added\n" in shown and "age is unknown: sub-B_hemi-L" in shown
    assert sheet.read_bytes().startswith(edited)
    assert [case.name for case in read_sheet(sheet)] == ["sub-A_hemi-L", "sub-B_hemi-L"]
    assert main([*command, "--force"]) == 0
    assert sheet.read_bytes().startswith(scanned)


def test_a_reader_that_has_enough_is_no_error(tmp_path):
    vtu.write(cube_mesh(1), tmp_path / "cube.vtu")
    pipe = f"{sys.executable} -m cortet.cli quality {tmp_path / 'cube.vtu'} --json | head -c 1"
    done = subprocess.run(["bash", "-c", pipe], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("{", "")


def test_a_name_that_the_terminal_cannot_show_is_no_error(tmp_path):
    vtu.write(cube_mesh(2, side=20.0), tmp_path / "é.vtu")
    command = [sys.executable, "-m", "cortet.cli", "convert", str(tmp_path / "é.vtu"), str(tmp_path / "ö.inp")]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0 and "xf6.inp: written" in done.stdout, done.stderr


def test_a_fold_that_was_killed_goes_on_with_the_age_of_its_file(ball, tmp_path):
    assert main(["mesh", str(ball), "--ga", "24", "--cell-size", "5", "-o", str(tmp_path / "x.vtu")]) == 0
    command = ["fold", str(tmp_path / "x.vtu"), "-o", str(tmp_path / "folded"), "--end", "24.02", "--force"]
    killed = "import os, sys; from pathlib import Path; from cortet.cli import main; from cortet.folding import fold\n"
    killed += "fold.write_series = lambda *_: setattr(Path, 'replace', lambda *_: os._exit(9)); main(sys.argv[1:])"
    # ends as if it were killed while it writes the file after the first frame
    assert subprocess.run([sys.executable, "-c", killed, *command], check=False).returncode == 9
    assert list((tmp_path / "folded").rglob(".[0-9]*"))
    assert main(command) == 0
    assert not list((tmp_path / "folded").rglob(".[0-9]*"))
    assert read_tsv(tmp_path / "folded/fold.tsv").iloc[0]["gestational_age"] == "24"


def test_a_run_on_slurm_without_its_plugin_names_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("cortet.cli.runs.find_spec", lambda _: None)
    (surface := tmp_path / "in/sub-01/anat/sub-01_hemi-L_white.surf.gii").parent.mkdir(parents=True)
    surface.touch()
    assert main(["run", str(tmp_path / "in"), str(tmp_path / "out"), "--profile", "slurm"]) == 1
    assert "pip install 'cortet[slurm]'" in capsys.readouterr().err and not (tmp_path / "out").exists()
