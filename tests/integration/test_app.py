"""The BIDS App as its users have it: the wheel, installed outside any checkout, on a dataset."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from shapes import ball_surface

from cortet.formats.gifti import write_surface
from tests.integration.study import CONFIG, ROOT, surface

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package from its wheel, and nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    tracked = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in tracked.splitlines():
        if (ROOT / name).is_file() and not name.startswith(("tests/", "docs/")):
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / "source" / name)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(folder / "source")]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = folder.glob("cortet-*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(folder / "site"), str(wheel)], check=True)
    shutil.rmtree(folder / "source")
    return folder / "site"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Two participants, of whom one has two sessions and the other a surface that no one can mesh."""
    folder = tmp_path / "bids"
    for number, name in enumerate(
        ("sub-01/ses-a/anat/sub-01_ses-a", "sub-01/ses-b/anat/sub-01_ses-b", "sub-02/anat/sub-02")
    ):
        path = folder / f"{name}_hemi-L_white.surf.gii"
        path.parent.mkdir(parents=True)
        write_surface(surface(number), path)
    sphere = folder / "sub-01/ses-a/anat/sub-01_ses-a_hemi-L_sphere.surf.gii"
    write_surface(ball_surface(3, radius=12.0), sphere)  # of the same triangles as `surface`
    path.write_text("no surface")
    (folder / "participants.tsv").write_text("participant_id\tscan_age\nsub-01\t24\nsub-02\t27\n")
    return folder


def run(installed: Path, *arguments: str, cwd: Path, **sections: Any) -> subprocess.CompletedProcess[str]:
    (cwd / "settings.yaml").write_text(
        json.dumps({"certify": CONFIG["certify"], "resample": {"subdivisions": 3}, **sections})
    )
    code = "import sys; from cortet.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "run", *arguments]
    options = ["--config", "settings.yaml", "--cell-size", "4", "--cores", "2"]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run([*command, *options], cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_participants_then_the_group_with_the_conventional_words(installed, dataset, tmp_path):
    one = run(
        installed, "bids", "out", "participant", "--participant-label", "sub-01", "--session-label", "a", cwd=tmp_path
    )
    assert one.returncode == 0, one.stdout + one.stderr
    out = tmp_path / "out"
    made = {path.name for path in out.rglob("sub-*_report.html")}
    assert made == {"sub-01_ses-a_hemi-L_res-4000um_desc-latticeSolver_report.html"}
    assert not (out / "cohort").exists()
    # without the page, which lists the files for solvers
    pages = {*out.rglob("*_report.html"), *out.rglob("*_thumbnail.webp")}
    before = {path: path.stat().st_mtime_ns for path in {*out.rglob("sub-01_ses-a*Solver*")} - pages}
    assert not list(out.rglob("*.mesh")) and len(list(out.rglob("*Solver_sets.vtu"))) == 1

    plan = run(installed, "bids", "out", "--dry-run", cwd=tmp_path).stdout.splitlines()
    assert "  sub-02_hemi-L  27 weeks  bids/sub-02/anat/sub-02_hemi-L_white.surf.gii" in plan
    assert any(re.fullmatch("  sub-02_hemi-L: gate, .*, solver_ready, .*export.*", line) for line in plan)
    assert not any(line.startswith("  sub-01_ses-a_hemi-L: ") for line in plan), "it is up to date"
    assert any(re.match("  over all cases: .*, cohort_page", line) for line in plan)

    group = run(installed, "bids", "out", "group", cwd=tmp_path)
    assert group.returncode == 0, group.stdout + group.stderr
    assert group.stdout.splitlines()[-2:] == [
        "no mesh yet: sub-01_ses-b_hemi-L, sub-02_hemi-L (run the participant level to make them)",
        "3 cases: 1 certified (1 with repaired surfaces or relaxed limits), 2 unfinished; open out/cohort/index.html; "
        "meshes: out/sub-*/**/mesh/*Solver_sets.vtu",
    ]
    assert len(list(out.rglob("*Solver_sets.vtu"))) == 1, "it makes no mesh"
    assert list((out / "cohort").glob("*hemi-L_desc-mean_maps.shape.gii")), "participant made the maps of the case"

    all_of_them = run(installed, "bids", "out", "participant", "group", "--formats", "vtu,inp", cwd=tmp_path)
    assert all_of_them.returncode == 1
    lines = all_of_them.stdout.splitlines()
    assert any(line.startswith("failed: sub-02_hemi-L in gate: ") for line in lines), "a line per case"
    assert (
        lines[-1].startswith("3 cases: 2 certified (2 with repaired surfaces or relaxed limits), 1 failed; ")
        and len(lines) < 12
    )
    assert {path: path.stat().st_mtime_ns for path in before} == before, "what was done is not done again"
    assert len(list(out.rglob("*Solver_tetmesh.inp"))) == 2
    states = [line.split("\t") for line in (out / "cohort/cohort_status.tsv").read_text().splitlines()]
    column = states[0].index("state")
    assert [row[column] for row in states[1:]] == ["certified", "certified", "failed"]

    linked = json.loads((out / "dataset_description.json").read_text())["DatasetLinks"]
    assert linked == {"raw": "../bids"}
    sidecars = [json.loads(path.read_text()) for path in out.rglob("anat/*.json")]
    uris = {uri for sidecar in sidecars for uri in (*sidecar["Sources"], sidecar["SpatialReference"])}
    assert "bids:raw:sub-01/ses-a/anat/sub-01_ses-a_hemi-L_white.surf.gii" in uris
    assert all((out / linked.get(name, ".") / path).exists() for name, path in (uri.split(":")[1:] for uri in uris))
    described = {line.split("\t")[0] for line in (out / "descriptions.tsv").read_text().splitlines()}
    in_use = {re.search("desc-[A-Za-z0-9]+", path.name) for path in out.glob("sub-*/**/*_desc-*")}
    assert {found[0] for found in in_use if found} <= described
    assert {path.suffix for path in (out / "logs").glob("CITATION.*")} == {".md", ".bib"}

    validator = Path(sys.executable).with_name("bids-validator-deno")
    checked = subprocess.run([validator, "--json", str(out)], capture_output=True, text=True, check=False)
    issues = json.loads(checked.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []

    out = out.rename(tmp_path / "moved")
    changed = {"clean": {"thresholds": [0.6]}}
    plan = run(installed, "bids", "moved", "--dry-run", cwd=tmp_path, **changed).stdout.splitlines()
    (line,) = [line for line in plan if line.startswith("  sub-01_ses-b_hemi-L: ")]
    assert "clean" in line and "generate" not in line, "it remembers the settings after a move"

    (tmp_path / "bids/sub-01/ses-a/anat/sub-01_ses-a_hemi-L_white.surf.gii").write_text("not a surface")
    again = run(
        installed, "bids", "moved", "participant", "--participant-label", "01", "--session-label", "a", cwd=tmp_path
    )
    assert again.returncode == 1
    states = [line.split("\t") for line in (out / "cohort/cohort_status.tsv").read_text().splitlines()]
    assert [row[column] for row in states[1:] if "ses-a" in row[0]] == ["failed"], "participant after group"
    assert "as GIfTI" in (out / "cohort/index.html").read_text()
