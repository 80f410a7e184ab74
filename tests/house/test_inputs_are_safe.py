"""No command changes or deletes a file that it was given, whatever it is told to write, and to where."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_surface

from cortet.cli import commands, main
from cortet.formats.gifti import write_fields, write_surface
from cortet.formats.ownership import MANIFEST
from cortet.formats.volumes import write_volume
from cortet.phantoms import phantom_with_sphere

#: the user's files
GIVEN = (
    *("x.surf.gii", "inner.surf.gii", "sphere.surf.gii", "x.shape.gii", "x.vtu", "x.pts", "x.elem", "x.lon", "x.inp"),
    *("settings.yaml", "notes.txt", "x.json", "x_dseg.nii.gz", "ds/participants.tsv"),
    *("ds/dataset_description.json", "ds/.bidsignore", "ds/sub-1/anat/sub-1_hemi-L_white.surf.gii", "old/notes.txt"),
)


#: each command with words with which it would succeed; `OUT` stands for a file that it writes, `DIR` for a folder
COMMANDS: dict[str, list[str]] = {
    "mesh": [
        "x.surf.gii --cell-size 5 --config settings.yaml -o OUT.vtu",
        "x.surf.gii --inner inner.surf.gii --cell-size 5 -o OUT.pts",
        "x.surf.gii --cell-size 5 --size cortex=4.9 -o OUT.vtu",
        "x.surf.gii --cell-size 5 --field t=x.shape.gii -o fresh.mesh --picture OUT.png",
        "x.surf.gii --cell-size 5 -o fresh.mesh --page OUT.html",
        "x.surf.gii --cell-size 5 --volume t=x_dseg.nii.gz -o fresh.mesh --slices OUT.png",
    ],
    "improve": ["x.vtu --surface x.surf.gii -o OUT.inp"],
    "gate": ["x.surf.gii inner.surf.gii"],
    "repair": ["x.surf.gii --config settings.yaml -o OUT.surf.gii"],
    "layers": ["inner.surf.gii x.surf.gii --layers 2 --cell-size 4 -o OUT.surf.gii"],
    "growth": [
        "x.surf.gii inner.surf.gii --ages 28 30 -o OUT.func.gii",
        "x.surf.gii inner.surf.gii --ages 28 30 -o fresh.func.gii --picture OUT.png",
    ],
    "quality": ["x.vtu"],
    "certify": ["x.vtu x.surf.gii -o OUT.json"],
    "cite": ["x.vtu"],
    "convert": [f"x.vtu OUT{suffix}" for suffix in (".inp", ".pts", ".vtu", ".surf.gii")],
    "quadratic": ["x.vtu x.surf.gii -o OUT.inp"],
    "project": ["x.vtu --mesh x.vtu --surface x.surf.gii -o OUT.func.gii"],
    "picture": ["x.vtu -o OUT.png"],
    "fold": ["x.vtu --ga 30 --end 30.001 --config settings.yaml -o DIR"],
    "phantom": [
        "--ga 24 --subdivisions 3 -o OUT.surf.gii",
        "--ga 24 --subdivisions 3 --sphere fresh.surf.gii --pial OUT.surf.gii -o other.surf.gii",
        "--ga 24 --subdivisions 3 -o fresh.surf.gii --sphere OUT.surf.gii",
    ],
    "cohort": ["scan ds -o OUT.tsv", "scan ds --force -o OUT.tsv"],
    "run": ["ds DIR participant --dry-run --config settings.yaml"],
    "workflow": ["DIR"],
    "config": [],
    "doctor": [],
}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files of a user."""
    folder = tmp_path_factory.mktemp("given")
    for name in GIVEN:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    surface = ball_surface(3, 14.0)
    write_surface(surface, folder / "x.surf.gii")
    write_surface(surface, folder / "ds/sub-1/anat/sub-1_hemi-L_white.surf.gii")
    write_surface(ball_surface(3, 8.0), folder / "inner.surf.gii")
    write_surface(phantom_with_sphere(24.0, subdivisions=3)[1], folder / "sphere.surf.gii")
    write_fields({"t": surface.points[:, 0]}, folder / "x.shape.gii")
    around = np.array([[1, 0, 0, -20], [0, 1, 0, -20], [0, 0, 1, -20], [0, 0, 0, 1.0]])
    write_volume(np.ones((40, 40, 40), np.int16), around, folder / "x_dseg.nii.gz")
    (folder / "settings.yaml").write_text("generate: {cell_size: 5.0}\nfold: {force: true}\n")
    (folder / "ds/participants.tsv").write_text("participant_id\tscan_age\nsub-1\t24\n")
    (folder / "ds/dataset_description.json").write_text(json.dumps({"Name": "raw", "BIDSVersion": "1.9.0"}))
    for end in (".vtu", ".inp", ".pts"):
        words = ["mesh", str(folder / "x.surf.gii"), "--cell-size", "5", "--force", "-o", str(folder / f"x{end}")]
        assert main(words) == 0
    for record in [*folder.glob("x.*.json"), *folder.glob("x.meshed*"), folder / MANIFEST]:
        record.unlink()  # so that the meshes are the user's
    return folder


def contents(folder: Path, names: Iterable[str] = ()) -> dict[str, bytes]:
    """Of some files, or of all."""
    paths = [folder / name for name in names] or [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


#: ways to name a file of the user
SPELLINGS = ("{0}", "ds/../{0}", "{link}/{0}")
#: a command in a folder with a mesh of cortet's
FOLD = "fold x.vtu --ga 20 --end 20.001 --config fold.yaml -o f"


def run(words: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.chdir(folder)
    try:
        return main(words.split())
    except SystemExit as stop:  # wrong usage
        return int(stop.code or 0)


def test_every_command_is_tried():
    assert set(COMMANDS) == {words.split()[1] for words, _ in commands()}


@pytest.mark.parametrize("words", [f"{name} {words}" for name, tried in COMMANDS.items() for words in tried])
def test_no_command_changes_or_deletes_a_file_that_was_there(given, tmp_path, monkeypatch, words):
    before = contents(given, GIVEN)
    (tmp_path / "link").symlink_to(given)
    inputs = words.replace("=", " ").replace(":", " ").split()
    own = [name for name in GIVEN if name in inputs] if re.search("OUT|DIR", words) else []
    others = ["notes.txt", "x.json", "ds/participants.tsv"] if "OUT" in words else []
    folders = ["notes.txt", "ds", "old", "."] if "DIR" in words else []
    forced = "--force" not in inputs and inputs[0] not in ("cohort", "run")  # which the user may say of other files
    attacks = [
        *itertools.product(own, SPELLINGS, ["", " --force"] if forced else [""]),
        *itertools.product(folders, SPELLINGS, [""]),
        *itertools.product(others, SPELLINGS[:1], [""]),
    ]
    for target, spelling, force in attacks:
        place = spelling.format(target, link=tmp_path / "link")
        attack = re.sub(r"OUT[.\w]*|DIR", place, words) + force
        assert run(attack, given, monkeypatch) != 0, attack
        assert contents(given, GIVEN) == before, attack
    fresh = f"{tmp_path}/fresh"
    allowed = words.replace("fresh.", f"{fresh}.").replace("other.", f"{fresh}-other.")
    if inputs[0] != "run":  # which the integration tests run
        assert run(re.sub("OUT|DIR", fresh, allowed), given, monkeypatch) in (0, 1)
    assert contents(given, GIVEN) == before, allowed


def test_an_uncertified_mesh_gets_another_name_and_an_earlier_one_stays_with_its_certificate(tmp_path, monkeypatch):
    write_surface(ball_surface(3, 14.0), tmp_path / "a.surf.gii")
    mesh = "mesh a.surf.gii --cell-size 5 -o x.pts --page x.html"
    assert run(mesh, tmp_path, monkeypatch) == 0
    (tmp_path / "strict.yaml").write_text("certify:\n  q_max: 0.01\n")
    (tmp_path / "mine.pts").write_text("mine")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.name != MANIFEST}
    assert {"x.pts", "x.elem", "x.lon", "x.pts.json", "x.meshed.surf.gii"} <= {path.name for path in before}
    for name in ("x", "mine"):
        strict = f"mesh a.surf.gii --cell-size 5 --config strict.yaml -o {name}.pts --force"
        assert run(strict, tmp_path, monkeypatch) == 1
        assert json.loads((tmp_path / f"{name}_uncertified.certificate.json").read_text())["certified"] is False
    assert {path: path.read_bytes() for path in before} == before
    made = {f"{name}_uncertified{end}" for name in ("x", "mine") for end in (".certificate.json", ".meshed.surf.gii")}
    assert {path.name for path in tmp_path.iterdir()} == {*(path.name for path in before), *made, MANIFEST}
    assert run("mesh a.surf.gii --cell-size 5 -o x.pts", tmp_path, monkeypatch) == 0
    assert not [*tmp_path.glob("x_uncertified*")]


@pytest.fixture(scope="module")
def mesh_of_a_ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("meshed")
    write_surface(ball_surface(3, 14.0), folder / "a.surf.gii")
    (folder / "fold.yaml").write_text("fold: {force: true}\n")
    with pytest.MonkeyPatch.context() as patch:
        assert run("mesh a.surf.gii --cell-size 5 -o x.vtu", folder, patch) == 0
    return folder


@pytest.fixture
def meshed(mesh_of_a_ball: Path, tmp_path: Path) -> Path:
    """A folder with a mesh of cortet's."""
    return shutil.copytree(mesh_of_a_ball, tmp_path, dirs_exist_ok=True)


@pytest.fixture(scope="module")
def fold_of_a_ball(mesh_of_a_ball: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What nobody has edited is made again."""
    folder = shutil.copytree(mesh_of_a_ball, tmp_path_factory.mktemp("folded"), dirs_exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        assert [run(FOLD, folder, patch) for _ in range(2)] == [0, 0]
    return folder


#: a file that the user has edited beside a mesh of cortet's, and a command that would write over it or an input
REFUSED = [
    *(
        ("", f"certify x.vtu -o {output}{force}")  # which its sidecar names
        for output in ("x.meshed.surf.gii", "x.vtu.json", "x.vtu")
        for force in ("", " --force")
    ),
    *(
        (edited, "mesh a.surf.gii --cell-size 5 -o x.vtu")
        for edited in ("x.certificate.json", "x.vtu.json", "x.meshed.surf.gii")
    ),
    *(
        ("", f"mesh a.surf.gii --cell-size 5 -o y.vtu --page {page}")  # two outputs of one name
        for page in ("y.vtu.json", "y.meshed.surf.gii", "y.certificate.json", "y.vtu", "z/../y.vtu")
    ),
]


@pytest.mark.parametrize(("edited", "words"), REFUSED)
def test_what_would_be_lost_stays(meshed, monkeypatch, edited, words):
    (meshed / "z").mkdir()
    if edited:
        (meshed / edited).write_text("mine")
    before = contents(meshed)
    assert run(words, meshed, monkeypatch) == 1
    assert contents(meshed) == before


def test_a_file_that_the_configuration_names_is_an_input(tmp_path, monkeypatch):
    for number, name in ((3, "x"), (4, "common")):
        surface, sphere = phantom_with_sphere(24.0, subdivisions=number)
        write_surface(surface, tmp_path / f"{name}.surf.gii")
        write_surface(sphere, tmp_path / f"{name}.sphere.gii")
    (tmp_path / "c.yaml").write_text(f"resample:\n  template: {tmp_path}/common.sphere.gii\n")
    before = (tmp_path / "common.sphere.gii").read_bytes()
    words = "mesh x.surf.gii --sphere x.sphere.gii --cell-size 5 --config c.yaml --force -o y.vtu --picture "
    assert run(words + "common.sphere.gii", tmp_path, monkeypatch) != 0
    assert (tmp_path / "common.sphere.gii").read_bytes() == before


@pytest.mark.parametrize(
    "other", ["a.surf.gii --cell-size 4", "a.surf.gii --cell-size 5 --config other.yaml", "b.surf.gii --cell-size 5"]
)
def test_another_mesh_takes_the_certificate_of_none(meshed, monkeypatch, other):
    """Of another cell size, of other parameters, of another surface."""
    write_surface(ball_surface(3, 15.0), meshed / "b.surf.gii")
    (meshed / "other.yaml").write_text("generate: {seed: 3}")
    before = contents(meshed)
    assert run(f"mesh {other} -o x.msh", meshed, monkeypatch) == 1
    assert contents(meshed) == before
    assert run(f"mesh {other} -o x.vtu", meshed, monkeypatch) == 0, "its own companions it may replace"
    assert run(f"mesh {other} -o x.msh", meshed, monkeypatch) == 0, "the same mesh in another format shares them"
    assert run("certify x.vtu", meshed, monkeypatch) == run("certify x.msh", meshed, monkeypatch) == 0


@pytest.mark.parametrize("last", ["x.certificate.json", "x.meshed.surf.gii", "x.vtu.json", "x.vtu", "x.png"])
def test_a_command_that_was_killed_is_started_again(tmp_path, monkeypatch, last):
    class Killed(BaseException):
        pass

    def replace_then_die(path: Path, target: Path) -> Path:
        result = replace(path, target)
        if Path(target).absolute() == tmp_path / last:
            raise Killed
        return result

    write_surface(ball_surface(3, 14.0), tmp_path / "a.surf.gii")
    replace = Path.replace
    words = "mesh a.surf.gii --cell-size 5 -o x.vtu --picture x.png"
    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", replace_then_die)
        with pytest.raises(Killed):
            run(words, tmp_path, patched)
    assert (tmp_path / last).exists()
    assert run(words, tmp_path, monkeypatch) == 0


@pytest.mark.parametrize("name", ["config.yaml", "cohort.tsv"])
def test_a_working_folder_of_others_is_left_alone(given, tmp_path, monkeypatch, name):
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / name).write_text("mine")
    words = f"run {given}/ds {tmp_path}/out participant --dry-run --work-dir {tmp_path}/"
    assert run(words + "work", tmp_path, monkeypatch) == 1
    assert (tmp_path / "work" / name).read_text() == "mine"
    if name == "config.yaml":  # once is enough: Snakemake plans
        for _ in range(2):
            assert run(words + "fresh", tmp_path, monkeypatch) == 0


@pytest.mark.parametrize("name", ["fold.tsv", "verdict.json", "folding.svg", "frames/frame_0001.vtu"])
def test_a_file_of_a_fold_that_was_edited_is_kept(fold_of_a_ball, tmp_path, monkeypatch, name):
    shutil.copytree(fold_of_a_ball, tmp_path, dirs_exist_ok=True)
    (tmp_path / "f" / name).write_text("edited")
    before = contents(tmp_path / "f")
    assert run(FOLD, tmp_path, monkeypatch) == 1
    assert contents(tmp_path / "f") == before
