"""The cohort sheet: what a row means, and that every bad row is named with line, column, value and remedy."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cortet.cohort.scan import scan
from cortet.cohort.selection import ageless_notice, chosen, folded
from cortet.cohort.sheet import COLUMNS, Case, add_to_sheet, read_sheet, write_sheet
from cortet.cohort.surface_files import missing_surface
from cortet.config import Scan, load
from cortet.errors import InputError
from cortet.formats.gifti import read_surface

GOOD = "007\t01\tL\t27.5\tdata/a.surf.gii\tyes\tn/a"


def sheet(folder: Path, *rows: str, extra: str = "") -> Path:
    path = folder / "cohort.tsv"
    path.write_text("\t".join(COLUMNS) + extra + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_a_row_becomes_a_case_with_string_labels(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, GOOD))
    assert case == Case("007", "01", "L", 27.5, tmp_path / "data/a.surf.gii")
    assert case.name == "sub-007_ses-01_hemi-L"
    assert case.folder == "sub-007/ses-01"


def test_session_and_hemi_may_be_missing(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, "sub-007\tn/a\tn/a\t27.5\t/abs/a.surf.gii\tyes\tn/a"))
    assert (case.name, case.folder, case.surface) == ("sub-007", "sub-007", Path("/abs/a.surf.gii"))


def test_a_phantom_needs_no_file(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, "p\tn/a\tR\t30\tphantom\tyes\tn/a"))
    assert case.is_phantom


def test_further_columns_are_carried_through(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, GOOD + "\t1\tn/a", extra="\tscanner\tsite"))
    assert case.extra == {"scanner": "1", "site": "n/a"}


def test_unit_and_affine_are_those_of_the_row(tmp_path: Path) -> None:
    rows = (GOOD + "\tm\tn/a", GOOD.replace("007", "008") + "\tn/a\tt2.nii.gz")
    first, second = cases = read_sheet(sheet(tmp_path, *rows, extra="\tunit\taffine"))
    assert (first.unit, first.affine, second.unit, second.affine) == ("m", None, None, tmp_path / "t2.nii.gz")
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases
    with pytest.raises(InputError, match="column unit: 'inch' is not a unit"):
        read_sheet(sheet(tmp_path, GOOD + "\tinch", extra="\tunit"))


def test_a_row_may_have_a_cell_size_of_its_own(tmp_path: Path) -> None:
    rows = (GOOD + "\t1.001", GOOD.replace("007", "008") + "\tn/a")
    cases = read_sheet(sheet(tmp_path, *rows, extra="\tcell_size"))
    assert [case.cell_size for case in cases] == [1.001, None]
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases
    for wrong in ("0", "-1", "fine", "0.80001", "1e9", "nan"):
        with pytest.raises(InputError, match=rf"column cell_size: '{wrong}' is not a cell size \(use a number from"):
            read_sheet(sheet(tmp_path, GOOD + f"\t{wrong}", extra="\tcell_size"))


def test_fields_come_from_the_configured_pattern_and_the_row_has_the_last_word(tmp_path: Path) -> None:
    rows = (GOOD + "\tn/a", GOOD.replace("007", "008") + "\town.shape.gii")
    path = sheet(tmp_path, *rows, extra="\tfield_thickness")
    first, second = read_sheet(path, {"thickness": "t/{participant_id}.shape.gii", "curv": "c/{hemi}.shape.gii"})
    assert first.fields == {"curv": tmp_path / "c/L.shape.gii"}
    assert second.fields == {"thickness": tmp_path / "own.shape.gii", "curv": tmp_path / "c/L.shape.gii"}


def test_an_unknown_placeholder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="subject"):
        read_sheet(sheet(tmp_path, GOOD), {"thickness": "{subject}.shape.gii"})


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("00/7\t01\tL\t27\ta.gii\tyes\tn/a", "line 2, column participant_id: '00/7' is not a BIDS label"),
        ("n/a\t01\tL\t27\ta.gii\tyes\tn/a", "column participant_id: 'n/a'"),
        ("007\tses_1\tL\t27\ta.gii\tyes\tn/a", "column session_id: 'ses_1'"),
        ("007\t01\tleft-ish\t27\ta.gii\tyes\tn/a", "column hemi: 'left-ish' is not a hemisphere (use L, R"),
        ("007\t01\tL\t190\ta.gii\tyes\tn/a", "column scan_age: '190' is not an age in gestational weeks"),
        ("007\t01\tL\tnan\ta.gii\tyes\tn/a", "column scan_age: 'nan'"),
        ("007\t01\tL\tn/a\tphantom\tyes\tn/a", "column scan_age: 'n/a', but a phantom is made for an age"),
        ("007\t01\tL\told\ta.gii\tyes\tn/a", "n/a where the age is not known"),
        ("007\t01\tn/a\t27\tphantom\tyes\tn/a", "column hemi: 'n/a', but a phantom is one hemisphere"),
        ("007\t01\tL\t27\tn/a\tyes\tn/a", "column surface: 'n/a' names no file"),
        ("007\t01\tL\t27\t{x}.gii\tyes\tn/a", "column surface: '{x}.gii' cannot be a file name here"),
        ("007\t01\tL\t27\ta.gii\tmaybe\tn/a", "column include: 'maybe' is neither yes nor no (use yes or no)"),
        ("007\t01\tL\t27\ta.gii\tno\tn/a", "column exclude_reason: 'n/a' does not say why"),
        ("007\t01\tL\t27\ta.gii", "line 2, all columns: 5 values for 7 columns"),
    ],
)
def test_a_bad_row_is_named_with_line_column_value_and_remedy(tmp_path: Path, row: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        read_sheet(sheet(tmp_path, row))
    assert words in str(error.value)


def test_all_bad_rows_are_named_at_once(tmp_path: Path) -> None:
    rows = (GOOD, GOOD, GOOD.replace("007", "0 8"), GOOD.replace("27.5", "x").replace("007", "9"))
    with pytest.raises(InputError) as error:
        read_sheet(sheet(tmp_path, *rows))
    message = str(error.value)
    assert "3 problem(s)" in message
    assert "line 3, columns participant_id, session_id, hemi: sub-007_ses-01_hemi-L is already in line 2" in message
    assert "line 4, column participant_id: '0 8'" in message
    assert "line 5, column scan_age: 'x'" in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("participant_id,hemi\n1,L\n", "line 1: no column participant_id, session_id"),
        ("\t".join([*COLUMNS, "hemi"]) + "\n", "two columns have the same name"),
        ("\t".join(COLUMNS) + "\n", "no rows below the header"),
    ],
)
def test_a_sheet_that_is_no_sheet_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "cohort.tsv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_sheet(path)


def test_an_excluded_row_needs_no_age_and_keeps_its_reason(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, "007\t01\tL\tn/a\ta.gii\tno\tmotion"))
    assert (case.include, case.exclude_reason, case.scan_age) == (False, "motion", None)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, GOOD + "\t3T", extra="\tscanner"))
    cases = [replace(case, fields={"thickness": tmp_path / "t.shape.gii"}), replace(case, participant="p", hemi=None)]
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases


def test_quotation_marks_are_written_and_read_back(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, GOOD))
    cases = [replace(case, include=False, exclude_reason='the "left" one', extra={"note": '"'})]
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases


def test_names_of_files_keep_their_blanks(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, GOOD.replace("data/a", "data/a  b")))
    write_sheet([case], tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == [case]


def test_a_sheet_is_complete_or_as_it_was(tmp_path: Path) -> None:
    path = sheet(tmp_path, GOOD)
    before = path.read_bytes()
    (case,) = read_sheet(path)
    with pytest.raises(UnicodeEncodeError):
        write_sheet([case, replace(case, participant="8", surface=Path("\ud800"))], path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_new_cases_are_appended_and_every_row_stays(tmp_path: Path) -> None:
    edited = GOOD.replace("yes\tn/a", 'no\tthe "left" one') + "\t3T"
    gone = GOOD.replace("007", "900") + "\tn/a"
    path = sheet(tmp_path, gone, edited, extra="\tscanner")
    before = path.read_text()
    new = Case("008", None, "R", 30.0, tmp_path / "data/b.surf.gii")
    found = [Case("007", "01", "L", 20.0, tmp_path / "other.surf.gii"), new]
    assert add_to_sheet(found, path) == [new]
    assert path.read_text() == before + "sub-008\tn/a\tR\t30\tdata/b.surf.gii\tyes\tn/a\tn/a\n"
    assert add_to_sheet(found, path) == []


def release(folder: Path) -> Path:
    """A small dHCP-like release: two participants, one with an age in the sessions table, one in participants.tsv."""
    for participant, session in (("CC01", "100"), ("CC02", "200")):
        anat = folder / f"sub-{participant}" / f"ses-{session}" / "anat"
        anat.mkdir(parents=True)
        for name in ("hemi-left_wm", "hemi-right_wm", "hemi-left_pial", "hemi-left_white"):
            (anat / f"sub-{participant}_ses-{session}_{name}.surf.gii").touch()
    (folder / "sub-CC01" / "sub-CC01_sessions.tsv").write_text("session_id\tscan_age\n99\t21.0\n100\t30.5\n")
    (folder / "participants.tsv").write_text("participant_id\tscan_age\nCC01\t1\nsub-CC02\t33\n")
    return folder


def test_scan_finds_the_white_surfaces_of_a_release_and_their_ages(tmp_path: Path) -> None:
    cases = scan(release(tmp_path))
    assert [(case.name, case.scan_age, Path(case.surface).name) for case in cases] == [
        ("sub-CC01_ses-100_hemi-L", 30.5, "sub-CC01_ses-100_hemi-left_wm.surf.gii"),
        ("sub-CC01_ses-100_hemi-R", 30.5, "sub-CC01_ses-100_hemi-right_wm.surf.gii"),
        ("sub-CC02_ses-200_hemi-L", 33.0, "sub-CC02_ses-200_hemi-left_wm.surf.gii"),
        ("sub-CC02_ses-200_hemi-R", 33.0, "sub-CC02_ses-200_hemi-right_wm.surf.gii"),
    ]


def test_a_case_without_an_age_stays_in_the_sheet(tmp_path: Path) -> None:
    (release(tmp_path) / "participants.tsv").unlink()
    cases = scan(tmp_path)
    assert all(case.include for case in cases)
    assert [case.scan_age for case in cases] == [30.5, 30.5, None, None]
    write_sheet(cases, tmp_path / "cohort.tsv")
    assert read_sheet(tmp_path / "cohort.tsv") == cases
    (notice,) = ageless_notice(cases, smoothed=True, folded=True)
    names = "sub-CC02_ses-200_hemi-L, sub-CC02_ses-200_hemi-R"
    assert notice.startswith(f"2 without a gestational age, so not smoothed or folded: {names} (adults have none")
    assert ageless_notice(cases[:2], smoothed=True, folded=True) == []


def test_a_case_without_an_age_is_not_folded(tmp_path: Path) -> None:
    rows = (GOOD + "\tyes", GOOD.replace("007", "008").replace("27.5", "n/a") + "\tyes")
    old, ageless = read_sheet(sheet(tmp_path, *rows, extra="\tfold"))
    assert folded([old, ageless], "all") == [old] and folded([ageless, old], 2) == [old]
    for which in (None, [ageless.name], {"column": "fold"}):
        with pytest.raises(InputError, match="sub-008_ses-01_hemi-L: to be folded, but without an age"):
            folded([old, ageless], which)


def test_a_sphere_is_a_file_of_the_row_or_that_of_a_phantom(tmp_path: Path) -> None:
    synthetic = "p\tn/a\tR\t30\tphantom\tyes\tn/a\tphantom"
    rows = (GOOD + "\ta.sphere.gii", GOOD.replace("007", "008") + "\tn/a", synthetic)
    cases = read_sheet(sheet(tmp_path, *rows, extra="\tsphere"))
    assert [case.sphere for case in cases] == [tmp_path / "a.sphere.gii", None, "phantom"]
    assert not any(case.extra for case in cases)
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases
    for row in (rows[0].replace("a.sphere.gii", "phantom"), rows[2].replace("\tphantom\tyes", "\ta.gii\tyes")):
        with pytest.raises(InputError, match="column sphere: 'phantom', but a phantom and nothing else has the sphere"):
            read_sheet(sheet(tmp_path, row, extra="\tsphere"))


def test_scan_finds_the_sphere_beside_a_surface_the_registered_one_first(tmp_path: Path) -> None:
    anat = release(tmp_path) / "sub-CC01/ses-100/anat"
    for name in ("hemi-left_sphere", "hemi-left_sphere.reg40", "hemi-right_sphere"):
        (anat / f"sub-CC01_ses-100_{name}.surf.gii").touch()
    names = [case.sphere and Path(case.sphere).name for case in scan(tmp_path)]
    begin = "sub-CC01_ses-100_hemi-"
    assert names == [f"{begin}left_sphere.reg40.surf.gii", f"{begin}right_sphere.surf.gii", None, None]
    assert not any(case.sphere for case in scan(tmp_path, Scan(spheres=[])))


def test_scan_finds_the_spheres_of_freesurfer(tmp_path: Path) -> None:
    surf = tmp_path / "sub-01/surf"
    surf.mkdir(parents=True)
    for name in ("lh.white", "lh.sphere", "lh.sphere.reg", "rh.white", "rh.sphere"):
        (surf / name).touch()
    said: list[str] = []
    assert [case.sphere for case in scan(tmp_path, say=said.append)] == [surf / "lh.sphere.reg", None]
    assert "registered spheres: 1; through them the surfaces are resampled" in said[-1]


def test_scan_patterns_are_configurable(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "A7.rh.white.gii").touch()
    (tmp_path / "ages.tsv").write_text("participant_id\tweeks\nA7\t28\n")
    patterns = Scan(surfaces=["x/{participant}.{hemi}.white.gii"], participants="ages.tsv", age_columns=["weeks"])
    (case,) = scan(tmp_path, patterns)
    assert (case.name, case.scan_age) == ("sub-A7_hemi-R", 28.0)


def test_scan_of_a_folder_without_surfaces_says_what_it_looked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"_wm\.surf\.gii"):
        scan(tmp_path)


def freesurfer(folder: Path, *names: str) -> Path:
    """Subjects of FreeSurfer, with the files that a scan looks for."""
    for name in names:
        surf = folder / name / "surf"
        surf.mkdir(parents=True)
        for file in ("lh.white", "lh.pial", "lh.sphere.reg", "lh.thickness", "rh.white"):
            (surf / file).touch()
    return folder


def test_scan_takes_freesurfer_subjects_of_any_name_but_the_template(tmp_path: Path) -> None:
    folder = freesurfer(tmp_path, "subj_01", "bert.long", "fsaverage")
    said: list[str] = []
    cases = scan(folder, say=said.append)
    assert [case.name for case in cases] == [
        f"sub-{who}_hemi-{hemi}" for who in ("bertlong", "subj01") for hemi in "LR"
    ]
    assert "subj_01 is called sub-subj01" in said


@pytest.mark.parametrize(
    ("file", "case"),
    [
        ("sub-01/ses-1/anat/sub-01_ses-1_acq-T1w_run-1_hemi-L_space-T1w_desc-x_white.surf.gii", "sub-01_ses-1_hemi-L"),
        ("sub-01/ses-1/anat/sub-01_hemi-R_ses-1_space-MNIInfant_cohort-3_wm.surf.gii", "sub-01_ses-1_hemi-R"),
        ("sub-01/anat/sub-01_hemi-L_smoothwm.surf.gii", "sub-01_hemi-L"),
        ("sub-01/anat/sub-01_ses-2_run-1_hemi-L_white.surf.gii", "sub-01_ses-2_hemi-L"),
        ("sub-01/anat/sub-01_acq-b_white.surf.gii", "sub-01"),
        ("sub-01_ses-1/surf/lh.white", "sub-01_ses-1_hemi-L"),
        ("sub-01/ses-1/surf/rh.white", "sub-01_ses-1_hemi-R"),
        ("100307/T1w/Native/100307.L.white.native.surf.gii", "sub-100307_hemi-L"),
    ],
)
def test_scan_knows_the_names_of_other_pipelines(tmp_path: Path, file: str, case: str) -> None:
    """Of fMRIPrep, nibabies, FreeSurfer and HCP, with the pial surface beside, where asked."""
    path = tmp_path / file
    path.parent.mkdir(parents=True)
    pial = path.with_name(re.sub("smoothwm|white|wm", "pial", path.name))
    for one in (path, pial):
        one.touch()
    said: list[str] = []
    (found,) = scan(tmp_path, say=said.append)
    assert (found.name, found.surface) == (case, path)
    assert "white surfaces alone: 1; what they enclose is white matter" in said[-1]
    assert said[-1].endswith("; pial surfaces beside them: 1 (--pial takes both)")
    (both,) = scan(tmp_path, Scan(pial=True), said.append)
    assert (both.surface, both.inner) == (pial, {"white": path})
    assert said[-1] == "pial surfaces with the white ones inside: 1; the cortex is a layer of its own"


def test_a_file_in_the_folder_of_another_session_is_no_case(tmp_path: Path) -> None:
    anat = tmp_path / "sub-01/ses-1/anat"
    anat.mkdir(parents=True)
    (anat / "sub-01_ses-2_hemi-L_white.surf.gii").touch()
    with pytest.raises(InputError, match="no surfaces found"):
        scan(tmp_path)


def test_two_runs_of_a_hemisphere_are_both_named(tmp_path: Path) -> None:
    anat = tmp_path / "sub-01/anat"
    anat.mkdir(parents=True)
    for name in ("sub-01_run-2_hemi-L_white", "sub-01_run-1_hemi-L_white", "sub-01_run-1_hemi-L_space-T1w_white"):
        (anat / f"{name}.surf.gii").touch()
    said: list[str] = []
    (case,) = scan(tmp_path, say=said.append)
    assert Path(case.surface).name == "sub-01_run-1_hemi-L_white.surf.gii"
    (line,) = [
        line for line in said if line.startswith("3 surfaces of one hemisphere: sub-01/anat/sub-01_run-1_hemi-L")
    ]
    assert "sub-01_run-2_hemi-L_white.surf.gii" in line and "the first is taken" in line


def touched(folder: Path, *names: str) -> Path:
    """A folder with empty files of these names."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def scanned(folder: Path, patterns: Scan | None = None) -> tuple[list[str], str]:
    """The surfaces of the cases, below the folder, and what was said."""
    said: list[str] = []
    cases = scan(folder, patterns, said.append)
    return [Path(case.surface).relative_to(folder).as_posix() for case in cases], "\n".join(said)


def test_a_side_with_a_pial_surface_alone_is_named(tmp_path: Path) -> None:
    folder = touched(tmp_path, "sub-01/surf/lh.white", "sub-01/surf/lh.pial", "sub-01/surf/rh.pial")
    touched(folder, "sub-02/anat/sub-02_hemi-L_pial.surf.gii")
    for pial in (False, True):
        taken, said = scanned(folder, Scan(pial=pial))
        assert taken == [f"sub-01/surf/lh.{'pial' if pial else 'white'}"]
        assert "hemispheres with a pial surface and no white one, left out: sub-01/surf/rh.pial, sub-02/anat/" in said


def test_a_surface_that_was_converted_beside_that_of_freesurfer_is_named(tmp_path: Path) -> None:
    folder = touched(tmp_path, "bert/surf/lh.white", "bert/surf/lh.white.surf.gii", "bert/surf/rh.white.surf.gii")
    taken, said = scanned(folder)
    assert taken == ["bert/surf/lh.white", "bert/surf/rh.white.surf.gii"]
    assert "2 surfaces of one hemisphere: bert/surf/lh.white, bert/surf/lh.white.surf.gii; the first is taken" in said


def test_surfaces_of_one_hemisphere_under_two_patterns_are_named(tmp_path: Path) -> None:
    names = [f"sub-01/anat/sub-01_hemi-{hemi}_{kind}.surf.gii" for hemi in "LR" for kind in ("smoothwm", "white")]
    taken, said = scanned(touched(tmp_path, *names))
    assert taken == [names[1], names[3]]
    assert f"surfaces of hemispheres that have another, not taken: {names[0]}, {names[2]} (see" in said


def test_a_surface_in_the_space_of_a_template_is_named_and_not_preferred(tmp_path: Path) -> None:
    own, other = (
        "sub-01/anat/sub-01_hemi-L_space-T1w_white.surf.gii",
        "sub-01/anat/sub-01_hemi-L_space-MNI152_wm.surf.gii",
    )
    only = "sub-01/anat/sub-01_hemi-R_space-MNI152_wm.surf.gii"
    taken, said = scanned(touched(tmp_path, own, other, only))
    assert taken == [own, only]
    assert f"surfaces in the space of a template, space-MNI152: {only}; their size and location are not" in said
    assert f"that have another, not taken: {other}" in said


def test_surfaces_packed_by_gzip_are_found_with_what_lies_beside(tmp_path: Path) -> None:
    begin = "sub-01/anat/sub-01_hemi-L"
    folder = touched(tmp_path, f"{begin}_white.surf.gii.gz", f"{begin}_pial.surf.gii.gz", f"{begin}_sphere.surf.gii")
    assert scanned(folder)[0] == [f"{begin}_white.surf.gii.gz"]
    (case,) = scan(folder, Scan(pial=True))
    assert case.surface == folder / f"{begin}_pial.surf.gii.gz" and case.inner
    assert case.sphere == folder / f"{begin}_sphere.surf.gii"


def test_of_two_runs_that_with_both_surfaces_is_taken_where_both_are_asked_for(tmp_path: Path) -> None:
    begin = "sub-01/anat/sub-01_run"
    names = [f"{begin}-{end}.surf.gii" for end in ("1_hemi-L_white", "2_hemi-L_white", "2_hemi-L_pial")]
    folder = touched(tmp_path, *names)
    assert scanned(folder)[0] == names[:1]
    taken, said = scanned(folder, Scan(pial=True))
    assert taken == names[2:]
    assert f"2 surfaces of one hemisphere: {names[1]}, {names[0]}; the first is taken" in said


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("sub-01/surf/lh.pial", r"no surfaces found, but 1 pial ones, as .*lh\.pial .get the white ones, or name"),
        (
            "100307/MNINonLinear/Native/100307.L.white.native.surf.gii",
            r"but 1 in the space of a template, as .*native\.surf\.gii .get T1w/Native of HCP",
        ),
        (".gitmodules", "in a dataset with parts that may not be here .datalad get -n -r "),
        ("x.surf.gii", r"no surfaces found .check the folder, or set cohort\.scan\.surfaces"),
    ],
)
def test_a_folder_without_white_surfaces_says_what_is_there(tmp_path: Path, file: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        scan(touched(tmp_path, file))


@pytest.mark.parametrize(
    ("file", "given"),
    [
        ("sub-01/anat/sub-01_hemi-L_white.surf.gii", "sub-01"),
        ("sub-01/ses-1/anat/sub-01_ses-1_hemi-L_white.surf.gii", "sub-01/ses-1"),
        ("bert/surf/lh.white", "bert"),
    ],
)
def test_the_folder_of_a_subject_names_that_of_the_dataset(tmp_path: Path, file: str, given: str) -> None:
    folder = touched(tmp_path / "study", file)
    with pytest.raises(InputError, match=rf"{given}: .*folder of a subject.*name {folder}\)"):
        scan(folder / given)


def test_a_folder_of_links_whose_content_is_elsewhere_says_so(tmp_path: Path) -> None:
    (tmp_path / "sub-01").mkdir()
    (tmp_path / "sub-01/anat").symlink_to("../.git/annex/objects/x")
    with pytest.raises(InputError, match=r"but 1 links whose content is not here, as (.*sub-01/anat) .datalad get \1,"):
        scan(tmp_path)
    touched(tmp_path, "bert/surf/x")
    (tmp_path / "bert/surf/lh.white").symlink_to("../../.git/annex/objects/y")
    assert scanned(tmp_path, Scan(surfaces=["{participant}/surf/lh.white"]))[0] == ["bert/surf/lh.white"]


def test_links_whose_content_is_elsewhere_are_named(tmp_path: Path) -> None:
    """As DataLad leaves them. The white surface alone is not taken for a pair whose pial surface is elsewhere."""
    folder = freesurfer(tmp_path / "fs", "bert")
    surf = folder / "bert/surf"
    (surf / "rh.pial").symlink_to("../../.git/annex/objects/x")
    (surf / "lh.white").unlink()
    (surf / "lh.white").symlink_to("../../.git/annex/objects/y")
    said: list[str] = []
    left, right = scan(folder, Scan(pial=True, volumes={"aseg": ["{participant}/surf/rh.pial"]}), said.append)
    assert (left.surface, right.surface) == (surf / "lh.pial", surf / "rh.pial")
    assert right.inner == {"white": surf / "rh.white"} and not right.volumes
    for name in ("lh.white", "rh.pial"):
        assert f"{surf / name}: is a link whose content is not here (datalad get {surf / name})" in said
    assert any("so the volume aseg is left out" in line for line in said)
    for error in (
        missing_surface(surf / "rh.pial", column="surface"),
        _refused(lambda: read_surface(surf / "rh.pial")),
    ):
        assert str(error) == f"{surf / 'rh.pial'}: is a link whose content is not here (datalad get {surf / 'rh.pial'})"


def _refused(call: Callable[[], object]) -> InputError:
    with pytest.raises(InputError) as caught:
        call()
    return caught.value


def test_labels_that_differ_in_case_only_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"S1 and s1 differ in case only .rename one: some file systems ignore case"):
        scan(freesurfer(tmp_path / "fs", "sub-S1", "sub-s1"))
    rows = (GOOD.replace("007", "S1"), GOOD.replace("007", "s1"))
    with pytest.raises(InputError, match=r"sub-s1_ses-01_hemi-L is already in line 2 .*a label that differs in more"):
        read_sheet(sheet(tmp_path, *rows))


def test_scan_refuses_subjects_whose_labels_are_alike(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a_1 and a-1 would both be sub-a1|a-1 and a_1 would both be sub-a1"):
        scan(freesurfer(tmp_path, "a_1", "a-1"))


def test_scan_finds_pial_surfaces_and_fields_of_freesurfer_where_asked(tmp_path: Path) -> None:
    folder = freesurfer(tmp_path, "bert")
    left, right = scan(folder, Scan(pial=True, fields={"thickness": ["thickness.shape.gii", "thickness"]}))
    surf = folder / "bert/surf"
    assert (left.surface, left.inner) == (surf / "lh.pial", {"white": surf / "lh.white"})
    assert left.fields == {"thickness": surf / "lh.thickness"} and right.fields == {}
    assert right.surface == surf / "rh.white"


def test_cases_are_chosen_by_name_by_number_over_the_ages_or_all() -> None:
    cases = [Case(str(age), None, "L", age, "phantom") for age in (30, 22, 36, 26, 34)]
    assert chosen(cases, "all") == cases
    assert [case.scan_age for case in chosen(cases, 3)] == [22, 30, 36]
    assert [case.scan_age for case in chosen(cases, 1)] == [22]
    assert len(chosen(cases, 9)) == 5 and chosen(cases, 0) == []
    assert chosen(cases, ["sub-36_hemi-L"]) == [cases[2]]
    with pytest.raises(InputError, match="no included case is named sub-40_hemi-L"):
        chosen(cases, ["sub-40_hemi-L"])


def marked(tmp_path: Path, *words: str, column: str = "fold") -> list[Case]:
    rows = (GOOD.replace("007", f"a{number}") + f"\t{word}" for number, word in enumerate(words))
    return read_sheet(sheet(tmp_path, *rows, extra=f"\t{column}"))


def test_a_file_below_the_working_folder_has_one_spelling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data/x.gii").touch()
    monkeypatch.chdir(tmp_path)
    for name in ("data/x.gii", "./data/x.gii", f"../{tmp_path.name}/data/x.gii", str(tmp_path / "data/x.gii")):
        path = Path("c.tsv")
        path.write_text("\t".join(COLUMNS) + "\n" + GOOD.replace("data/a.surf.gii", name) + "\n")
        assert read_sheet(path)[0].surface == Path("data/x.gii"), name
        assert read_sheet(path.absolute())[0].surface == Path("data/x.gii"), name


def test_a_column_of_the_sheet_may_choose_cases(tmp_path: Path) -> None:
    cases = marked(tmp_path, "yes", "no", "TRUE", "0", column="simulated")
    assert chosen(cases, {"column": "simulated"}) == [cases[0], cases[2]]
    assert folded(cases, {"column": "simulated"}) == [cases[0], cases[2]]
    with pytest.raises(InputError, match="no column fold that says yes or no .*further columns are simulated"):
        chosen(cases, {"column": "fold"})
    with pytest.raises(
        InputError, match="column fold of sub-a1_ses-01_hemi-L: 'maybe' is neither yes nor no .*yes or no"
    ):
        chosen(marked(tmp_path, "yes", "maybe"), {"column": "fold"})


def test_the_column_fold_says_what_is_folded_where_the_configuration_does_not(tmp_path: Path) -> None:
    cases = marked(tmp_path, "yes", "no")
    assert folded(cases, None) == [cases[0]]
    assert folded(cases, "all") == cases and folded(cases, []) == []
    assert folded(marked(tmp_path, "3T", "7T", column="scanner"), None) == []
    said = marked(tmp_path, "yes", "n/a")
    assert folded(said, None) == [said[0]], "as in BIDS, n/a says nothing"


def test_the_demo_folds_one_case_and_another_sheet_none() -> None:
    root = Path(__file__).parents[2]
    which = load(root / "config.yaml").fold.cases
    assert [case.name for case in folded(read_sheet(root / "demo/cohort.tsv"), which)] == ["sub-phantom22_hemi-L"]
    assert folded(read_sheet(root / "demo/pairs.tsv"), which) == []


def test_inner_surfaces_are_named_by_their_columns(tmp_path: Path) -> None:
    path = tmp_path / "cohort.tsv"
    header = "participant_id\tsession_id\themi\tscan_age\tsurface\tinclude\texclude_reason\tinner\tinner_ventricle\n"
    path.write_text(header + "sub-1\tn/a\tL\t30\tpial.surf.gii\tyes\tn/a\twhite.surf.gii\tv.surf.gii\n")
    (case,) = read_sheet(path)
    assert case.inner == {"white": tmp_path / "white.surf.gii", "ventricle": tmp_path / "v.surf.gii"}
    write_sheet([case], tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == [case]
    path.write_text(path.read_text().replace("inner_ventricle", "inner_core"))
    with pytest.raises(InputError, match="column inner_core: 'core' stands for another part of every mesh"):
        read_sheet(path)
    path.write_text(path.read_text().replace("inner_core", "inner_v").replace("pial.surf.gii", "phantom"))
    only = "but a phantom and nothing else has an inner surface phantom"
    with pytest.raises(InputError, match=f"column inner: 'white.surf.gii', {only}"):
        read_sheet(path)
    path.write_text(path.read_text().replace("white.surf.gii", "phantom"))
    with pytest.raises(InputError, match=f"column inner_v: 'v.surf.gii', {only}"):
        read_sheet(path)
    path.write_text(path.read_text().replace("v.surf.gii", "n/a"))
    (case,) = read_sheet(path)
    assert case.is_phantom and case.inner == {"white": "phantom"}
    write_sheet([case], tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == [case]


def test_scan_takes_the_pial_surface_beside_a_white_one_where_asked(tmp_path: Path) -> None:
    folder = release(tmp_path)
    found = {case.name: case for case in scan(folder, Scan(pial=True))}
    left = found["sub-CC01_ses-100_hemi-L"]
    assert Path(left.surface).name.endswith("left_pial.surf.gii") and left.inner["white"].name.endswith(
        "left_wm.surf.gii"
    )
    right = found["sub-CC01_ses-100_hemi-R"]
    assert Path(right.surface).name.endswith("right_wm.surf.gii") and not right.inner
    assert not any(case.inner for case in scan(folder))


def test_a_sheet_names_links_not_what_they_lead_to(tmp_path: Path) -> None:
    """DataLad keeps content under names that say neither surface nor hemisphere; a link may lead to itself."""
    folder = freesurfer(tmp_path / "fs", "bert")
    white = folder / "bert/surf/lh.white"
    key = tmp_path / "fs/.git/annex/objects/MD5E-s9--0a"
    key.parent.mkdir(parents=True)
    white.rename(key)
    white.symlink_to("../../.git/annex/objects/MD5E-s9--0a")
    (folder / "bert/surf/rh.white").unlink()
    (folder / "bert/surf/rh.white").symlink_to("rh.white")
    cases = [case for case in scan(folder, Scan()) if case.surface.name == "lh.white"]
    sheet = tmp_path / "surfaces.tsv"
    write_sheet([*cases, replace(cases[0], hemi="R", surface=white.with_name("rh.white"))], sheet)
    text = sheet.read_text()
    assert "fs/bert/surf/lh.white" in text and "fs/bert/surf/rh.white" in text
    assert ".git" not in text
