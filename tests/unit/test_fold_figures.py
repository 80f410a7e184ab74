"""Figures and film of a run, and the command that makes a run; all without a display."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from PIL import Image
from shapes import ball_mesh

from cortet.cli import main
from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.ownership import MANIFEST
from cortet.report.fold_figures import numbers, series
from cortet.simulation.journal import per_percent, reached, status
from cortet.simulation.measurements import Measurements


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball folded for two tenths of a week by the command."""
    folder = tmp_path_factory.mktemp("run")
    vtu.write(ball_mesh(2, radius=10.0), folder / "ball.vtu")
    (folder / "fold.yaml").write_text("fold: {thickness: 3, frame_interval: 0.1}\n")
    options = ["--ga", "22", "--hemi", "L", "--end", "22.2", "--config", str(folder / "fold.yaml"), "--threads", "1"]
    assert main(["fold", str(folder / "ball.vtu"), "-o", str(folder / "out"), *options]) == 0
    return folder / "out"


def test_the_command_makes_everything(run: Path) -> None:
    assert {path.name for path in run.iterdir()} == {
        "fold.tsv", "fold.json", "fold.pvd", "frames", "seconds.tsv", "verdict.json",
        "folding.svg", "folded.png", "folding.gif", MANIFEST,
    }  # fmt: skip


def test_the_figure_shows_what_the_table_holds(run: Path) -> None:
    figure = numbers(run / "fold.tsv", "L")
    assert [axis.get_ylabel() for axis in figure.axes] == [
        "gyrification index", "area / volume$^{2/3}$", "smallest J", r"$q_\mathrm{max}$",
    ]  # fmt: skip
    ages = figure.axes[0].lines[0].get_xdata()
    assert np.asarray(ages) == pytest.approx([22, 22.1, 22.2], abs=0.02)


@pytest.mark.parametrize(("hemisphere", "fetal", "newborn"), [("L", 9, 9), (None, 1, 0)])
def test_the_curves_stand_on_real_brains(run: Path, hemisphere: str | None, fetal: int, newborn: int) -> None:
    for axis in numbers(run / "fold.tsv", hemisphere).axes[:2]:
        before_birth, after = (points.get_offsets() for points in axis.collections)
        assert len(before_birth) == fetal and len(after) == newborn
        assert max(age for age, _ in before_birth) <= 37
    assert not numbers(run / "fold.tsv", "L").axes[2].collections


def test_before_and_after_are_seen_from_three_sides_in_colour_and_the_wall_in_grey(run: Path) -> None:
    image = matplotlib.image.imread(run / "folded.png")[:, :, :3]
    views = [
        view
        for row in np.array_split(image, 2, axis=0)
        for view in np.array_split(row[:, : int(0.85 * row.shape[1])], 3, axis=1)
    ]
    for view in views:
        coloured = np.ptp(view, axis=2) > 0.2
        assert 0.05 < coloured.mean() < 0.9
    grey = [((np.ptp(view, axis=2) < 0.02) & (view[:, :, 0] < 0.7)).mean() for view in views]
    assert grey[1] > 0.02 and grey[4] > 0.02  # from the middle
    assert grey[0] < 0.01 and grey[3] < 0.01  # from the side


def test_the_film_has_an_image_per_frame(run: Path) -> None:
    with Image.open(run / "folding.gif") as film:
        assert film.n_frames >= 3
        assert film.size == (800, 640)


def test_drawing_again_gives_the_same_files(run: Path, tmp_path: Path) -> None:
    from cortet.report.fold_figures import draw

    before = {name: (run / name).read_bytes() for name in ("folding.svg", "folded.png", "folding.gif")}
    draw(run, "L")
    assert {name: (run / name).read_bytes() for name in before} == before


def test_a_missing_series_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fold\.pvd: cannot be read"):
        series(tmp_path / "fold.pvd")


def test_an_inverted_element_shows_in_the_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vtu.write(ball_mesh(2, radius=10.0), tmp_path / "ball.vtu")
    (tmp_path / "fold.yaml").write_text("fold: {growth_rate: 1000}\n")
    options = ["--ga", "22", "--config", str(tmp_path / "fold.yaml"), "--threads", "1"]
    assert main(["fold", str(tmp_path / "ball.vtu"), "-o", str(tmp_path / "out"), *options]) == 1
    assert "inverted (J = " in capsys.readouterr().out


def test_the_progress_line_says_how_far_and_how_long() -> None:
    now = Measurements(
        step=10, time=0.25, gestational_age=27.1, kinetic_energy=0.0, elastic_energy=0.0, dissipated_energy=0.0,
        growth_work=0.0, contact_work=0.0, energy_error=0.0, min_j=0.712, inverted=0, degenerate=0, q_max=0.5,
        gyrification_index=1.234, fold_spacing_mm=12.0, sulcal_depth_mm=1.0, area_mm2=1.0, volume_mm3=1.0,
        hull_volume_mm3=1.0, extent_lr_mm=1.0, extent_ap_mm=1.0, extent_is_mm=1.0, cortex_share=0.2,
        cortical_thickness_mm=1.0, concave_share=0.3, contacts=0,
    )  # fmt: skip
    assert status(now, 0.25, 60.0) == (
        "[#####...............]  25%  t 0.250  27.10 weeks  min J 0.712  gyrification 1.234  3 min left"
    )
    assert status(now, 0.0, 0.0).endswith("? left")


def test_another_terminal_can_ask_how_far_a_run_is(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["fold", "--status", str(run)])
    assert ended.value.code == 0
    line = capsys.readouterr().out.strip()
    assert line == reached(run)
    assert line.startswith("[####################] 100%") and "22.20 weeks" in line and line.endswith("0 s left")
    with pytest.raises(SystemExit) as ended:
        main(["fold", "--status", str(run / "frames")])
    assert ended.value.code != 0
    assert "no run has begun there" in capsys.readouterr().err


def test_a_log_gets_a_line_per_percent() -> None:
    values = dict.fromkeys(Measurements.__dataclass_fields__, 1.0)
    said: list[str] = []
    progress = per_percent(said.append)
    for part in (0.0, 0.004, 0.011, 0.012, 0.5, 1.0):
        progress(Measurements(**values), part, 10.0)
    assert [line.split("] ")[1][:4].strip() for line in said] == ["0%", "1%", "50%", "100%"]
