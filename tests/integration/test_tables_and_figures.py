"""The experiments run on any cohort; a mesher or a case that fails is told in the tables and stops nothing."""

from __future__ import annotations

import csv
import os
import shutil
import zipfile
from pathlib import Path

import pytest

from tests.integration.study import Study, surface, twice

pytestmark = pytest.mark.thorough

SETTINGS = ("cgal", "published")
REPORT = "derivatives/cortet/cohort/report.zip"


def rows(study: Study, table: str) -> list[dict[str, str]]:
    path = study.folder / f"derivatives/cortet/cohort/table-{table}.tsv"
    with path.open(newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def ablation(study: Study) -> dict[tuple[str, str, str], dict[str, str]]:
    """Rows of this cohort by mesher, setting and stages."""
    ours = [row for row in rows(study, "ablation") if row["source"] == "this cohort"]
    return {(row["mesher"], row["setting"], row["stages"]): row for row in ours}


@pytest.fixture(scope="module")
def compared(finished: Study, tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Two cases, their tables, figures and report; one of the meshers compared with cannot be imported."""
    folder = tmp_path_factory.mktemp("compared") / "study"
    shutil.copytree(finished.folder, folder)
    (folder / "netgen.py").write_text("raise ModuleNotFoundError(\"No module named 'netgen'\")")
    study = Study(folder)
    study.config["experiments"] = {
        "settings": ["default", "cgal", "published"],
        "ablation": {"meshers": ["cgal", "tetgen", "netgen"]},
        "resolution": {"cases": 1, "cell_size": [4.0, 6.0]},
        "measures": {"cases": 1},
        "series": {"cases": 1},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
        result = study.run("tables", "figures")
        assert result.returncode == 0, result.stdout + result.stderr
        result = study.run("--report", REPORT, "--", "cohort", "tables", "figures")
    assert result.returncode == 0, result.stdout + result.stderr
    return study


@pytest.fixture
def study(compared: Study, tmp_path: Path) -> Study:
    shutil.copytree(compared.folder, tmp_path / "study")
    return Study(tmp_path / "study", compared.config)


def test_every_stage_is_measured_in_each_setting_on_the_meshes_of_its_mesher(compared):
    measured = ablation(compared)
    for mesher in ("cgal", "tetgen"):
        assert (mesher, "n/a", "S1-S2") in measured
        assert {(mesher, setting, stages) for setting in SETTINGS for stages in ("S1-S3", "S1-S4")} <= set(measured)
        assert (mesher, "cgal", "S1-S4+") in measured and (mesher, "published", "S1-S4+") not in measured
    assert ("lattice", "default", "S1-S4+") in measured and ("tetgen", "default", "S1-S4+") in measured
    assert not [key for key in measured if key[:2] in (("lattice", "published"), ("cgal", "default"))]
    assert {row["meshes"] for (mesher, *_), row in measured.items() if mesher != "netgen"} == {"2"}


def test_a_mesher_that_is_not_installed_is_a_row_that_says_so(compared):
    row = ablation(compared)["netgen", "n/a", "S1-S2"]
    assert (row["meshes"], row["failed"], row["q_max_median"]) == ("0", "2", "n/a")
    assert "No module named 'netgen'" in row["remarks"]


def test_figures_and_tables_are_written_in_every_form_and_shown_in_the_report(compared):
    figures = ("figure-cohort", "figure-pooled-quality_res-4000um", "figure-series")
    for figure in figures:
        assert {path.suffix for path in compared.files(f"{figure}.*")} == {".svg", ".pdf", ".png"}
    for table in ("table-ablation", "table-resolution", "table-measures"):
        assert {path.suffix for path in compared.files(f"{table}.*")} == {".tsv", ".json", ".tex"}
    with zipfile.ZipFile(compared.folder / REPORT) as archive:
        names = {Path(name).name for name in archive.namelist()}
    assert {"report.html", *(f"{figure}.svg" for figure in figures)} <= names


def test_a_second_run_does_nothing_and_a_new_row_runs_its_case_and_the_tables(study):
    assert study.jobs_of_run("tables") == set()
    study.add_case(study.case("c"), surface(2))
    ran = study.jobs_of_run("derivatives/cortet/cohort/table-ablation.tsv")
    assert {case for _, case in ran} == {"sub-c", "-"}
    assert ("tables", "-") in ran and ("baseline", "sub-c") in ran
    assert ablation(study)["tetgen", "published", "S1-S4"]["meshes"] == "3"


def test_a_bad_case_is_told_in_the_table_and_stops_nothing(study):
    study.add_case(study.case("double"), twice(surface(3)))
    study.jobs_of_run("tables", succeeds=False)
    row = ablation(study)["cgal", "published", "S1-S4"]
    assert (row["meshes"], row["failed"]) == ("2", "1")
    assert "sub-double_hemi-L: gate:" in row["remarks"]
    archived = study.run("--report", REPORT, "--", "cohort", "tables")
    assert archived.returncode == 0, archived.stdout + archived.stderr
