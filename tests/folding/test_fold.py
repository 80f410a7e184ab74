"""A run: what it writes, that it can be killed and resumed, how it ends, and what it reads from the mesh."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from cubes import cube_mesh
from shapes import ball_mesh

from cortet.config import load
from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding import fold as fold_module
from cortet.folding.body import growth_mask, scale_of
from cortet.folding.cohort_folding import write_cohort_folding
from cortet.folding.fold import Verdict, fold
from cortet.folding.growth import Gompertz, Linear, age_of, by_age, growth_since, time_of
from cortet.folding.journal import TABLE
from cortet.folding.law import ALONG
from cortet.folding.measurements import COLUMNS, Measurements
from cortet.folding.models import CONSTANTS
from cortet.folding.plausible import cell_size_mm
from cortet.folding.run import beginning, prepared, thickness_mm
from cortet.folding.sentences import cells_in_words, fold_sentences, verdict_of_fold
from cortet.formats import braingrowth
from cortet.formats.tables import names
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import signed_volumes
from cortet.meshes import FILLED, TetMesh

SPHERE5 = Path(__file__).parents[3] / "shared/data/tallinen/sphere5.mesh"
#: a quick run: half a week, a row every tenth, a frame every fifth of one
QUICK = Settings(gestational_age=22.0, force=True, end=22.5, thickness=3.0, record_interval=0.1, frame_interval=0.2)


@pytest.fixture(scope="module")
def ball() -> TetMesh:
    """10 mm, the nodes and cells in no particular order."""
    mesh = ball_mesh(2, radius=10.0)
    node = np.random.default_rng(0).permutation(len(mesh.points))
    cells = np.argsort(node)[mesh.cells].astype(np.int32)
    return TetMesh(mesh.points[node] + [1.0, 2.0, 3.0], cells[np.random.default_rng(1).permutation(len(cells))])


def table(folder: Path) -> pd.DataFrame:
    return read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce")


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "checkpoint.npz"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def finished(ball: TetMesh, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Verdict]:
    folder = tmp_path_factory.mktemp("run")
    return folder, fold(ball, folder, QUICK)


def test_the_ball_grows_without_inversion(finished):
    folder, verdict = finished
    rows = table(folder)
    assert verdict.outcome == "folded"
    assert rows["gestational_age"].tolist() == pytest.approx([22, 22.1, 22.2, 22.3, 22.4, 22.5], abs=0.01)
    assert np.all(np.diff(rows["volume_mm3"]) > 0)
    assert rows["gyrification_index"].iloc[-1] == pytest.approx(1.0, abs=0.02)
    assert verdict.min_j == pytest.approx(rows["min_j"].min(), rel=1e-5)
    assert verdict.distortion_max == pytest.approx(rows["distortion_max"].max(), rel=1e-5)
    assert rows["step"].iloc[-1] == verdict.steps
    explained = json.loads((folder / "fold.json").read_text())
    assert list(explained) == names(COLUMNS) == list(rows) == list(Measurements.__dataclass_fields__)


def test_the_energies_balance(ball, tmp_path):
    # the longest stable step is a fifth of the first row; a ball whose cortex thins faster than it widens does work
    fold(ball, tmp_path, QUICK.with_keys(time_step=3e-4, growth_rate=0.024))
    rows = table(tmp_path)
    assert np.all(np.diff(rows["growth_work"]) > 0) and np.all(np.diff(rows["dissipated_energy"]) > 0)
    assert rows["energy_error"].abs().max() < 1e-2


def test_frames_are_meshes_in_the_users_numbering(ball, finished):
    folder, _ = finished
    frames = sorted((folder / "frames").glob("*.vtu"))
    assert len(frames) == 4  # 22, 22.2, 22.4 weeks and the end
    first, last = (meshio.read(path) for path in (frames[0], frames[-1]))
    assert np.abs(first.points - ball.points).max() < 0.01  # less its facets
    assert np.array_equal(first.cells[0].data, ball.cells)
    assert last.points - ball.points == pytest.approx(last.point_data["displacement"])
    assert signed_volumes(last.points, ball.cells).sum() == pytest.approx(
        table(folder)["volume_mm3"].iloc[-1], rel=1e-5
    )
    assert last.cell_data["J"][0].min() > 0.5
    assert (
        1 < last.cell_data["distortion"][0].max() == pytest.approx(table(folder)["distortion_max"].iloc[-1], rel=1e-5)
    )
    assert 0.9 < last.cell_data["growth"][0].max() < 1
    series = (folder / "fold.pvd").read_text()
    assert all(f'file="frames/{path.name}"' in series for path in frames)


@pytest.mark.parametrize("settings", [QUICK, QUICK.with_keys(core_relaxation=0.5)], ids=["elastic", "yielding"])
def test_a_killed_run_resumes_and_ends_with_the_same_bits(settings, ball, finished, tmp_path, monkeypatch):
    whole = finished[0]
    if settings is not QUICK:
        fold(ball, whole := tmp_path / "whole", settings)
    monkeypatch.setattr(fold_module, "_CHECKPOINT_SECONDS", 0.0)
    reached = []

    def killed_at_the_fourth(measurements: Measurements, part: float, seconds: float) -> None:
        reached.append(measurements.step)
        if len(reached) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fold(ball, tmp_path / "run", settings, killed_at_the_fourth)
    assert (tmp_path / "run/checkpoint.npz").exists()
    resumed: list[int] = []
    fold(ball, tmp_path / "run", settings, lambda measurements, *_: resumed.append(measurements.step))
    assert resumed[0] == reached[3]  # not from the beginning
    assert contents(tmp_path / "run") == contents(whole)

    for name in ("verdict.json", "fold.tsv", "fold.json", "fold.pvd"):  # as Snakemake before it starts a job again
        (tmp_path / "run" / name).unlink()
    again: list[int] = []
    fold(ball, tmp_path / "run", settings, lambda measurements, *_: again.append(measurements.step))
    assert again == resumed[-1:] and contents(tmp_path / "run") == contents(whole)


def test_a_checkpoint_of_another_run_is_not_used(ball, tmp_path, monkeypatch):
    monkeypatch.setattr(fold_module, "_CHECKPOINT_SECONDS", 0.0)

    def killed(measurements: Measurements, part: float, seconds: float) -> None:
        if part > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fold(ball, tmp_path, QUICK, killed)
    steps: list[int] = []
    other = Settings(gestational_age=22.0, force=True, end=22.4, thickness=3.0)
    fold(ball, tmp_path, other, lambda measurements, *_: steps.append(measurements.step))
    assert steps[0] == 0
    assert len(list((tmp_path / "frames").iterdir())) == 2  # nothing is left of the first


def test_it_ends_at_the_first_inverted_element_and_names_it(ball, tmp_path):
    wild = QUICK.with_keys(end=40.0, model="braingrowth", growth_rate=1000.0, record_interval=0.5)
    verdict = fold(ball, tmp_path, wild)
    assert verdict.outcome == "inverted"
    assert verdict.gestational_age < 40.0
    assert f"tetrahedron {verdict.element} " in verdict.reason
    assert table(tmp_path)["inverted"].iloc[-1] > 0
    last = meshio.read(sorted((tmp_path / "frames").glob("*.vtu"))[-1])
    assert not signed_volumes(last.points, ball.cells)[verdict.element] > 0
    written = json.loads((tmp_path / "verdict.json").read_text())
    assert written["outcome"] == "inverted" and written["distortion_max"] is None  # it was 1.0, of the first row
    assert written["settings"]["force"] is True and written["settings"]["growth_rate"] == 1000.0


def test_a_fold_of_strained_tetrahedra_says_from_which_week_on(ball, tmp_path):
    """The demonstration ended with a worst q of 0.988, and without a warning."""
    rate = {"model": "braingrowth", "growth_rate": 30.0, "record_interval": 0.5}
    verdict = fold(ball, tmp_path, QUICK.with_keys(end=40.0, **rate))
    rows = table(tmp_path)
    compressed = rows[rows["compressed_share"] > 1e-3]
    assert rows["compressed_share"].iloc[0] == 0 and len(compressed)
    said = next(warning for warning in verdict.warnings if "less than 0.5" in warning)
    assert said.startswith(f"from {compressed['gestational_age'].iloc[0]:.1f} weeks on more than 0.1 %")
    assert verdict.compressed_share == pytest.approx(rows["compressed_share"].max(), rel=1e-5)
    assert verdict.distorted_share == pytest.approx(rows["distorted_share"].max(), rel=1e-5)
    assert rows["distortion"].iloc[0] == 1 < rows["distortion"].iloc[1] < rows["distortion_max"].iloc[1]


def test_the_methods_paragraph_tells_of_folds(finished):
    folder, verdict = finished
    told = " ".join(fold_sentences({"ball": verdict_of_fold(folder)}))
    assert "1 fold by growth of the cortex (model growing, " in told and "thickness = 3.0" in told
    assert (
        "from a gestational age of 22 weeks until one of 22.5 weeks" in told
        and f"index was {verdict.gyrification_index_last:.3f}" in told
    )
    assert "force = true" in told and f"Doubts about folds: ball ({verdict.warnings[0]}" in told


def test_a_share_with_a_large_q_of_an_earlier_version_is_not_told_as_one_of_elastic_distortion(finished, tmp_path):
    earlier = json.loads((finished[0] / "verdict.json").read_text()) | {"q_max": 0.9, "distorted_share": 0.31}
    del earlier["distortion_max"]
    (tmp_path / "verdict.json").write_text(json.dumps(earlier))
    shutil.copy(finished[0] / TABLE, tmp_path)
    run = {"case": "ball", "variant": None, "cell_size_mm": 2.5, "mesher": "lattice", "hemisphere": None}
    runs = [{**run, "folder": tmp_path}, {**run, "case": "ball2", "folder": finished[0]}]
    write_cohort_folding(runs, [], [tmp_path / "cohort_folding.tsv"])
    shares = read_tsv(tmp_path / "cohort_folding.tsv")["distorted_share"].tolist()
    assert shares == ["n/a", "0"] and not verdict_of_fold(tmp_path)


def test_a_fold_says_what_smaller_cells_would_change(finished, ball, tmp_path):
    """The error of the cells grows with their square, so half of the size is a quarter of the error."""
    coarse, fine = (cell_size_mm(prepared(ball_mesh(level, radius=10.0), QUICK)) for level in (1, 2))
    assert coarse / fine == pytest.approx(2, rel=0.1)
    _, too_coarse = finished
    thick = fold(ball, tmp_path / "thick", QUICK.with_keys(end=22.1, thickness=5.0))
    assert too_coarse.cell_size_mm == thick.cell_size_mm == pytest.approx(fine, rel=0.01)
    assert thick.gyrification_index_error is not None
    told = {"cell_size_mm": 0.44, "gyrification_index_error": 0.0294, "fold_spacing_error_mm": 0.86}
    assert cells_in_words(told) == (
        "With far smaller cells than these of 0.44 mm the gyrification index would be about 0.029 higher, and folds "
        "0.9 mm narrower"
    )
    other = fold(ball, tmp_path / "other", QUICK.with_keys(end=22.1, thickness=5.0, model="braingrowth"))
    for unknown in (too_coarse, other):  # not measured with such cells, and with this model
        assert unknown.gyrification_index_error is None and not cells_in_words(vars(unknown))


def test_no_cortex_grows_around_the_callosum_of_a_whole_brain(ball):
    flat = TetMesh((ball.points - [1, 2, 3]) * [1, 1, 0.4], ball.cells)
    mask = growth_mask(flat, scale_of(flat, None))
    values = np.linspace(-1e-7, 1 + 1e-7, len(flat.points)).astype(np.float32)
    clipped = growth_mask(replace(flat, point_data={"growth": values}), scale_of(flat, None))
    assert (clipped.min(), clipped.max()) == (0, 1), "rounding"
    surface = boundary_nodes(flat)
    distance = np.linalg.norm(flat.points[surface], axis=1)
    assert not mask[surface][distance < 4.9].any()
    assert (mask[surface][distance > 6.1] == 1).all()


def test_caps_on_holes_of_the_file_do_not_grow(ball):
    scale, top = scale_of(ball, None), ball.points[:, 2] > 0.9 * ball.points[:, 2].max()
    wall = ball.points[:, 0] < 0.9 * ball.points[:, 0].min()
    without = growth_mask(ball, scale, wall)
    mask = growth_mask(replace(ball, point_data={FILLED: top.astype(np.int32)}), scale, wall)
    surface = boundary_nodes(ball)
    assert without[surface][top[surface]].all() and not mask[surface][top[surface]].any()
    far = ball.points[:, 2] < 0
    assert np.array_equal(mask[far], without[far])
    assert np.array_equal(growth_mask(replace(ball, point_data={FILLED: 0 * top}), scale, wall), without)


@pytest.mark.parametrize("model", ["growing", "braingrowth"])
def test_fields_of_the_mesh_replace_the_defaults(ball, model):
    upper = ball.points[:, 2] > 3.0
    fields = {"growth": 1.0 * upper, "thickness": np.where(upper, 2.0, 1.0), "label": np.where(upper, 7, 3)}
    mesh = TetMesh(ball.points, ball.cells, fields)
    run = prepared(mesh, Settings(gestational_age=22.0, model=model, regions={7: (2.0, 5.0, 0.4)}))
    height = run.mesh.points[run.body.cells][:, :, 2]
    low, high = height.max(axis=1) <= 3.0, height.min(axis=1) > 3.0
    grows, other = (run.body.amount, run.body.mask) if model == "growing" else (run.body.mask, run.body.amount)
    assert not grows[low].any() and (grows[high] == 1).all()
    assert other[run.body.depth < 0.1].max() == 1  # a place that grows little is as stiff as others
    assert run.body.thickness[low] * run.scale.length == pytest.approx(1.0)
    assert run.body.thickness[high] * run.scale.length == pytest.approx(2.0)
    assert not run.body.label[low].any() and (run.body.label[high] == 1).all()
    ((first, second),) = run.growth.at(np.array([time_of(30.0)]), 0.0).growth
    laws = Linear(1.829), Gompertz(2.0, 5.0, 0.4)
    start, later = time_of(22.0), time_of(30.0)
    assert second[ALONG] == pytest.approx(growth_since(laws[1], start, later))
    usual = float(by_age(CONSTANTS["growing"].growth_rate)(np.array([30.0]))[0])
    expected = growth_since(laws[0], start, later) if model == "braingrowth" else usual
    assert first[ALONG] == pytest.approx(expected)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("hemisphere", [None, "L"])
@pytest.mark.parametrize("fault", ["half of them", "one", "flat"])
def test_an_inverted_mesh_is_refused_before_anything_is_computed(tmp_path, fault, hemisphere):
    """Half of all tetrahedra inverted have no volume together, by which a centroid would divide."""
    mesh = cube_mesh(4, side=60.0)
    cells, points = mesh.cells.copy(), mesh.points.copy()
    if fault == "flat":
        points[:, 2] = 0
    else:
        turned = slice(None, None, 2) if fault == "half of them" else slice(5, 6)
        cells[turned] = cells[turned][:, [1, 0, 2, 3]]
    wrong, settings = TetMesh(points, cells), Settings(gestational_age=22.0, hemisphere=hemisphere)
    for checked in (lambda: fold(wrong, tmp_path, settings), lambda: prepared(wrong, settings)):
        with pytest.raises(InputError, match="inverted.* tetrahedron 5" if fault == "one" else "inverted"):
            checked()


@pytest.mark.parametrize(("hemisphere", "side"), [("L", -1.0), ("R", 1.0)])
@pytest.mark.parametrize(("aspect", "length"), [((0.5, 1, 0.6), 10.0), ((0.8, 1, 0.6), 16.0), ((0.3, 0.5, 1), 10.0)])
def test_a_brain_and_half_of_one_have_the_unit_of_the_reference(ball, hemisphere, side, aspect, length):
    mesh = TetMesh(ball.points * aspect, ball.cells)
    settings = Settings(gestational_age=22.0, hemisphere=hemisphere, model="braingrowth")
    run = prepared(mesh, settings)
    assert run.scale.length == pytest.approx(length, rel=0.02)  # half its length, its width, half its height
    assert thickness_mm(run) == pytest.approx(0.042 * run.scale.length, rel=0.01)
    assert (side * beginning(run).state.x[:, 0]).min() == pytest.approx(0, abs=1e-12)
    for reference in (False, True):
        x = beginning(prepared(mesh, settings.with_keys(hemisphere=None, reference=reference))).state.x
        assert np.abs(x).max() == pytest.approx(1)


@pytest.mark.parametrize(
    ("settings", "fields", "word"),
    [
        ({"gestational_age": 40.0, "end": 30.0}, {}, "end at 30 weeks"),
        ({"regions": {1: (1.0, 1.0, 1.0)}}, {}, "label"),
        ({"regions": {9: (1.0, 1.0, 1.0)}}, {"label": 1}, "9"),
        ({"core_regions": {2: -0.01}}, {}, "region"),
        ({"growth_rate": {22: 0, 40: -1.5}}, {}, "growth_rate"),
        ({"thickness_rate": -0.1}, {}, "thickness_rate"),
        ({"volume": {"26": 30.0, "27": 0.001}}, {}, "volume.*27"),  # ages as a rule hands them over
        ({"gestational_age": 12.0}, {}, "12.* 20 to 60"),
        ({"gestational_age": np.nan}, {}, "nan"),
        ({}, {"filled": np.nan}, "filled"),
        ({}, {"thickness": np.inf}, "thickness"),
        ({}, {"thickness": [1.0, 1.0, 1.0]}, "thickness"),
        ({}, {"thickness": -1.0}, "thickness"),
        ({"hemisphere": "L"}, {"medial_wall": np.nan}, "medial_wall"),
        ({}, {"growth": 1.001}, "growth.*1.001"),
    ],
)
def test_what_cannot_be_folded_is_refused(ball, settings, fields, word):
    data = {name: np.array([value] * len(ball.points)) for name, value in fields.items()}
    with pytest.raises(InputError, match=word):
        prepared(TetMesh(ball.points, ball.cells, data), Settings(**{"gestational_age": 22.0, **settings}))


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"reference": True}, "braingrowth"),
        ({"model": "braingrowth", "volume": {22: 20}}, "growing"),
        ({"model": "braingrowth", "growth_rate": {22: 0}}, "growth_rate"),
        ({"variants": {"b": {"model": "braingrowth", "volume": {22: 2}}}}, "variant b"),
        ({"growth_rate": {22: 0, 30: "much"}}, "growth_rate.30"),
        ({"growth_rate": {5: 0.1}}, "growth_rate.5"),
        ({"growth_rate": {}}, "growth_rate"),
        ({"region_stiffness": {"tissue_thalamus": 0.0}}, "region_stiffness"),
        ({"thickness": 0.0}, "thickness"),
    ],
)
def test_settings_of_no_run_are_refused(settings, word):
    with pytest.raises(InputError, match=word):
        load({"fold": settings})


def test_the_references_sphere_grows_as_in_the_reference(tmp_path):
    """Its own run has, after step 447, these areas and volumes relative to the start, and this gyrification index."""
    if not SPHERE5.exists():
        pytest.skip("needs ../shared/data/tallinen")
    step = 0.05 * (0.01 / 5) ** 0.5 * 0.01
    age = {"gestational_age": age_of(0.0), "end": age_of(0.01), "time_step": step, "record_interval": 0.05}
    fold(braingrowth.read(SPHERE5), tmp_path, Settings(**age, model="braingrowth", reference=True))
    rows = table(tmp_path)
    columns = ("area_mm2", "volume_mm3", "gyrification_index")
    area, volume, index = (np.interp(447 * step, rows["time"], rows[column]) for column in columns)
    found = area / rows["area_mm2"].iloc[0], volume / rows["volume_mm3"].iloc[0], index
    assert found == pytest.approx((1.0020033, 1.0029693, 0.99997801), rel=1e-6)
