"""Pictures are drawn without a display and show meshes, sections and maps in their colours, with a scale bar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from cubes import cube_mesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from cortet.errors import InputError
from cortet.meshes import REGION, TetMesh
from cortet.report.colours import GREY, REGION_COLOURS
from cortet.report.render import _bar, _seen_from, picture
from cortet.report.slices import draw_section, middle_of, section


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)


def pixels(path: Path) -> np.ndarray:
    """(height, width, 3) uint8 of the part of the picture beside the scale."""
    image = matplotlib.image.imread(path)
    return np.round(255 * image[:, image.shape[1] // 4 :, :3]).astype(np.uint8)


def orange(image: np.ndarray) -> int:
    """Number of pixels in the colour of elements beyond the limit."""
    red, green, blue = (image[:, :, k].astype(int) for k in range(3))
    return int(((red > 1.8 * green) & (red > 3 * blue) & (red > 60)).sum())


def test_a_cut_mesh_fills_the_picture_and_elements_beyond_the_limit_stand_out(tmp_path):
    good = cube_mesh(4, side=10.0)
    for mesh, is_bad in ((good, False), (TetMesh(good.points * [1, 1, 0.2], good.cells), True)):
        picture(mesh, tmp_path / "a.png", size=(400, 300))
        image = pixels(tmp_path / "a.png")
        assert (orange(image) > 1000) is is_bad
        drawn = (image < 250).any(axis=2)
        assert image.shape == (300, 300, 3) and not drawn[0].any()
        assert is_bad or (drawn.any(axis=1).mean() > 0.9 and drawn[150].sum() > 150), "from top to bottom"


def test_the_scale_bar_of_an_oblique_view_is_horizontal_and_as_long_as_it_says():
    frame = _seen_from(1)
    first, last = _bar(cube_mesh(2, side=10.0).points, frame)
    assert frame @ (last - first) == pytest.approx([2, 0, 0])


def test_a_side_shows_the_mesh_from_there(tmp_path):
    """A slab that is 6 mm long in y, 3 mm in x and 1 mm in z: each side has a shape of its own."""
    mesh = cube_mesh(3, side=6.0)
    slab = replace(mesh, points=mesh.points * [0.5, 1, 1 / 6])
    shape = {}
    for view in ("left", "front", "top"):
        picture(slab, tmp_path / "a.png", position=1, view=view, size=(800, 600))
        coloured = np.ptp(matplotlib.image.imread(tmp_path / "a.png")[:, 200:, :3], axis=2) > 0.1
        rows, columns = np.flatnonzero(coloured.any(axis=1)), np.flatnonzero(coloured.any(axis=0))
        shape[view] = (np.ptp(columns) / np.ptp(rows)).round(1)
    assert shape == pytest.approx({"left": 6, "front": 3, "top": 0.5}, rel=0.2)  # edges have a width


def test_regions_have_their_colours_and_a_mesh_without_any_is_refused(tmp_path):
    mesh = cube_mesh(3, side=6.0)
    with pytest.raises(InputError, match="no regions"):
        picture(mesh, tmp_path / "a.png", regions=True)
    number = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 2] > 3, 1, 2)
    picture(replace(mesh, cell_data={REGION: number}), tmp_path / "a.png", size=(800, 600))
    drawn = matplotlib.image.imread(tmp_path / "a.png")[..., :3]
    orange, blue = (drawn[..., 0] > drawn[..., 2] + 0.3).sum(), (drawn[..., 2] > drawn[..., 0] + 0.3).sum()
    assert min(orange, blue) > 10_000


def test_a_section_has_the_colours_of_its_regions_the_area_of_the_cut_and_axes_that_say_anterior():
    mesh = cube_mesh(4, side=10.0)
    assert middle_of(mesh, "coronal") == 5.0
    region = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 2] > 5, 1, 2)
    for given, colours in (({REGION: region}, set(REGION_COLOURS[:2])), ({}, {GREY})):
        axes = Figure().subplots()
        draw_section(axes, replace(mesh, cell_data=given), "sagittal", 4.0)
        assert {to_hex(fill).upper() for one in axes.collections for fill in one.get_facecolors()} == colours
        rings = [path.vertices[:-1] for one in axes.collections for path in one.get_paths()]
        assert sum(_area(ring) for ring in rings) == pytest.approx(100)
        assert axes.get_xlabel().endswith("anterior") and "(mm)" in axes.get_ylabel()
    assert section(mesh, "axial", 4.0).std() > 0


def _area(ring: np.ndarray) -> float:
    x, y = ring.T
    return abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2
