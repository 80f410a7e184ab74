"""Only what changed runs again; one bad case never stops the others; a killed job leaves nothing half done."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from cortet.cohort.app import CHOSEN
from cortet.cohort.failures import write_failure
from cortet.cohort.jobs import Jobs
from cortet.cohort.lock import NAME
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.hashing import sha256
from cortet.over_all import RUN, last_run, report
from tests.integration.study import ROOT, STATUS, Study, scaled, surface, twice
from tests.integration.test_faults import sabotaged, wait_for

COHORT = {("cohort_tables", "-"), ("cohort_page", "-")}
FROM_CLEAN = {"clean", "reconnect", "solver_ready", "case_page", "export"}
FROM_GATE = {"gate", "smooth_surface", "generate"} | FROM_CLEAN


def jobs(rules: set[str], *participants: str) -> set[tuple[str, str]]:
    return {(rule, f"sub-{participant}") for rule in rules for participant in participants}


def test_the_first_run_certifies_and_exports_every_case(finished):
    assert {row["state"] for row in finished.status().values()} == {"certified"}
    assert len(finished.files("*_sets.vtu")) == 2


def test_nothing_reruns_after_a_fresh_checkout_with_every_file_touched(study):
    checkout = checked_out(study.folder / "checkout")
    for path in study.folder.rglob("*"):
        if path.is_file() and ".snakemake" not in path.parts:
            path.touch()
    assert study.jobs_of_run("--snakefile", str(checkout / "Snakefile")) == set()
    assert not list(study.outputs.rglob("outdated"))
    assert study.run("--touch").returncode == 0
    assert study.planned_jobs() == set()
    assert study.planned_jobs("--forceall") >= jobs(FROM_GATE, "a", "b") | COHORT


def test_a_report_leaves_out_certificates_that_it_cannot_believe(study):
    table = study.outputs / "cohort/cohort_quality.tsv"
    before = table.read_bytes()
    report(study.outputs)
    assert table.read_bytes() == before
    (file,) = study.files("sub-b*_certificate.json")
    content = json.loads(file.read_text())
    content["checks"].pop()
    file.write_text(json.dumps(content))
    (page,) = (study.logs / "case_page").rglob("sub-b*.log")
    wildcards = {"folder": "sub-b", "case": "sub-b_hemi-L", "res": "4000", "mesher": "lattice", "setting": ""}
    with last_run(study.outputs) as (plan, _):
        made_from = Jobs(plan).made_from("case_page", wildcards)
    write_failure(
        page, "case_page", wildcards, made_from, CortetError("KeyError: checks")
    )  # as the job that reads it leaves one
    report(study.outputs)
    assert study.status()["sub-b_hemi-L"]["state"] == "unfinished" and "sub-b" not in table.read_text()


@pytest.mark.parametrize("edited", ["certificate", "certificate of another", "mesh", "older mesh", "both of another"])
def test_an_edited_certificate_or_mesh_costs_no_finished_work(study, edited):
    """The next run refused it, after Snakemake had deleted the files for solvers; or exported another case's mesh."""
    end = "Ordered_tetmesh.vtu" if edited.endswith("mesh") else "Solver_certificate.json"
    (file,), (other,), (export,) = map(study.files, (f"sub-a*{end}", f"sub-b*{end}", "sub-a*Solver_sets.vtu"))
    if edited == "certificate":
        content = json.loads(file.read_text())
        content["checks"].pop()
        file.write_text(json.dumps(content))
    else:
        shutil.copy(other, file)
    if edited == "older mesh":
        os.utime(file, (1e9, 1e9))
    before = sha256(export)
    if edited == "both of another":
        shutil.copy(*(study.files(f"sub-{name}*Ordered_tetmesh.vtu")[0] for name in "ba"))
    assert study.planned_jobs("meshes", "cohort_tables") <= COHORT
    if edited == "both of another":
        done = study.run("--forcerun", "export", "--", "meshes")
        assert done.returncode != 0 and "was made from another surface" in done.stdout + done.stderr
        assert not export.exists()
    report(study.outputs)
    row = study.status()["sub-a_hemi-L"]
    assert row["state"] == "unfinished" and "--forcerun solver_ready" in row["reason"]
    remade = study.jobs_of_run("--forcerun", "solver_ready", "--", "meshes")
    assert ("solver_ready", "sub-a") in remade and ("export", "sub-a") in remade
    report(study.outputs)
    assert study.status()["sub-a_hemi-L"]["state"] == "certified" and sha256(export) == before


@pytest.mark.parametrize(
    ("deleted", "rule"),
    [
        ("Solver_certificate.json", "solver_ready"),
        ("Ordered_tetmesh.vtu", "solver_ready"),
        ("Solver_sets.vtu", "export"),
        ("Solver_sets.vtu.json", "export"),
    ],
)
def test_a_result_that_was_deleted_is_made_again_even_for_the_tables_alone(study, deleted, rule):
    (file,) = study.files(f"sub-a*{deleted}")
    file.unlink()
    report(study.outputs)
    assert study.status()["sub-a_hemi-L"]["state"] == "unfinished"
    assert (rule, "sub-a") in study.planned_jobs("cohort_tables")


def test_the_table_sees_what_no_job_has_remade(study):
    """A stage that was switched off, a mesh without its record and a damaged export were all certified."""

    def state() -> str:
        report(study.outputs)
        return study.status()["sub-a_hemi-L"]["state"]

    assert state() == "certified"
    (export,) = study.files("sub-a*Solver_sets.vtu")
    whole = export.read_bytes()
    export.write_bytes(whole[:3000])
    assert state() == "unfinished" and "was changed" in study.status()["sub-a_hemi-L"]["reason"]
    export.write_bytes(whole)
    assert state() == "certified"
    (record,) = study.files("sub-a*Ordered_tetmesh.json")
    aside = record.rename(record.with_suffix(".aside"))
    assert state() == "unfinished"
    aside.rename(record)
    run = study.outputs / RUN
    recorded = json.loads(run.read_text())
    recorded["config"]["reconnect"] = {"enabled": False}
    run.write_text(json.dumps(recorded))
    pages = {page: page.read_bytes() for page in study.files("*_report.html")}
    assert state() == "unfinished" and "solver_ready" in study.status()["sub-a_hemi-L"]["reason"]
    assert pages and {page: page.read_bytes() for page in pages} == pages, "of the meshes that are there"


def test_a_new_row_runs_one_case_and_the_tables(study):
    study.add_case(study.case("c"), surface(2))
    assert study.planned_jobs() == jobs(FROM_GATE, "c") | COHORT


def test_a_surface_replaced_by_an_older_file_reruns_its_case_and_the_former_mesh_is_kept(study):
    path = study.folder / "surfaces/a.surf.gii"
    former = sha256(path)
    scaled(path, 1.05)
    os.utime(path, (1e9, 1e9))  # as `cp -p`, `mv` and `rsync -a` leave it
    assert study.planned_jobs() == jobs(FROM_GATE, "a") | COHORT
    (certificate,) = study.files("sub-a*certificate.json")
    assert ("gate", "sub-a") in study.jobs_of_run(str(certificate.relative_to(study.folder)))
    made_from = [json.loads(one.read_text())["input"]["sha256"] for one in (certificate, study.outdated("a"))]
    assert made_from == [sha256(path), former]


def test_a_copy_of_a_surface_under_another_name_reruns_nothing_until_it_changes(study):
    """It is newer than what was made of the same content, and its case was meshed again."""
    first, second = study.cases()
    copy = study.folder / "surfaces/copy.surf.gii"
    shutil.copy(first.surface, copy)
    study.write_cases([replace(first, surface=copy), second])
    assert study.planned_jobs() <= COHORT
    scaled(copy, 1.05)
    assert study.planned_jobs() == jobs(FROM_GATE, "a") | COHORT


def test_a_mesh_whose_reports_say_other_settings_is_not_certified_as_if_it_had_the_new_ones(study):
    """After `--touch`, `--forcerun solver_ready` wrote a certificate with settings that S4 had not had."""
    study.write_cases(study.cases()[:1])
    study.config["clean"] = {"thresholds": [0.6]}
    assert study.run("--touch").returncode == 0
    assert study.planned_jobs() == set()
    done = study.run("--forcerun", "solver_ready", "--", "meshes")
    assert done.returncode != 0 and "--forcerun clean" in done.stdout + done.stderr
    row = study.status()["sub-a_hemi-L"]
    assert row["state"] == "failed" and "--forcerun clean" in row["reason"]
    assert study.run("--forcerun", "clean", "--", "meshes").returncode == 0
    report(study.outputs)
    assert study.status()["sub-a_hemi-L"]["state"] == "certified"


def test_a_moved_study_reruns_nothing(study):
    study.folder = study.folder.rename(study.folder.with_name("moved"))
    shutil.rmtree(study.folder / ".snakemake")
    assert study.planned_jobs() <= COHORT


def test_from_another_working_folder_results_are_trusted_and_the_table_marks_those_of_other_settings(study):
    """Snakemake remembers parameters where it is started; the certificate has them, too."""
    elsewhere = Study(study.folder / "elsewhere")
    elsewhere.folder.mkdir()
    elsewhere.config |= {"cohort": {"sheet": "../cohort.tsv"}, "output": "../derivatives/cortet"}
    assert not {job for job in elsewhere.planned_jobs() if job not in COHORT}
    elsewhere.config["clean"] = {"thresholds": [0.6]}
    done = elsewhere.run("--forcerun", "cohort_tables")
    assert done.returncode == 0 and "2 cases: 2 unfinished" in done.stdout
    for row in study.status().values():
        assert (row["state"], row["stage"]) == ("unfinished", "clean") and "--forcerun clean" in row["reason"]
        assert row["reason"].endswith("/mesh"), "the earlier results are named"
    assert elsewhere.run("--forcerun", "clean", "--", f"../{STATUS}").returncode == 0
    assert {row["state"] for row in study.status().values()} == {"certified"}


def test_a_configuration_with_a_section_twice_is_refused(study):
    study.command()
    with (study.folder / "config.yaml").open("a") as file:
        file.write("clean:\n  thresholds: [0.6]\nclean:\n  boundary: fixed\n")
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores", "1", "--dry-run"]
    result = subprocess.run(command, cwd=study.folder, capture_output=True, text=True, check=False)
    assert result.returncode != 0 and "key clean appears twice" in result.stdout + result.stderr


def test_after_a_dry_run_with_other_parameters_a_report_says_what_the_last_run_asked_for(study):
    study.config["clean"] = {"thresholds": [0.6]}
    assert ("clean", "sub-a") in study.planned_jobs()
    command = [sys.executable, "-m", "cortet.cli", "cohort", "report", "derivatives/cortet"]
    subprocess.run(command, cwd=study.folder, capture_output=True, check=True)
    assert {row["state"] for row in study.status().values()} == {"certified"}


def test_an_output_folder_of_others_is_left_alone(study):
    foreign = study.folder / "other"
    foreign.mkdir()
    (foreign / "dataset_description.json").write_text('{"Name": "mine", "BIDSVersion": "1.9.0"}')
    study.config["output"] = "other"
    result = study.run()
    assert result.returncode != 0 and "was not written by cortet" in result.stdout + result.stderr
    assert [path.name for path in foreign.iterdir()] == ["dataset_description.json"]


def test_a_changed_threshold_of_s4_reruns_s4_onwards(study):
    study.config["clean"] = {"thresholds": [0.6, 0.4]}
    assert study.planned_jobs() == jobs(FROM_CLEAN, "a", "b") | COHORT


def test_a_raised_version_of_s4_reruns_s4_onwards(study):
    checkout = checked_out(study.folder / "checkout")
    module = checkout / "cortet/stages/clean.py"
    module.write_text(re.sub(r"VERSION: int = \d+", "VERSION: int = 1000", module.read_text()))
    assert study.planned_jobs(project=checkout) == jobs(FROM_CLEAN, "a", "b") | COHORT


def test_a_bypassed_stage_does_not_occur(study):
    study.config["clean"] = {"enabled": False}
    assert study.planned_jobs() == jobs(FROM_CLEAN - {"clean"}, "a", "b") | COHORT


def test_bad_cases_do_not_stop_the_others_and_nothing_of_an_earlier_run_passes_for_this_one(study):
    became_bad = study.folder / "surfaces/b.surf.gii"
    (certificate,) = study.files("sub-b/**/*certificate.json")
    before = sha256(certificate)
    write_surface(twice(read_surface(became_bad)), became_bad)
    study.add_case(study.case("double"), twice(surface(3)))
    study.add_case(study.case("truncated"), surface(4))
    truncated = study.folder / "surfaces/truncated.surf.gii"
    truncated.write_bytes(truncated.read_bytes()[:2000])
    study.add_case(study.case("missing"), surface(5))
    (study.folder / "surfaces/missing.surf.gii").unlink()
    study.add_case(study.case("good"), surface(6))
    study.add_case(study.case("right"), surface(7))
    named = study.folder / "surfaces/right.surf.gii"
    said = "<MetaData><MD><Name>AnatomicalStructurePrimary</Name><Value>CortexRight</Value></MD></MetaData>"
    named.write_text(re.sub("<MetaData ?/>", said, named.read_text(), count=1))

    bad = jobs({"gate"}, "b", "double", "truncated", "missing", "right")
    assert study.jobs_of_run(succeeds=False) == bad | jobs(FROM_GATE, "good")
    status = {case.removeprefix("sub-").removesuffix("_hemi-L"): row for case, row in study.status().items()}
    assert {name: row["state"] for name, row in status.items()} == {
        "a": "certified",
        "b": "failed",
        "good": "certified",
        "double": "failed",
        "truncated": "failed",
        "missing": "failed",
        "right": "failed",
    }
    assert {status[name]["stage"] for name in ("double", "truncated", "missing")} == {"gate"}
    assert "2 separate pieces" in status["double"]["reason"]
    assert "surfaces/missing.surf.gii" in status["missing"]["reason"]
    assert "right.surf.gii: is hemisphere R" in status["right"]["reason"]
    failure = json.loads((study.outputs / status["double"]["log"]).with_suffix(".failure.json").read_text())
    assert failure["stage"] == "gate" and "2 separate pieces" in failure["reason"] and failure["remedy"]
    assert "7 cases: 2 certified (2 with repaired surfaces or relaxed limits), 5 failed" in study.said
    assert study.results("b") == {"report.html", "thumbnail.webp"}, "of its failure"
    assert sha256(study.outdated("b")) == before, "what was made before is kept"
    (page,) = study.files("sub-b/mesh/*report.html")
    assert "What went wrong" in page.read_text() and "2 separate pieces" in page.read_text()
    assert "sub-b/outdated" in page.read_text() and "sub-b/outdated" in status["b"]["reason"]
    assert "sub-b" not in (study.outputs / "cohort/cohort_quality.tsv").read_text()

    study.run("meshes")
    assert not [*study.outputs.glob("sub-double/outdated")], "the page of a failure is no earlier result"
    write_surface(surface(3), study.folder / "surfaces/double.surf.gii")
    write_surface(surface(1), became_bad)
    cases = [case for case in study.cases() if case.participant not in ("truncated", "missing", "right")]
    study.write_cases(cases)
    assert study.planned_jobs() == jobs(FROM_GATE, "b", "double") | COHORT


def test_an_uncertified_mesh_is_measured_but_not_exported(study):
    study.write_cases(study.cases()[:1])
    study.config["certify"] = {"q_max": 0.01}
    ran = study.jobs_of_run(succeeds=False)
    assert ran == jobs({"solver_ready", "case_page", "export"}, "a")
    assert [row["state"] for row in study.status().values()] == ["uncertified"]
    assert "worst q" in study.status()["sub-a_hemi-L"]["reason"]
    assert not study.files("sub-a*_sets.vtu")
    limits = study.config.pop("certify")
    assert study.run("--touch").returncode == 0
    report(study.outputs)
    assert "forcerun solver_ready" in study.status()["sub-a_hemi-L"]["reason"], "of limits that hold no more"
    study.config |= {"certify": limits, "export": {"uncertified": True}}
    ran = study.jobs_of_run()
    assert ran - COHORT == jobs({"solver_ready", "verdict", "export", "case_page"}, "a"), "a page links the exports"
    assert ran >= COHORT
    (written,) = study.files("sub-a*_sets.vtu")
    assert written.name == "sub-a_hemi-L_res-4000um_desc-latticeUncertified_sets.vtu"
    (page,) = study.files("sub-a*report.html")
    assert written.name in page.read_text() and "Solver_sets" not in page.read_text()
    assert study.planned_jobs() == set()
    study.config.pop("certify")
    study.jobs_of_run()
    (written,) = study.files("sub-a*_sets.vtu")
    assert written.name.endswith("Solver_sets.vtu"), "the former moved to `outdated`"


def test_a_run_of_some_cases_exports_its_uncertified_meshes_at_once(study):
    """`cortet run --participant-label` named its files before the verdict, and refused the mesh under that name."""
    study.config |= {"certify": {"q_max": 0.01}, "export": {"uncertified": True}}
    done = study.run("participants", env=os.environ | {CHOSEN: "sub-a_hemi-L"})
    assert done.returncode == 0, done.stdout
    (written,) = study.files("*Uncertified_sets.vtu")
    assert written.name.startswith("sub-a")


def test_a_bad_sheet_stops_the_run_before_it_begins(study):
    with (study.folder / "cohort.tsv").open("a") as sheet:
        sheet.write("sub-x\tn/a\tL\tforty\tx.surf.gii\tyes\tn/a\n")
    result = study.run()
    assert result.returncode != 0
    assert "line 4, column scan_age: 'forty'" in result.stdout + result.stderr


@pytest.mark.parametrize("killed", ["everything", "the job"])
def test_kill_9_leaves_no_partial_file_and_the_next_run_completes(study, killed):
    study.write_cases(study.cases()[:1])
    (certificate,) = study.files("sub-a*certificate.json")
    certificate.unlink()
    what = "wait" if killed == "everything" else "kill"
    run = subprocess.Popen(
        study.command(STATUS),
        cwd=study.folder,
        env=sabotaged(study, **{what: [("solver_ready", "sub-a")]}),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    if killed == "everything":
        mesh = certificate.name.replace("Solver_certificate.json", "Ordered_tetmesh.vtu")
        wait_for(study.folder / f"sabotage/wait-solver_ready-{mesh}", run)
        os.killpg(run.pid, signal.SIGKILL)
    assert run.wait() != 0
    assert not certificate.exists()
    (row,) = study.status().values()
    if killed == "everything":
        assert row["state"] == "unfinished"
    else:
        assert (row["stage"], row["state"]) == ("solver_ready", "failed") and "killed" in row["reason"]
        assert not study.files("sub-a/mesh/*Solver_sets.vtu")
        assert len([*study.outputs.glob("sub-a/outdated/*/*Solver_sets.vtu")]) == 1
    assert study.jobs_of_run(STATUS)
    assert {row["state"] for row in study.status().values()} == {"certified"}
    hidden = {path.name for path in study.files(".*")}
    assert hidden <= {".bidsignore", NAME}


@pytest.mark.parametrize("error", [None, CortetError("the disk is full")])
def test_a_job_that_was_killed_while_it_made_again_what_is_there_costs_no_finished_work(study, error):
    """The next run had nothing to do, called the case failed, and moved its certified files away."""
    (log,) = (study.logs / "reconnect").rglob("sub-a*.log")
    wildcards = {"folder": "sub-a", "case": "sub-a_hemi-L", "res": "4000", "mesher": "lattice", "setting": ""}
    with last_run(study.outputs) as (plan, _):
        made_from = Jobs(plan).made_from("reconnect", wildcards)
    write_failure(log, "reconnect", wildcards, made_from, error)
    report(study.outputs)
    assert study.status()["sub-a_hemi-L"]["state"] == ("failed" if error else "certified")
    assert bool(study.files("sub-a*Solver_sets.vtu")) is (error is None)


def checked_out(folder: Path) -> Path:
    """A copy of the project."""
    folder.mkdir()
    for name in ("rules", "scripts", "cortet", "envs", "reports", "profiles"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", folder)
    return folder


def test_files_that_vanished_beside_an_export_are_named(study):
    study.write_cases(study.cases()[:1])
    study.config["export"] = {"formats": ["fenics"]}
    study.jobs_of_run("meshes")
    (mesh,) = (file for file in study.files("sub-a*.xdmf") if "_facets" not in file.name)
    mesh.with_suffix(".h5").unlink()
    done = study.run("--dry-run", "meshes")
    assert f"{mesh.stem}.h5 is missing" in done.stdout + done.stderr
    mesh.unlink()
    assert study.jobs_of_run("meshes") == {("export", "sub-a")}
    assert mesh.with_suffix(".h5").exists()
