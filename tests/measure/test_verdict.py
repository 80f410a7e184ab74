"""The verdict says in the same breath what was repaired, and which limits were relaxed."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.config import load
from cortet.errors import InputError
from cortet.formats.gifti import write_surface
from cortet.measure.usual_size import unusual_volume
from cortet.measure.verdict import relaxed_limits, repaired_share
from cortet.meshes import TriSurface
from cortet.stages.repair import repair

BALL = ball_surface(3, radius=20.0)


def without_a_cap_of(share: float) -> TriSurface:
    """The ball without the triangles of a spherical cap with a share of its area."""
    centres = BALL.points[BALL.faces].mean(axis=1)
    return TriSurface(BALL.points, BALL.faces[centres[:, 1] < np.quantile(centres[:, 1], 1 - share)])


def meshed(surface: TriSurface, **certify):
    return cortet.mesh(surface, cell_size=6.0, settings={"certify": certify}, progress=False)


@pytest.mark.parametrize(("missing", "certified"), [(0.05, True), (0.3, False)])
def test_a_brain_without_its_front_is_not_certified_and_one_without_its_medial_wall_is(missing, certified):
    certificate = meshed(without_a_cap_of(missing)).certificate
    (check,) = (check for check in certificate.checks if check.id == "repaired_area")
    assert certificate.certified is certified is check.passed
    if certified:
        assert certificate.verdict == f"certified, {check.value:.0%} of the surface repaired".replace("%", " %", 1)
    else:
        assert "fraction of the area of the surface that repair made or dropped" in certificate.reasons[0]


def test_a_mesh_of_a_surface_that_was_repaired_before_says_so(tmp_path):
    """The repaired file has no flaw, and the mesh of it was "certified" without a word."""
    write_surface(without_a_cap_of(0.05), broken := tmp_path / "broken.surf.gii")
    mended = tmp_path / "mended.surf.gii"
    assert main(["repair", str(broken), "-o", str(mended)]) == 0
    at_once = meshed(broken)
    assert meshed(mended).certificate.verdict == at_once.certificate.verdict
    assert at_once.certificate.verdict.endswith("of the surface repaired")
    write_surface(BALL, mended)
    assert meshed(mended).certificate.verdict == "certified", "another surface under its name"


def test_what_repair_invents_is_measured():
    _made, report = repair(without_a_cap_of(0.1), source=None)
    area = 4 * np.pi * 20**2
    assert report.new_area_mm2 == report.filled_area_mm2 == pytest.approx(0.1 * area, rel=0.1)
    height = 2 * 20 * 0.1  # of the spherical cap, which the smooth cap follows
    bulge = np.pi * height**2 * (20 - height / 3) / 1000
    assert report.bulge_ml == pytest.approx(bulge, rel=0.2)
    inner = {**asdict(report), "new_area_mm2": 0.5 * report.area_mm2}
    assert repaired_share({**asdict(report), "inner": {"white": inner}}) == 0.5
    assert repair(BALL, source=None)[1].new_area_mm2 == 0


def test_pieces_that_repair_drops_count_as_repaired(tmp_path):
    second = BALL.points * 0.7 + [50.0, 0, 0]
    two = TriSurface(np.concatenate([BALL.points, second]), np.concatenate([BALL.faces, BALL.faces + len(BALL.points)]))
    made = cortet.mesh(two, cell_size=6.0, settings={"repair": {"max_piece": 0.5}}, progress=False)
    assert "fraction of the area of the surface that repair made or dropped" in made.certificate.reasons[0]
    assert repaired_share(made.certificate.reports["repair"]) == pytest.approx(0.49, abs=0.01)


def test_a_repair_stays_on_record_when_a_mesh_is_read_improved_and_certified(tmp_path):
    write_surface(without_a_cap_of(0.05), tmp_path / "open.surf.gii")
    made = cortet.mesh(tmp_path / "open.surf.gii", cell_size=6.0, progress=False)
    file, said = made.save(tmp_path / "x.vtu"), made.certificate.verdict
    assert said.endswith("of the surface repaired")
    assert cortet.certify(file).verdict == cortet.read(file).certificate.verdict == said
    assert cortet.improve(file, progress=False).certificate.verdict == said
    assert cortet.certify(made).verdict == said


def test_a_name_that_says_uncertified_is_given_to_no_certified_mesh(tmp_path):
    """A certified y_uncertified.vtu was deleted when y.vtu was written."""
    made = meshed(BALL)
    with pytest.raises(InputError, match="_uncertified"):
        made.save(tmp_path / "y_uncertified.vtu")
    made.save(tmp_path / "z.vtu").rename(tmp_path / "y_uncertified.vtu")
    made.save(tmp_path / "y.vtu")
    assert (tmp_path / "y_uncertified.vtu").exists()


def test_native_limits_hold_for_a_repaired_surface_but_at_what_is_new():
    sound = meshed(without_a_cap_of(0.05))
    assert sound.certificate.native.boundary_to_native_mm.max < 1, "to the surface with its cap"
    checks = {check.id: check for check in sound.certificate.checks}
    assert checks["native_distance"].limit == 6.0 and checks["native_distance"].passed
    assert not meshed(without_a_cap_of(0.05), max_native_distance=0.01).certified


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({}, ""),
        ({"certify": {"q_max": 0.5, "min_bank_gap": 0.1}}, ""),  # stronger ones
        (
            {"certify": {"max_area_change": None, "q_max": 0.95}},
            "q_max 0.95 instead of 0.6, max_area_change off",
        ),
        ({"certify": {"min_bank_gap": 0.01}}, "min_bank_gap 0.01 instead of 0.03"),
        ({"setting": "published"}, "the limits of `published`"),
        ({"setting": "cgal"}, "the limits of `cgal`"),
        ({"setting": "folding"}, ""),
    ],
)
def test_relaxed_limits_leave_a_mark(config, words):
    assert relaxed_limits(load(config).certify) == words


def test_a_mesh_that_is_certified_to_relaxed_limits_says_so_wherever_it_is_certified(tmp_path):
    made = meshed(BALL, q_max=0.9)
    said = "certified to your limits (q_max 0.9 instead of 0.6)"
    assert made.certificate.verdict == said and said in repr(made)
    assert cortet.certify(made, settings={"certify": {"q_max": 0.9}}).verdict == said
    assert cortet.certify(made).verdict == "certified"


@pytest.mark.parametrize(
    ("volume", "extents", "age", "hemisphere", "unusual"),
    [
        (71.0, (38, 85, 54), 22, None, True),  # a narrow body is half a brain
        (71.0, (38, 85, 54), 22, "R", True),
        (71.0, (38, 85, 54), 30, "R", False),
        (19.8, (23, 59, 37), 22, "L", False),
        (25.0, (24, 60, 38), 22, "L", False),  # pial
        (104.3, (62, 76, 50), 28, None, False),  # a whole brain
        (250.0, (62, 76, 50), 28, None, True),
        (119.0, (50, 101, 80), 42, "R", False),
        (340.0, (65, 168, 118), 46, "L", True),  # an adult of 46 years
        (200.0, (60, 140, 100), 56, "L", False),  # an infant
        (50.0, (31, 78, 56), 19.9, "L", True),
        (5.0, (15, 35, 25), 16, "L", False),
    ],
)
def test_a_volume_that_no_brain_of_its_age_has_is_unusual(volume, extents, age, hemisphere, unusual):
    assert bool(unusual_volume(volume, extents, age, hemisphere, times=1.5)) is unusual


def test_a_wrong_age_is_a_remark():
    narrow = replace(BALL, points=BALL.points * [0.8, 1.6, 1.2])  # 51 mL
    wrong = cortet.mesh(narrow, cell_size=6.0, ga=22, progress=False).certificate
    assert wrong.certified and "22 weeks usually has 20 mL" in wrong.remarks[0]
    assert cortet.mesh(narrow, cell_size=6.0, ga=28, progress=False).certificate.remarks == ()
