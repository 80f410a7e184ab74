"""Brains in pictures are where they should be, as large as they should be, and in the right colours."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.folding.fold_views import (
    Brain,
    Row,
    bar_length,
    real_brain,
    sheet,
    sides,
    simulated_brain,
    view,
)
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.meshes import TetMesh, TriSurface


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


def test_all_brains_of_a_sheet_and_its_bar_have_one_scale():
    small, large = box((10.0, 30.0, 20.0)), box((20.0, 60.0, 40.0))
    figure = sheet([Row(22.0, small), Row(30.5, large, small, "atlas, 30 weeks")], "L")
    axis, margin = figure.axes[0], 4 / 600
    extents = [image.get_extent() for image in axis.images]
    widths = [np.ptp(one[:2]) - margin for one in extents]
    heights = [np.ptp(one[2:]) - margin for one in extents]
    assert len(widths) == 9 and widths[3] == pytest.approx(2 * widths[0], rel=0.02)
    assert heights[6] == pytest.approx(heights[0], rel=0.02)
    bar = next(line for line in axis.lines if line.get_linewidth() == 1.5)
    length = bar_length(7.2 * 60 / (widths[3] + margin)) / 60
    assert np.ptp(bar.get_xdata()) / widths[3] == pytest.approx(length, rel=0.02)
    assert {"22 weeks", "30.5 weeks", "atlas, 30 weeks"} <= {text.get_text() for text in axis.texts}


def test_a_frame_has_its_wall_and_a_real_hemisphere_finds_its_own(tmp_path):
    mesh = ball_mesh(2, radius=10.0)
    marks = (mesh.points[:, 0] > 8).astype(np.uint8)
    vtu.write(TetMesh(mesh.points, mesh.cells, {"medial_wall": marks}), tmp_path / "with.vtu")
    vtu.write(mesh, tmp_path / "without.vtu")
    brain = simulated_brain(tmp_path / "with.vtu")
    assert np.array_equal(np.isnan(brain.curvature), brain.surface.points[:, 0] > 8)
    assert not np.isnan(simulated_brain(tmp_path / "without.vtu").curvature).any()
    surface = ball_surface(4, radius=10.0)
    cut = surface.points.copy()
    cut[:, 0] = np.maximum(cut[:, 0], -7.0)
    write_surface(TriSurface(cut, surface.faces), tmp_path / "right.surf.gii")
    found = np.isnan(real_brain(tmp_path / "right.surf.gii", "R").curvature)
    assert found[cut[:, 0] == -7.0].mean() > 0.9 and cut[found, 0].max() < -6.0
    assert not np.isnan(real_brain(tmp_path / "right.surf.gii", None).curvature).any()
