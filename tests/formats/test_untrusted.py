"""Files that are damaged, truncated or of another kind are refused in words that name file and remedy."""

from __future__ import annotations

import json
import os
import random
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damages import Seeds, outcome, place_damaged, seeds
from exported import full_mesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapes import ball_surface

from cortet.cohort.scan import scan
from cortet.cohort.sheet import COLUMNS, LONGEST_LABEL, Case, read_sheet, write_sheet
from cortet.config import Scan
from cortet.errors import InputError
from cortet.formats import FORMATS, read_mesh
from cortet.formats.gifti import read_fields, read_surface, write_surface
from cortet.formats.untrusted import safely_named
from cortet.meshes import TetMesh
from cortet.solver_files.export import convert, export, write
from cortet.solver_files.sidecar import sidecar_path

#: of the files that `damages` makes
KINDS = [
    *(name for name in FORMATS if name not in ("braingrowth", "febio")),
    *(
        "xdmf_of_meshio",
        "plain_xdmf_of_meshio",
        "gate",
        "repair",
        "fields",
        "text_stl",
        "ply",
        "text_ply",
        "obj",
        "off",
    ),
    *("lh_thickness", "lh_aparc_annot", "dseg", "aseg", "fa", "dti", "affine", "sheet", "config", "release"),
]
XML = {"fenics": "m.xdmf", "gifti": "m.surf.gii"}


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Seeds:
    return seeds(tmp_path_factory.mktemp("valid"))


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return full_mesh()


def written(mesh: TetMesh, folder: Path, name: str) -> Path:
    path = folder / f"m{FORMATS[name].suffix}"
    write(mesh, path, solver=name)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_refused_or_give_a_sound_result(kind: str, valid, tmp_path: Path) -> None:
    assert set(KINDS) == set(valid)
    file, read = valid[kind]

    @settings(
        max_examples=5 if kind == "vtu" else 25,  # others than whole ones begin PyVista
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**32))
    def holds(number: int) -> None:
        folder = tmp_path / str(number)
        if not folder.exists():
            found = outcome(read, place_damaged(kind, file, random.Random(number), folder))
            assert found in ("valid", "refused"), f"{kind} {number}"

    holds()


@pytest.mark.parametrize("name", XML)
@pytest.mark.parametrize("encoding", ["none", "shift_jis", "idna"])
def test_xml_in_an_encoding_that_cannot_be_read_is_refused(name: str, encoding: str, mesh, tmp_path: Path) -> None:
    path = written(mesh, tmp_path, name)
    text = re.sub(rb"<\?xml[^>]*\?>", b"", path.read_bytes())
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>'.encode() + text)
    with pytest.raises(InputError, match=path.name):
        (read_surface if name == "gifti" else read_mesh)(path)


def test_a_field_named_as_a_path_writes_nothing_elsewhere(mesh, tmp_path: Path) -> None:
    name = "../../evil"
    surface = replace(ball_surface(1), point_data={name: np.ones(len(ball_surface(1).points), np.float32)})
    write_surface(surface, tmp_path / "s.surf.gii")
    assert list(read_surface(tmp_path / "s.surf.gii").point_data) == ["____evil"]
    folder = tmp_path / "deep" / "er"
    source = folder / "m.vtu"
    FORMATS["vtu"].write(replace(mesh, point_data={name: mesh.point_data["thickness"]}), source)
    convert(source, folder / "out.pts", source_unit="mm")
    outside = [path for path in tmp_path.rglob("*") if path.is_file() and path.parent != folder]
    assert outside == [tmp_path / "s.surf.gii"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fields", []),
        ("fields", {"thickness": 3}),
        ("units", 3),
        ("coordinate_system", {"matrix": [1]}),
        ("made_from", {"given": {}, "meshed": {}, "gestational_age": "28"}),
        ("coordinate_system", {"dataspace": "x", "xformspace": "x", "matrix": [float("inf")] * 16}),
    ],
)
def test_a_sidecar_of_another_kind_is_refused(key: str, value: object, mesh, tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    export(mesh, path, solver="vtu", certificate={"certified": True})
    record = json.loads(sidecar_path(path).read_text())
    sidecar_path(path).write_text(json.dumps({**record, key: value}))
    with pytest.raises(InputError, match="is not a sidecar"):
        convert(path, tmp_path / "n.mesh", source_unit="mm")


def test_a_sidecar_deletes_no_other_files_and_leads_to_no_device(mesh, tmp_path: Path) -> None:
    path, other = tmp_path / "m.vtu", tmp_path / "precious.gii"
    other.touch()
    export(mesh, path, solver="vtu", certificate={"certified": True})
    record = json.loads(sidecar_path(path).read_text())
    record["files"] |= {"precious.gii": "", "../precious.gii": "", "m" * 300: "", "m\0": ""}
    record["fields"]["thickness"] |= {"source": "/dev/zero"}
    sidecar_path(path).write_text(json.dumps(record))
    export(mesh, path, solver="vtu", certificate={"certified": True})
    assert other.exists()


def test_names_stay_apart_and_many_of_the_same_take_no_time() -> None:
    assert list(safely_named([("a", 1), ("a", 2), ("a_2", 3), ("x/../y\n", 4), ("", 5)])) == [
        *("a", "a_2", "a_2_2", "x___y_", "unnamed")
    ]
    began = time.process_time()
    assert len(safely_named([("a", 1)] * 100_000)) == 100_000
    assert time.process_time() - began < 5


def test_numbers_of_gifti_text_are_read_without_a_table_of_words(tmp_path: Path) -> None:
    def read(words: str, kind: str = "INT32") -> np.ndarray:
        path = tmp_path / "x.shape.gii"
        attributes = f'Dimensionality="1" Dim0="{len(words.split())}" Encoding="ASCII" DataType="NIFTI_TYPE_{kind}"'
        array = f'<DataArray Intent="NIFTI_INTENT_SHAPE" {attributes}><Data>{words}</Data></DataArray>'
        path.write_text(f"<GIFTI>{array}</GIFTI>")
        return read_fields(path)["x"]

    assert read("1 -2 3").tolist() == [1, -2, 3] and read("1.5 nan", "FLOAT32")[0] == 1.5
    assert len(read("0." + "0" * 1_000_000 + " 1" * 100_000, "FLOAT64")) == 100_001
    for words in ("99999999999", "1.5", "9" * 5000, "x"):
        with pytest.raises(InputError, match="SHAPE"):
            read(words)


def sheet(folder: Path, *values: str) -> Path:
    row = dict(zip(COLUMNS, ("007", "01", "L", "27.5", "a.surf.gii", "yes", "n/a"), strict=True))
    names = [*COLUMNS, "site"]
    row |= {"site": "x"} | dict(zip(values[::2], values[1::2], strict=True))
    path = folder / "cohort.tsv"
    path.write_text("\t".join(names) + "\n" + "\t".join(row[name] for name in names) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("column", ["participant_id", "session_id", "hemi"])
@pytest.mark.parametrize(
    "value",
    [
        *("../x", "/etc/x", "..", ".", "a/b", "a\\b", "$(reboot)", "`id`", "a;b", "a b", "a\x00b", "a\x0bb"),
        *("{case}", "*", "~", "-rf", "a.b", "\u0430bc", "\uff11\uff12", "a\u202eb", "a\u2028b", "%2e%2e"),
        *("a\ud7ffb", "con:", "x" * 41),
    ],
)
def test_labels_that_become_names_of_files_are_letters_and_digits(column: str, value: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"line 2, column {column}"):
        read_sheet(sheet(tmp_path, column, value))


def test_surfaces_may_lie_anywhere_and_are_only_read(tmp_path: Path) -> None:
    (case,) = read_sheet(sheet(tmp_path, "surface", "../../release/$(x) `y`; z/a.surf.gii"))
    assert case.surface == Path(os.path.normpath(tmp_path / "../../release/$(x) `y`; z/a.surf.gii"))
    (case,) = read_sheet(sheet(tmp_path, "surface", "/data/a.surf.gii"))
    assert case.surface == Path("/data/a.surf.gii")
    for value in ("a\x00b", "a\x1bb", "{x}", "*", "x" * 5000, "a\u2028b"):
        with pytest.raises(InputError, match="column surface"):
            read_sheet(sheet(tmp_path, "surface", value))
    with pytest.raises(InputError, match="column site: .* control character"):
        read_sheet(sheet(tmp_path, "site", "a\x1b[2Jb"))


@pytest.mark.parametrize("pattern", ["{site:>9999999999}", "{site.__class__}", "{0}", "{}", "a\0{site}", "{{site}}"])
def test_patterns_of_fields_are_filled_in_and_nothing_else(pattern: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be filled in"):
        read_sheet(sheet(tmp_path), {"thickness": pattern})
    for of_release in ("/etc/{participant}", "", "x", "\0{participant}"):  # it stays below the release
        with pytest.raises(InputError, match=r"cohort\.scan\.surfaces"):
            scan(tmp_path, Scan(surfaces=[of_release]))


def test_the_longest_names_of_files_fit_and_longer_ones_are_refused(tmp_path: Path) -> None:
    label = "x" * LONGEST_LABEL
    name = f"sub-{label}_ses-{label}_hemi-L_res-10000um_desc-latticePublishedBoundarySmoothed_tetmesh.quality.json"
    inner = f"sub-{label}_ses-{label}_hemi-L_res-10000um_inner-{label}_desc-separated_white.surf.gii"
    assert max(len(f".1234567-12345678.{one}") for one in (name, inner)) < 255
    path = sheet(tmp_path, "surface", "phantom")
    head, row = path.read_text().splitlines()
    path.write_text(f"{head}\tinner_{label}x\n{row}\ta.surf.gii\n")
    with pytest.raises(InputError, match="too many"):
        read_sheet(path)
    write_sheet([Case("a", None, "L", 24.5, Path(f"{'s' * 256}.surf.gii"))], tmp_path / "cohort.tsv")
    with pytest.raises(InputError, match="file name"):
        read_sheet(tmp_path / "cohort.tsv")


def test_a_sheet_of_many_bad_rows_or_columns_is_refused_in_a_short_message(tmp_path: Path) -> None:
    path = tmp_path / "cohort.tsv"
    path.write_text("\t".join(COLUMNS) + "\n" + "x\n" * 100_000)
    with pytest.raises(InputError, match=r"100000 problem\(s\)"):
        read_sheet(path)
    path.write_text("\t".join([*COLUMNS, *map(str, range(1_000_000))]) + "\nx\n")
    with pytest.raises(InputError) as caught:
        read_sheet(path)
    assert len(str(caught.value)) < 25_000


def test_a_message_about_long_values_is_short() -> None:
    error = InputError("a" * 500_000, file="b" * 500_000, remedy="c" * 500_000)
    assert len(str(error)) < 40_000 and len(error.what) == len(error.remedy or "") < 11_000
    assert "[... 490,000 characters ...]" in error.what
