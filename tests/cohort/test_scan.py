"""A scan of a data release: which surfaces are taken, what lies beside them, and what is said of the others."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from cortet.cohort.bids import DESCRIPTION
from cortet.cohort.scan import scan
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.cohort.user_files import missing_surface
from cortet.config import Scan
from cortet.errors import InputError
from cortet.formats.gifti import read_surface


def touched(folder: Path, *names: str) -> Path:
    """A folder with empty files of these names."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def scanned(folder: Path, patterns: Scan | None = None, begin: str = "") -> tuple[list[Case], str]:
    """The cases of a folder below another, with the names of surfaces below the latter, and what was said."""
    said: list[str] = []
    cases = scan(folder / begin, patterns, said.append)
    return [replace(case, surface=Path(case.surface).relative_to(folder).as_posix()) for case in cases], "\n".join(said)


def surfaces(folder: Path, patterns: Scan | None = None) -> list[str]:
    return [str(case.surface) for case in scanned(folder, patterns)[0]]


def release(folder: Path) -> Path:
    """A small dHCP-like release: two participants, one with an age in the sessions table, one in participants.tsv."""
    for participant, session in (("CC01", "100"), ("CC02", "200")):
        begin = f"sub-{participant}/ses-{session}/anat/sub-{participant}_ses-{session}"
        ends = ("hemi-left_wm", "hemi-right_wm", "hemi-left_pial", "hemi-left_white")
        touched(folder, *(f"{begin}_{end}.surf.gii" for end in ends))
    (folder / "sub-CC01/sub-CC01_sessions.tsv").write_text("session_id\tscan_age\n99\t21.0\n100\t30.5\n")
    (folder / "participants.tsv").write_text("participant_id\tscan_age\nCC01\t1\nsub-CC02\t33\n")
    return folder


def freesurfer(folder: Path, *subjects: str) -> Path:
    """Subjects of FreeSurfer, with the files that a scan looks for."""
    names = ("lh.white", "lh.pial", "lh.sphere.reg", "lh.thickness", "rh.white")
    return touched(folder, *(f"{subject}/surf/{name}" for subject in subjects for name in names))


def test_the_white_surfaces_of_a_release_are_found_with_their_ages(tmp_path):
    cases, _ = scanned(release(tmp_path))
    assert [(case.name, case.scan_age, Path(case.surface).name) for case in cases] == [
        ("sub-CC01_ses-100_hemi-L", 30.5, "sub-CC01_ses-100_hemi-left_wm.surf.gii"),
        ("sub-CC01_ses-100_hemi-R", 30.5, "sub-CC01_ses-100_hemi-right_wm.surf.gii"),
        ("sub-CC02_ses-200_hemi-L", 33.0, "sub-CC02_ses-200_hemi-left_wm.surf.gii"),
        ("sub-CC02_ses-200_hemi-R", 33.0, "sub-CC02_ses-200_hemi-right_wm.surf.gii"),
    ]
    (tmp_path / "participants.tsv").unlink()
    cases = scan(tmp_path)
    assert [(case.scan_age, case.include) for case in cases] == [(30.5, True)] * 2 + [(None, True)] * 2
    write_sheet(cases, tmp_path / "cohort.tsv")
    assert read_sheet(tmp_path / "cohort.tsv") == cases


def test_the_sphere_beside_a_surface_is_found_the_registered_one_first(tmp_path):
    begin = "sub-CC01_ses-100_hemi-"
    ends = ("left_sphere", "left_sphere.reg40", "right_sphere")
    touched(release(tmp_path) / "sub-CC01/ses-100/anat", *(f"{begin}{end}.surf.gii" for end in ends))
    names = [case.sphere and Path(case.sphere).name for case in scan(tmp_path)]
    assert names == [f"{begin}left_sphere.reg40.surf.gii", f"{begin}right_sphere.surf.gii", None, None]
    assert not any(case.sphere for case in scan(tmp_path, Scan(spheres=[])))


def test_subjects_of_freesurfer_may_have_any_name_but_that_of_the_template(tmp_path):
    cases, said = scanned(freesurfer(tmp_path, "subj_01", "bert.long", "fsaverage"))
    names = [f"sub-{who}_hemi-{hemi}" for who in ("bertlong", "subj01") for hemi in "LR"]
    assert [case.name for case in cases] == names
    assert "subj_01 becomes sub-subj01" in said
    assert "registered spheres: 2" in said


def test_the_templates_and_the_example_of_freesurfer_are_no_participants(tmp_path):
    cases, said = scanned(freesurfer(tmp_path, "bert", "cvs_avg35", "cvs_avg35_inMNI152", "p1"))
    assert [case.name for case in cases] == ["sub-p1_hemi-L", "sub-p1_hemi-R"]
    assert "bert is left out: it is FreeSurfer's example subject" in said


def test_surfaces_and_fields_beside_that_of_freesurfer_are_found(tmp_path):
    surf = freesurfer(tmp_path, "bert") / "bert/surf"
    left, right = scan(tmp_path, Scan(pial=True, fields={"thickness": ["thickness.shape.gii", "thickness"]}))
    assert (left.surface, left.inner, left.sphere) == (
        surf / "lh.pial",
        {"white": surf / "lh.white"},
        surf / "lh.sphere.reg",
    )
    assert left.fields == {"thickness": surf / "lh.thickness"} and right.fields == {}
    assert (right.surface, right.sphere) == (surf / "rh.white", None)


def test_patterns_are_configurable(tmp_path):
    touched(tmp_path, "x/A7.rh.white.gii")
    (tmp_path / "ages.tsv").write_text("participant_id\tweeks\nA7\t28\n")
    patterns = Scan(surfaces=["x/{participant}.{hemi}.white.gii"], participants="ages.tsv", age_columns=["weeks"])
    (case,) = scan(tmp_path, patterns)
    assert (case.name, case.scan_age) == ("sub-A7_hemi-R", 28.0)


@pytest.mark.parametrize(
    ("file", "case"),
    [
        ("sub-01/ses-1/anat/sub-01_ses-1_acq-T1w_run-1_hemi-L_space-T1w_desc-x_white.surf.gii", "sub-01_ses-1_hemi-L"),
        ("sub-01/ses-1/anat/sub-01_hemi-R_ses-1_space-MNIInfant_cohort-3_wm.surf.gii", "sub-01_ses-1_hemi-R"),
        ("sub-01/anat/sub-01_hemi-L_smoothwm.surf.gii", "sub-01_hemi-L"),
        ("sub-01/anat/sub-01_ses-2_run-1_hemi-L_white.surf.gii", "sub-01_ses-2_hemi-L"),
        ("sub-01/anat/sub-01_acq-b_white.surf.gii", "sub-01"),
        ("sub-01/anat/sub-01_hemi-L_white.surf.gii.gz", "sub-01_hemi-L"),
        ("sub-01_ses-1/surf/lh.white", "sub-01_ses-1_hemi-L"),
        ("sub-01/ses-1/surf/rh.white", "sub-01_ses-1_hemi-R"),
        ("100307/T1w/Native/100307.L.white.native.surf.gii", "sub-100307_hemi-L"),
    ],
)
def test_the_names_of_other_pipelines_are_known(tmp_path, file, case):
    """Of fMRIPrep, nibabies, FreeSurfer and HCP, with the pial surface beside, where asked."""
    path = tmp_path / file
    pial = path.with_name(re.sub("smoothwm|white|wm", "pial", path.name))
    touched(tmp_path, file, str(pial))
    said: list[str] = []
    (found,) = scan(tmp_path, say=said.append)
    assert (found.name, found.surface) == (case, path)
    assert "only the white surface" in said[-1] and "(--pial uses both)" in said[-1]
    (both,) = scan(tmp_path, Scan(pial=True), said.append)
    assert (both.surface, both.inner) == (pial, {"white": path})
    assert "pial and white surfaces" in said[-1]


#: what is in the folder -> what is taken, and what is said of the rest
A = "sub-01/anat/sub-01"
SEVERAL: dict[str, tuple[list[str], list[str], str]] = {
    "two runs": (
        [f"{A}_run-2_hemi-L_white.surf.gii", f"{A}_run-1_hemi-L_white.surf.gii"],
        [f"{A}_run-1_hemi-L_white.surf.gii"],
        f"2 surfaces of one hemisphere: {A}_run-1_hemi-L_white.surf.gii, {A}_run-2_hemi-L_white.surf.gii; cortet",
    ),
    "one that was converted": (
        ["bert/surf/lh.white", "bert/surf/lh.white.surf.gii", "bert/surf/rh.white.surf.gii"],
        ["bert/surf/lh.white", "bert/surf/rh.white.surf.gii"],
        "2 surfaces of one hemisphere: bert/surf/lh.white, bert/surf/lh.white.surf.gii; cortet uses the first",
    ),
    "two patterns": (
        [f"{A}_hemi-{hemi}_{kind}.surf.gii" for hemi in "LR" for kind in ("smoothwm", "white")],
        [f"{A}_hemi-{hemi}_white.surf.gii" for hemi in "LR"],
        f"the hemisphere has another surface: {A}_hemi-L_smoothwm.surf.gii, {A}_hemi-R_smoothwm.surf.gii",
    ),
    "another in the space of a template": (
        [f"{A}_hemi-L_space-T1w_white.surf.gii", f"{A}_hemi-L_space-MNI152_wm.surf.gii"],
        [f"{A}_hemi-L_space-T1w_white.surf.gii"],
        f"the hemisphere has another surface: {A}_hemi-L_space-MNI152_wm.surf.gii",
    ),
    "one in the space of a template": (
        [f"{A}_hemi-R_space-MNI152_wm.surf.gii"],
        [f"{A}_hemi-R_space-MNI152_wm.surf.gii"],
        f"in template space (space-MNI152): {A}_hemi-R_space-MNI152_wm.surf.gii",
    ),
    "a side with a pial surface alone": (
        ["sub-01/surf/lh.white", "sub-01/surf/rh.pial", "sub-02/anat/sub-02_hemi-L_pial.surf.gii"],
        ["sub-01/surf/lh.white"],
        "no white surface: sub-01/surf/rh.pial, sub-02/anat/sub-02_hemi-L_pial.surf.gii",
    ),
}


@pytest.mark.parametrize("what", SEVERAL)
def test_of_several_surfaces_one_is_taken_and_the_others_are_named(tmp_path, what):
    names, taken, told = SEVERAL[what]
    folder = touched(tmp_path, *names)
    assert surfaces(folder) == taken
    assert told in scanned(folder)[1]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("sub-01/surf/lh.pial", r"only 1 pial .*lh\.pial"),
        ("x.surf.gii", r"no surfaces found .*cohort\.scan\.surfaces.*_wm\.surf\.gii"),
        ("sub-01/ses-1/anat/sub-01_ses-2_hemi-L_white.surf.gii", "no surfaces found"),
    ],
)
def test_a_folder_without_white_surfaces_says_what_is_there(tmp_path, file, words):
    with pytest.raises(InputError, match=words):
        scan(touched(tmp_path, file))


@pytest.mark.parametrize("subject", ["bert", "sub-01", "sub-CC01"])
def test_the_folder_of_one_subject_names_the_folder_that_holds_all(tmp_path, subject):
    release(freesurfer(tmp_path, "bert", "sub-01"))
    with pytest.raises(InputError, match=f"{subject}: is the folder of one subject.*subjects: {tmp_path}"):
        scan(tmp_path / subject)


def test_longitudinal_folders_of_freesurfer_are_used_and_their_base_is_no_session(tmp_path):
    ends = ("sub-01_ses-1", "sub-01_ses-2", "sub-01", "sub-01_ses-1.long.sub-01", "sub-01_ses-2.long.sub-01")
    cases, said = scanned(touched(tmp_path, *(f"{name}/surf/lh.white" for name in ends)))
    assert [case.surface for case in cases] == [f"sub-01_ses-{n}.long.sub-01/surf/lh.white" for n in (1, 2)]
    assert "bases are left out, since they average over sessions: sub-01" in said


def fetpype(dataset: Path, *pipelines: str) -> Path:
    """A raw dataset with ages, and the surfaces of Fetpype below it: one participant with a session, one without."""
    for pipeline in pipelines:
        folder = dataset / "derivatives" / pipeline
        begin = [f"sub-01/ses-02/anat/sub-01_ses-02_rec-{pipeline}_seg-bounti", f"sub-03/anat/sub-03_rec-{pipeline}"]
        touched(folder, *(f"{name}_hemi-{hemi}_white.surf.gii" for name in begin for hemi in "LR"))
        about = {"Name": "surfpype", "BIDSVersion": "1.7.0", "GeneratedBy": [{"Name": "surfpype"}]}
        (folder / DESCRIPTION).write_text(json.dumps(about))
    touched(dataset, "sub-01/ses-02/anat/sub-01_ses-02_run-1_T2w.nii.gz")
    (dataset / "participants.tsv").write_text("participant_id\tgestational_age\nsub-01\t28.5\nsub-03\t32.1\n")
    return dataset


@pytest.mark.parametrize("begin", ["", "derivatives", "derivatives/nesvor"])
def test_surfaces_of_fetpype_are_found_with_ages_from_any_folder_of_the_dataset(tmp_path, begin):
    cases, _ = scanned(fetpype(tmp_path, "nesvor"), begin=begin)
    ages = {"sub-01_ses-02_hemi-L": 28.5, "sub-01_ses-02_hemi-R": 28.5, "sub-03_hemi-L": 32.1, "sub-03_hemi-R": 32.1}
    assert {case.name: case.scan_age for case in cases} == ages
    name = "derivatives/nesvor/sub-01/ses-02/anat/sub-01_ses-02_rec-nesvor_seg-bounti_hemi-L_white.surf.gii"
    assert cases[0].surface == name


def test_of_several_pipelines_one_has_to_be_chosen(tmp_path):
    fetpype(tmp_path, "nesvor", "niftymic")
    with pytest.raises(InputError, match=r"2 pipelines.*: nesvor, niftymic.*give its folder.*derivatives/nesvor"):
        scan(tmp_path)
    assert [case.scan_age for case in scan(tmp_path / "derivatives/niftymic")] == [28.5, 28.5, 32.1, 32.1]


def test_a_link_to_a_pipeline_is_no_second_one(tmp_path):
    """`derivatives/latest` made cortet ask which of two to take."""
    fetpype(tmp_path, "nesvor")
    (tmp_path / "derivatives/latest").symlink_to("nesvor")
    said: list[str] = []
    assert len(scan(tmp_path, say=said.append)) == 4
    assert any(line.endswith("derivatives/nesvor") for line in said)


def test_an_earlier_output_of_cortet_is_no_pipeline(tmp_path):
    own = touched(fetpype(tmp_path, "nesvor") / "derivatives/cortet", f"{A}_hemi-L_white.surf.gii")
    (own / DESCRIPTION).write_text(json.dumps({"GeneratedBy": [{"Name": "cortet"}]}))
    assert len(scan(tmp_path)) == 4


@pytest.mark.parametrize(
    "about",
    [
        {"SourceDatasets": [{"URL": "https://[x"}, {"URL": "../raw data"}]},
        {"DatasetLinks": {"doi": "doi:10.1/x", "raw": "file://RAW"}},
        {"SourceDatasets": "x", "DatasetLinks": {"raw": "../raw%20data", "one": 1}},
    ],
)
def test_the_description_of_a_derivative_leads_to_the_ages(tmp_path, about):
    raw = fetpype(tmp_path / "raw data")
    folder = touched(tmp_path / "out", f"{A}_hemi-L_white.surf.gii")
    (folder / DESCRIPTION).write_text(json.dumps(about).replace("RAW", str(raw)))
    assert [case.scan_age for case in scan(folder)] == [28.5]


def test_subjects_whose_labels_are_alike_are_refused(tmp_path):
    with pytest.raises(InputError, match="would both be sub-a1"):
        scan(freesurfer(tmp_path, "a_1", "a-1"))
    with pytest.raises(InputError, match="differ only in upper and lower case"):
        scan(freesurfer(tmp_path / "case", "sub-S1", "sub-s1"))


def test_links_whose_content_is_elsewhere_are_named(tmp_path):
    """As DataLad leaves them. The white surface alone is not taken for a pair whose pial surface is elsewhere."""
    folder = freesurfer(tmp_path / "fs", "bert")
    surf = folder / "bert/surf"
    (surf / "lh.white").unlink()
    for name in ("lh.white", "rh.pial"):
        (surf / name).symlink_to("../../.git/annex/objects/x")
    said: list[str] = []
    left, right = scan(folder, Scan(pial=True, volumes={"aseg": ["{participant}/surf/rh.pial"]}), said.append)
    assert (left.surface, right.surface) == (surf / "lh.pial", surf / "rh.pial")
    assert right.inner == {"white": surf / "rh.white"} and not right.volumes
    for name in ("lh.white", "rh.pial"):
        assert f"{surf / name}: is a link to a file that was not downloaded (datalad get {surf / name})" in said
    assert any("so the volume aseg is left out" in line for line in said)
    with pytest.raises(InputError, match="is a link to a file that was not downloaded") as error:
        read_surface(surf / "rh.pial")
    assert str(error.value) == str(missing_surface(surf / "rh.pial", column="surface"))
    (surf / "rh.pial").unlink()
    (surf / "rh.pial").symlink_to("rh.pial.T1")  # as FreeSurfer 8 makes it
    scan(folder, Scan(pial=True), said.append)
    assert f"{surf / 'rh.pial'}: is a link to rh.pial.T1, which is missing" in said[-1]
