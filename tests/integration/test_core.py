"""The core stands alone: a copy of the package without its neighbours meshes surfaces and plans a cohort."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cortet.cohort.sheet import PHANTOM, Case, write_sheet
from cortet.neighbours import neighbours
from tests.integration import loaded_snakemake
from tests.integration.study import CONFIG, ROOT

pytestmark = pytest.mark.thorough

NAMES = [neighbour.name for neighbour in neighbours()]
CALLS = """
import cortet
from cortet.phantoms import phantom
made = cortet.mesh(phantom(24.0, subdivisions=4), 4.0, ga=24)
print(len(made.mesh.cells), made.certificate.certified)
made.save("a.vtu", force=True)
"""
PARTS = """
import pkgutil, cortet
for found in pkgutil.walk_packages(cortet.__path__, "cortet."):
    if not found.name.endswith("__main__"):
        __import__(found.name)
print(cortet.__all__)
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project without the neighbours."""
    project = tmp_path_factory.mktemp("core")
    hidden = shutil.ignore_patterns("__pycache__", *(name for one in NAMES for name in (one, f"{one}.smk")))
    for name in ("cortet", "rules", "scripts", "envs", "profiles", "reports"):
        shutil.copytree(ROOT / name, project / name, ignore=hidden)
    shutil.copy(ROOT / "Snakefile", project)
    shutil.copy(ROOT / "config.yaml", project)
    return project


def run(core: Path, folder: Path, *arguments: str) -> str:
    """What a command of Python says that sees only the core."""
    environment = {**os.environ, "PYTHONPATH": str(core)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_are_neighbours_and_the_copy_has_none(core: Path) -> None:
    assert NAMES == ["folding", "paper"]
    assert not any((core / "cortet" / name).exists() or (core / f"rules/{name}.smk").exists() for name in NAMES)


def test_every_module_of_the_core_can_be_imported(core: Path, tmp_path: Path) -> None:
    calls = run(core, tmp_path, "-c", PARTS)
    assert "'mesh'" in calls and "'fold'" not in calls


def test_a_surface_is_meshed_by_call_and_by_command(core: Path, tmp_path: Path) -> None:
    assert re.fullmatch(r"\d+ (True|False)\n", run(core, tmp_path, "-c", CALLS))
    assert "q" in run(core, tmp_path, "-m", "cortet.cli", "quality", "a.vtu")


def test_the_command_and_the_configuration_lack_what_neighbours_bring(core: Path, tmp_path: Path) -> None:
    told = run(core, tmp_path, "-m", "cortet.cli", "--help")
    assert re.search(r"^ +mesh ", told, re.MULTILINE) and not re.search(r"^ +(fold|growth|job) ", told, re.MULTILINE)
    sections = re.findall(r"^# (\w+):$", run(core, tmp_path, "-m", "cortet.cli", "config"), re.MULTILINE)
    assert {"generate", "certify", "export"} <= set(sections) and not {"fold", "experiments"} & set(sections)


def test_a_cohort_is_meshed_with_its_tables_and_pages(core: Path, tmp_path: Path) -> None:
    write_sheet([Case("a", None, "L", 26.0, PHANTOM)], tmp_path / "cohort.tsv")
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({**CONFIG, "phantom": {"subdivisions": 4}}))
    arguments = ["--snakefile", str(core / "Snakefile"), "--cores", "2"]
    done = loaded_snakemake.run(arguments, tmp_path, {**os.environ, "PYTHONPATH": str(core)})
    assert done.returncode == 0, done.stdout + done.stderr
    made = tmp_path / "derivatives/cortet"
    assert (made / "cohort/index.html").exists() and list(made.rglob("*_certificate.json"))
    assert not list(made.rglob("*fold*"))
