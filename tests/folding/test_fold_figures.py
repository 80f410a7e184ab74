"""Figures and film of a run, and the command that makes a run; all without a display."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from shapes import ball_mesh, ball_surface

from cortet.cli import main
from cortet.errors import InputError
from cortet.folding import fold_figures
from cortet.folding.fold_figures import numbers
from cortet.folding.fold_views import brain_of
from cortet.folding.journal import per_percent, series, status
from cortet.folding.measurements import Measurements
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.formats.ownership import MANIFEST
from cortet.formats.tsv import read_tsv


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball folded for two tenths of a week by the command."""
    folder = tmp_path_factory.mktemp("run")
    vtu.write(ball_mesh(2, radius=10.0), folder / "ball.vtu")
    (folder / "fold.yaml").write_text("fold: {force: true, thickness: 3, frame_interval: 0.1}\n")
    write_surface(ball_surface(3, radius=14.0), folder / "real.surf.gii")
    options = ["--ga", "22", "--hemi", "L", "--end", "22.2", "--config", str(folder / "fold.yaml"), "--threads", "1"]
    options += ["--real", f"22.3={folder / 'real.surf.gii'}"]
    assert main(["fold", str(folder / "ball.vtu"), "-o", str(folder / "out"), *options]) == 0
    return folder / "out"


def test_the_command_makes_everything_and_drawing_again_gives_the_same_files(run):
    assert {path.name for path in run.iterdir()} == {
        "fold.tsv", "fold.json", "fold.pvd", "frames", "verdict.json",
        "folding.svg", "folded.png", "folding.gif", MANIFEST,
    }  # fmt: skip
    with Image.open(run / "folding.gif") as film:
        assert film.n_frames >= 3 and film.size == (800, 640)
    before = {name: (run / name).read_bytes() for name in ("folding.svg", "folded.png", "folding.gif")}
    fold_figures.draw(run, "L", {22.3: run.parent / "real.surf.gii"})
    assert {name: (run / name).read_bytes() for name in before} == before
    with pytest.raises(InputError, match=r"fold\.pvd"):
        series(run / "frames/fold.pvd")


def test_the_figure_shows_what_the_table_holds(run):
    figure, rows = numbers(run / "fold.tsv", "L"), read_tsv(run / "fold.tsv").apply(pd.to_numeric, errors="coerce")
    shown = {axis.get_ylabel(): axis.lines[0] for axis in figure.axes}
    units = {
        "gyrification index": ("gyrification_index", 1), "area (cm²)": ("area_mm2", 100),
        "volume (mL)": ("volume_mm3", 1000), "hull volume (mL)": ("hull_volume_mm3", 1000),
        "width of folds (mm)": ("fold_spacing_mm", 1), "depth of sulci (mm)": ("sulcal_depth_mm", 1),
        "smallest $J$": ("min_j", 1), "largest $q$": ("q_max", 1),
    }  # fmt: skip
    assert shown.keys() == units.keys()
    for label, (column, unit) in units.items():
        assert np.asarray(shown[label].get_ydata()) == pytest.approx(rows[column].to_numpy() / unit, nan_ok=True)
        assert np.asarray(shown[label].get_xdata()) == pytest.approx([22, 22.1, 22.2], abs=0.02)
    for hemisphere, sources in (("L", 4), (None, 1)):  # of real brains, each named in the legend
        (legend,) = numbers(run / "fold.tsv", hemisphere).legends
        assert len(legend.get_texts()) == 1 + sources


def test_rows_are_in_even_steps_with_one_for_every_real_brain_and_others_are_named(monkeypatch, tmp_path, caplog):
    surface = ball_surface(2)
    brain = brain_of(surface, np.zeros(len(surface.points), bool))
    monkeypatch.setattr(fold_figures, "simulated_brain", lambda _: brain)
    monkeypatch.setattr(fold_figures, "real_brain", lambda *_: brain)

    def rows(ages: list[float], real: list[float]) -> list[tuple[float, str]]:
        files = {age: tmp_path / f"real{age:g}.surf.gii" for age in real}
        for path in files.values():
            path.touch()
        found = fold_figures.rows_of([(Path(f"{age}.vtu"), age) for age in ages], "L", files)
        return [(row.age, row.name) for row in found]

    weekly = [float(age) for age in range(22, 41)]
    assert [age for age, _ in rows(weekly, [])] == [22, 25, 28, 31, 34, 37, 40]
    assert [age for age, name in rows(weekly[:9], [26.2, 28.4]) if name] == [26, 28] and not caplog.messages
    assert [age for age, name in rows([30.0, 31.0], [22.0, 30.4, 30.1]) if name] == [30]
    assert "real22.surf.gii" in caplog.text and "real30.4.surf.gii" in caplog.text


@pytest.mark.parametrize(
    ("option", "word"),
    [
        ("30", "'30'"),
        ("old=x.surf.gii", "'old'"),
        ("30=gone.surf.gii", "gone.surf.gii"),
        ("30=right.surf.gii", "hemisphere R"),
    ],
)
def test_a_real_brain_that_cannot_be_is_refused_before_the_work(option, word, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vtu.write(ball_mesh(2, radius=10.0), tmp_path / "ball.vtu")
    write_surface(ball_surface(2), tmp_path / "right.surf.gii")
    image = nibabel.load("right.surf.gii")
    image.meta["AnatomicalStructurePrimary"] = "CortexRight"
    Path("right.surf.gii").write_bytes(image.to_xml())
    try:
        code = main(["fold", "ball.vtu", "--ga", "22", "--hemi", "L", "-o", "out", "--real", option])
    except SystemExit as ended:
        code = ended.code
    assert code and word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_log_gets_a_line_per_percent_with_what_is_left():
    now = Measurements(**dict.fromkeys(Measurements.__dataclass_fields__, 1.0))
    said: list[str] = []
    progress = per_percent(said.append)
    for part in (0.0, 0.004, 0.011, 0.012, 0.5, 1.0):
        progress(now, part, 10.0)
    assert [line.split("] ")[1][:4].strip() for line in said] == ["0%", "1%", "50%", "100%"]
    assert "3 min left" in status(now, 0.25, 60.0)
