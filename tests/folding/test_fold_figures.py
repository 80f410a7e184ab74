"""What is measured and drawn of folds: their width and depth, figures and film of a run, and the table of all runs."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from shapes import ball_mesh, ball_surface

from cortet.cli import main
from cortet.config import load
from cortet.errors import InputError
from cortet.folding import fold_figures
from cortet.folding.fold_views import (
    Brain,
    sides,
    view,
)
from cortet.folding.journal import series
from cortet.folding.measurements import folds_of, mean_curvature, shape
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.formats.ownership import MANIFEST
from cortet.meshes import TriSurface

# --- width and depth of known folds


RADIUS = 30.0


def rippled(waves: int, height: float) -> tuple[TriSurface, np.ndarray]:
    """A sphere with so many meridional waves around its equator; only the equator's neighbourhood is cortex."""
    ball = ball_surface(5, radius=RADIUS)
    x, y, z = ball.points.T
    radius = 1 + height / RADIUS * np.cos(waves * np.arctan2(y, x)) * (1 - (z / RADIUS) ** 2)
    return TriSurface(ball.points * radius[:, None], ball.faces), (np.abs(z) < 5).astype(float)


@pytest.mark.parametrize(("waves", "height"), [(16, 0.05), (16, 0.2), (16, 1.5), (10, 1.5)])
def test_the_wavelength_and_spacing_of_known_waves_of_any_height(waves, height):
    """Those of 0.05 and 0.2 mm do not make the surface concave."""
    surface, cortex = rippled(waves, height)
    found = folds_of(surface.points, surface.faces, cortex)
    if waves == 16:
        assert found.wavelength == pytest.approx(2 * np.pi * RADIUS / waves, rel=0.15)
    assert found.spacing == (pytest.approx(2 * np.pi * RADIUS / waves, rel=0.15) if height > 1 else None)


def test_a_ball_is_curved_alike_everywhere_and_has_no_folds():
    ball = ball_surface(4, radius=RADIUS)
    everywhere = np.ones(len(ball.points))
    assert np.median(mean_curvature(ball.points, ball.faces)) == pytest.approx(1 / RADIUS, rel=1e-2)
    assert folds_of(ball.points, ball.faces, everywhere).spacing is None
    depth = shape(ball.points, ball.faces, everywhere == 0, np.nan)["sulcal_depth_mm"]
    assert depth == pytest.approx(0, abs=1e-9)


def test_the_depth_of_known_waves():
    surface, cortex = rippled(16, height=1.5)
    # the mean of 1.5 (1 - cos), less what the hull, straight from crest to crest, cuts off the sphere: spacing^2 / 12 R
    expected = 1.5 - (2 * np.pi * RADIUS / 16) ** 2 / (12 * RADIUS)
    depth = shape(surface.points, surface.faces, cortex == 0, np.nan)["sulcal_depth_mm"]
    assert depth == pytest.approx(expected, rel=0.1)


# --- a run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball folded for two tenths of a week by the command."""
    folder = tmp_path_factory.mktemp("run")
    vtu.write(ball_mesh(2, radius=10.0), folder / "ball.vtu")
    keys = f"force: true, thickness: 3, frame_interval: 0.1, real_surfaces: {{22.3: {folder / 'real.surf.gii'}}}"
    (folder / "fold.yaml").write_text(f"fold: {{{keys}}}\n")
    write_surface(ball_surface(3, radius=14.0), folder / "real.surf.gii")
    options = ["--ga", "22", "--hemi", "L", "--end", "22.2", "--config", str(folder / "fold.yaml")]
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


@pytest.mark.parametrize(("file", "word"), [("gone.surf.gii", "gone.surf.gii"), ("right.surf.gii", "hemisphere R")])
def test_a_real_brain_that_cannot_be_is_refused_before_the_work(file, word, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vtu.write(ball_mesh(2, radius=10.0), tmp_path / "ball.vtu")
    write_surface(ball_surface(2), tmp_path / "right.surf.gii")
    image = nibabel.load("right.surf.gii")
    image.meta["AnatomicalStructurePrimary"] = "CortexRight"
    Path("right.surf.gii").write_bytes(image.to_xml())
    Path("real.yaml").write_text(f"fold: {{real_surfaces: {{30: {file}}}}}\n")
    assert main(["fold", "ball.vtu", "--ga", "22", "--hemi", "L", "-o", "out", "--config", "real.yaml"]) == 1
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# --- brains in pictures


def box(size: tuple[float, float, float], red: int | None = None) -> Brain:
    """A ball stretched to these extents, all of it grey but for its half on one side: `red` is 0 for -x to 5 for +z."""
    ball = ball_surface(3, radius=0.5)
    colour = np.full(len(ball.points), np.nan)
    if red is not None:
        colour[(2 * (red % 2) - 1) * ball.points[:, red // 2] > 0.02] = 0.3
    return Brain(TriSurface(ball.points * size, ball.faces), colour)


@pytest.mark.parametrize("hemisphere", ["L", "R", None])
def test_what_is_said_of_directions_is_what_is_seen(hemisphere):
    for side in sides(hemisphere):
        front, size = box((20.0, 60.0, 40.0), red=3), (160, 160)
        image = view(front, side, np.zeros(3), size, 2.0).astype(int)
        red = image[:, :, 0] - image[:, :, 2] > 60
        on_the_right = red[:, 80:].mean() > red[:, :80].mean()
        assert side.directions.split(",")[0] == ("anterior right" if on_the_right else "anterior left")
    midline = box((20.0, 60.0, 40.0), red=0 if hemisphere == "R" else 1)
    image = view(midline, sides(hemisphere)[2], np.zeros(3), (160, 160), 2.0).astype(int)
    red = image[:, :, 0] - image[:, :, 2] > 60
    assert red[:80].mean() > 5 * red[80:].mean()  # "midline up"; of a whole brain, the right side


@pytest.mark.parametrize(
    "variant",
    [{"thicknes": 1.0}, {"thickness": -1.0}, {}, {"cases": "all"}, {"real_surfaces": {}}, {"picture": "depth"}],
)
def test_a_variant_changes_keys_of_fold_that_there_are(variant):
    config = load({"fold": {"variants": {"thin": {"thickness": 1.0}}}})
    assert config.fold.variants["thin"] == {"thickness": 1.0} and "variants" not in config.fold.values()
    with pytest.raises((InputError, ValidationError), match="fold"):
        load({"fold": {"variants": {"thin": variant}}})
