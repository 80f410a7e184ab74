"""What a certified mesh says of the surfaces that were changed for it."""

from dataclasses import asdict

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.config.stages import Regions
from cortet.errors import InputError
from cortet.formats.gifti import write_surface
from cortet.formats.volumes import Volume
from cortet.geometry.nesting import nested
from cortet.measure.remarks import remarks
from cortet.stages import separate as stage
from cortet.stages.separate import separate

PARAMETERS = {"separate": {"min_gap": 0.5}, "generate": {"cell_size": 2.0}}


def told(*, inner: float, outer: float = 14.0) -> tuple[str, ...]:
    ball = ball_surface(4, radius=inner)
    _, report = separate(nested(ball_surface(4, radius=outer), {"white": ball}), Regions(min_gap=0.5), cell_size=2.0)
    return remarks({"separate": asdict(report)}, PARAMETERS)


def test_an_inner_surface_that_gave_way_far_is_told_with_the_volume():
    (sentence,) = told(inner=13.7)
    volume = 4 / 3 * np.pi * (13.7**3 - 13.0**3) / 1000
    between = 4 / 3 * np.pi * (14.0**3 - 13.0**3) / 1000
    millilitres, share = (float(word.strip("%,")) for word in sentence.split() if word[0].isdigit())
    assert millilitres == pytest.approx(volume, rel=0.1) and share == pytest.approx(100 * volume / between, rel=0.1)
    assert "white" in sentence
    assert told(inner=12.0) == ()


def test_a_gap_that_would_make_triangles_cross_is_halved_and_told(monkeypatch):
    tried = []

    def stubborn(surface, container, tree, gaps, gap):  # type: ignore[no-untyped-def]
        """Triangles cross with every gap above half a millimetre."""
        tried.append(gap)
        moved, remaining = kept_apart(surface, container, tree, gaps, gap)
        return moved, np.array([0]) if gap > 0.5 else remaining

    from cortet.geometry.separation import kept_apart

    monkeypatch.setattr(stage, "kept_apart", stubborn)
    assert told(inner=13.7)[-1].startswith("white keeps 0.5 mm")
    assert tried == [1.0, 0.5]
    monkeypatch.setattr(stage, "_SHARES", (1.0,))
    with pytest.raises(Exception, match="1 triangle still intersects"):
        told(inner=13.7)


def test_a_repair_is_told_from_half_a_per_cent_of_the_volume_on():
    outer = {
        "repaired": True,
        "relative_volume_change": 0.0049,
        "new_area_mm2": 1,
        "dropped_area_mm2": 0,
        "area_mm2": 200,
        "bulge_ml": 0.1,
    }
    white = {**outer, "relative_volume_change": -0.012}
    told = remarks({"repair": {**outer, "inner": {"white": white}}}, {})
    assert told == ("repair changed the volume of white by -1.2%",)
    assert remarks({}, {}) == ()


@pytest.mark.parametrize("inner", [14.0, 13.99])
def test_an_inner_surface_that_is_the_one_around_it_is_refused_with_both_files(inner, tmp_path):
    """An equal one was certified: all of the region between the two was what had given way."""
    files = [tmp_path / "lh.pial.surf.gii", tmp_path / "lh.white.surf.gii"]
    for file, radius in zip(files, (14.0, inner), strict=True):
        write_surface(ball_surface(4, radius=radius), file)
    with pytest.raises(InputError, match=rf"{files[0]} and {files[1]}"):
        cortet.mesh(files[0], 2.0, inner={"white": files[1]}, progress=False)


def test_the_background_of_a_volume_is_told_with_the_certificate():
    """Labels in a ball in the middle, of half the volume."""
    half = np.zeros((40, 40, 40), np.int16)
    half[np.linalg.norm(np.indices(half.shape) - 19.5, axis=0) < 8] = 1
    affine = np.array([[1, 0, 0, -19.5], [0, 1, 0, -19.5], [0, 0, 1, -19.5], [0, 0, 0, 1.0]])
    volume = Volume(half, affine, "labels", file="dseg.nii")
    made = cortet.mesh(ball_surface(4, radius=10.0), 2.5, volumes={"tissue": volume}, progress=False)
    (told,) = made.certificate.remarks
    assert float(told.split()[1].rstrip("%")) == pytest.approx(49, abs=2) and "dseg.nii" in told


def test_a_cortex_of_one_element_is_told_what_two_cost():
    surface, inner = ball_surface(4, radius=8.0), {"white": ball_surface(4, radius=6.8)}
    one, two = (
        cortet.mesh(surface, 1.4, inner=inner, settings={"regions": {"elements_across": across}}, progress=False)
        for across in (1, 2)
    )
    (told,) = one.certificate.remarks
    assert told.startswith("the cortex has 1 element across (median), too few for mechanics; 0.7 mm is small enough")
    assert "regions.elements_across: 2, for three to eight times the tetrahedra" in told
    assert two.certificate.remarks == ()
    assert 3 <= two.certificate.quality.tets / one.certificate.quality.tets <= 8
