"""How a brain grows at which age: laws, and the model of a brain that grows as a whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from fold_brain import fitted, of_laws
from shapes import ball_mesh

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import fold
from cortet.folding.growth import by_age, times_of
from cortet.folding.kernels import grown_volume_of
from cortet.folding.law import ACROSS, ALONG, CORE
from cortet.folding.measurements import Measurements
from cortet.folding.models import SHOWN, hidden_growth
from cortet.folding.run import Run, beginning, prepared, time_step_of
from cortet.measure.usual_size import AREA, HULL, VOLUME, usual
from cortet.meshes import REGION, MeshSets, TetMesh

AGES = np.array([22.0, 25.0, 28.5, 34.0, 38.0])
STARTS: tuple[Literal["free"], Literal["stressed"]] = ("free", "stressed")


@pytest.fixture(scope="module")
def ball() -> TetMesh:
    return ball_mesh(2, radius=10.0)


def test_a_law_by_age_is_a_rate_or_goes_through_a_table_and_never_beyond_it():
    assert by_age(0.05)(AGES) == pytest.approx(0.05 * (AGES - 22))
    table = {22.0: 0.0, 28.0: 0.3, 34.0: 0.3, 38.0: 0.8}
    curve = by_age(table)
    assert curve(np.array(list(table))) == pytest.approx(list(table.values()))
    between = curve(np.linspace(20, 45, 251))
    assert between.min() == 0 and between.max() == 0.8 and np.diff(between).min() >= 0  # monotone as the table is
    assert curve(np.linspace(28, 34, 20)) == pytest.approx(0.3)
    assert by_age({30.0: 0.2})(AGES) == pytest.approx(0.2)


@pytest.mark.parametrize("volume", [None, {22.0: 20.0, 30.0: 50.0, 38.0: 90.0}])
def test_without_stress_the_whole_has_the_volume_that_it_should(ball, volume):
    run = prepared(ball, Settings(gestational_age=22.0, end=38.0, thickness=2.0, volume=volume))
    for age in (22.0, 26.0, 38.0):
        time = times_of(np.array([age]))
        stretch, growth = run.growth.frame(float(time[0])), run.growth.at(time, 0.0).growth[0]
        grown = stretch**3 * grown_volume_of(run.body, growth) / run.body.volumes.sum()
        if volume is None:
            ratio = usual(VOLUME, np.array([age])) / usual(VOLUME, AGES[:1])
            assert grown == pytest.approx(float(ratio[0]), rel=1e-9)
        elif age in volume:
            assert grown == pytest.approx(volume[age] / 20, rel=1e-9)
    assert run.growth.frame(float(times_of(AGES[:1])[0])) == pytest.approx(1)


def test_growth_counts_from_the_age_of_the_mesh(ball):
    rates = {"growth_rate": 0.05, "thickness_rate": -0.02}
    run = prepared(ball, Settings(gestational_age=26.0, end=38.0, thickness=2.0, start="free", **rates))
    ((first,), (later,)) = run.growth.at(times_of(np.array([26.0, 34.0])), 0.0).growth
    stretch = run.growth.frame(float(times_of(np.array([34.0]))[0]))
    assert first == pytest.approx([0, 0, 0], abs=1e-12)
    assert later[ALONG] == pytest.approx(1.6 / 1.2 - 1)
    assert later[ACROSS] == pytest.approx(0.76 / 0.92 / stretch - 1)
    assert later[CORE] == 0


def test_growth_that_a_later_mesh_does_not_show_comes_in_its_first_week(ball):
    assert hidden_growth(0.05, 22.0) == 0 == hidden_growth(0.0, 30.0)  # all that has grown is seen
    shown = np.sqrt(98.6 / 47.7) / np.cbrt(50.0 / 19.8)  # of the CRL atlas at 28 weeks
    assert hidden_growth(0.05, 28.0) == pytest.approx(1.3 / shown - 1, rel=0.01)
    laws = [
        prepared(ball, Settings(gestational_age=28.0, end=38.0, growth_rate=0.05, thickness=2.0, start=start)).growth
        for start in STARTS
    ]
    for age, part in {28.0: 0.0, 28.5: 0.5, 29.0: 1.0, 36.0: 1.0}.items():
        free, stressed = (law.at(times_of(np.array([age])), 0.0).growth[0, 0, ALONG] for law in laws)
        assert (1 + stressed) / (1 + free) == pytest.approx((1.3 / shown) ** part, rel=0.01)


def test_the_growth_that_a_shape_shows_is_that_of_fetuses_and_of_newborns_of_term():
    brains = of_laws()
    ages, area, volume = (brains[name].to_numpy(float) for name in ("gestational_age_weeks", "area_cm2", "volume_ml"))
    shape = np.sqrt(area) / np.cbrt(volume)
    shown = shape / shape[ages == 22] - 1
    near = np.abs(ages[:, None] - np.array(list(SHOWN))).argmin(axis=1)
    means = [shown[near == number].mean() for number in range(len(SHOWN))]
    assert list(SHOWN.values()) == pytest.approx(means, abs=1e-3)


def with_region(ball: TetMesh) -> tuple[TetMesh, TetMesh]:
    """A ball whose middle is a region by number, 4, and by name."""
    inner = np.linalg.norm(ball.points[ball.cells].mean(axis=1), axis=1) < 4
    by_number = TetMesh(ball.points, ball.cells, cell_data={REGION: np.where(inner, 4, 1)})
    sets = MeshSets(cells={"thalamus": np.flatnonzero(inner).astype(np.int32)})
    return by_number, replace(by_number, cell_data={}, sets=sets)


def in_run(run: Run) -> np.ndarray:
    """Which tetrahedra of a run are in that region."""
    return np.linalg.norm(run.mesh.points[run.body.cells].mean(axis=1), axis=1) < 4


def test_a_region_of_the_core_may_grow_otherwise(ball):
    mesh, by_name = with_region(ball)
    chosen = Settings(gestational_age=22.0, end=38.0, thickness=1.0)
    run = prepared(mesh, chosen.with_keys(core_regions={4: -0.02}))
    growth = run.growth.at(times_of(np.array([32.0])), 0.0).growth[0]
    assert growth[:, CORE].tolist() == pytest.approx([0.0, -0.2])
    assert np.array_equal(run.body.label == 1, in_run(run))
    named = prepared(by_name, chosen.with_keys(core_regions={"thalamus": -0.02}))
    assert np.array_equal(named.body.label, run.body.label)
    both = replace(by_name, cell_data=mesh.cell_data)
    for given, regions in ((both, {4: 0.1, "thalamus": 0.2}), (by_name, {"pons": 0.1}), (mesh, {7: 0.1})):
        with pytest.raises(InputError, match="core_regions"):
            prepared(given, chosen.with_keys(core_regions=regions))


def test_a_region_of_the_core_may_be_softer_or_stiffer(ball):
    mesh, by_name = with_region(ball)
    chosen = Settings(gestational_age=22.0, end=38.0, core_stiffness=0.2)
    for given, key in ((mesh, 4), (by_name, "thalamus")):
        run = prepared(given, chosen.with_keys(region_stiffness={key: 0.05}))
        assert run.body.stiffness == pytest.approx(np.where(in_run(run), 0.25, 1.0))
        assert run.material.mu_core == 0.2
    with pytest.raises(InputError, match="pons"):
        prepared(mesh, chosen.with_keys(region_stiffness={"pons": 0.1}))
    stiff = prepared(mesh, chosen.with_keys(region_stiffness={4: 1e5}))
    assert time_step_of(stiff, beginning(stiff)) < time_step_of(run, beginning(run)) / 1.5


def rows_of(mesh: TetMesh, folder: Path, settings: Settings) -> list[Measurements]:
    """The rows of a fold, whose steps are as short as those of a brain."""
    rows: list[Measurements] = []
    fold(mesh, folder, settings.with_keys(time_step=2e-4), lambda row, *_: rows.append(row))
    assert abs(rows[-1].energy_error or 0.0) < 1e-3
    return rows


def test_a_ball_grows_as_a_brain_of_its_age_and_stays_a_ball(ball, tmp_path):
    chosen = Settings(gestational_age=22.0, force=True, end=23.0, thickness=2.0, envelope=False)
    rows = rows_of(ball, tmp_path, chosen.with_keys(record_interval=0.25))
    expected = usual(VOLUME, np.array([row.gestational_age for row in rows])) / usual(VOLUME, AGES[:1])
    assert [row.volume_mm3 / rows[0].volume_mm3 for row in rows] == pytest.approx(expected, rel=0.01)
    assert rows[-1].extent_lr_mm == pytest.approx(rows[-1].extent_is_mm, rel=0.01)
    assert rows[-1].hull_volume_mm3 == pytest.approx(rows[-1].volume_mm3, rel=0.01)
    shell = 1 - (1 - rows[0].cortical_thickness_mm / 10) ** 3
    assert rows[0].cortex_share == pytest.approx(shell, rel=0.25)  # of a ball that a coarse mesh stands for


def test_an_envelope_holds_back_what_grows_out_of_it(ball, tmp_path):
    chosen = Settings(gestational_age=22.0, force=True, end=23.0, thickness=2.0, hull={22.0: 1.0, 23.0: 1.05})
    hulls = []
    for envelope in (False, True):
        rows = rows_of(ball, tmp_path / str(envelope), chosen.with_keys(envelope=envelope))
        hulls.append(rows[-1].hull_volume_mm3 / rows[0].hull_volume_mm3)
    assert hulls[0] > 1.2 and 1.05 < hulls[1] < 1.15  # it is soft


@pytest.mark.parametrize(
    ("law", "column"), [(AREA, "area_cm2"), (VOLUME, "volume_ml"), (HULL, "hull_volume_ml")], ids=str
)
def test_the_laws_of_the_package_are_those_of_its_table(law, column):
    brains = of_laws()
    ages, values = (brains[name].to_numpy(float) for name in ("gestational_age_weeks", column))
    again = fitted(ages, values, (1.2 * law[0], 0.9 * law[1], law[2] + 1))
    assert usual(again, ages) == pytest.approx(usual(law, ages), rel=1e-2)
    assert np.sqrt(((values / usual(law, ages) - 1) ** 2).mean()) < 0.08
