"""A population of folds: the model and its p against known answers, and the files that a population has."""

from __future__ import annotations

import json
from dataclasses import replace

import nibabel as nib
import numpy as np
import pytest
from population import design_of, effects, write_study
from shapes import ball_surface

from cortet.cohort.sheet import Case
from cortet.errors import InputError
from cortet.folding.measures import surface_files
from cortet.formats.gifti import read_fields, write_fields, write_surface
from cortet.formats.tsv import read_tsv
from cortet.geometry.icosphere import icosphere
from cortet.meshes import TriSurface

FOLDS, RADIUS = 12, 20.0
#: p below which a vertex counts as found, permutations, and permuted groups
ALPHA, PERMUTATIONS, GROUPS = 0.05, 200, 40


def rows(number: int = FOLDS) -> list[dict[str, object]]:
    return [
        {"case": f"s{i}", "variant": "usual", "scan_age": 26 + i % 5, "group": "ab"[i % 2], "sex": "fm"[i // 2 % 2]}
        for i in range(number)
    ]


def noise(vertices: int, seed: int = 0, number: int = FOLDS) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(number, vertices))


def test_words_become_groups_and_numbers_are_centred():
    design = design_of(rows(), ["scan_age", "group"])
    assert design.names == ["scan_age", "group[b]"]
    assert design.tested[:, 0].mean() == pytest.approx(0)
    assert design.tested[:4, 1].tolist() == [0, 1, 0, 1]


def test_variants_are_compared_within_cases():
    both = [{**row, "variant": name} for row in rows(4) for name in ("usual", "thin")]
    design = design_of(both, ["variant"])
    assert design.names == ["variant[thin]"] and design.held.shape == (8, 3)
    values = np.repeat(10.0 * np.arange(4), 2)[:, None] + np.tile([0.0, 1.0], 4)[:, None]
    values = values + 0.01 * noise(1, number=8)
    t, _ = effects(values, design, permutations=20, seed=0)["variant[thin]"]
    assert t[0] > 20  # the cases differ ten times as much as the variants


@pytest.mark.parametrize(
    ("model", "word"),
    [
        (["mass"], "mass"),
        (["case2"], "same"),
        (["variant", "group"], "variant"),
        (["group", "copy"], "too few"),
        (["NA"], "s3.* NA"),
        (["unknown"], "unknown.*40 g"),
        (["endless"], "endless.*inf"),
    ],
)
def test_a_model_that_cannot_be_fitted_is_refused(model, word):
    given = [{**row, "case2": "same", "copy": row["group"]} for row in rows()]
    for name, odd in (("NA", "NA"), ("unknown", "40 g"), ("endless", "inf")):
        given = [{**row, name: odd if row["case"] == "s3" else str(place)} for place, row in enumerate(given)]
    with pytest.raises(InputError, match=word):
        design_of(given, model)


def test_t_is_that_of_the_textbook():
    from scipy.stats import ttest_ind

    values, given = noise(30), rows()
    t, p = effects(values, design_of(given, ["group"]), permutations=PERMUTATIONS, seed=0)["group[b]"]
    second = np.array([row["group"] == "b" for row in given])
    assert t == pytest.approx(ttest_ind(values[second], values[~second]).statistic)
    assert p.min() >= 1 / (PERMUTATIONS + 1) * (1 - 1e-9)


def test_an_effect_is_found_where_it_is_and_others_are_held():
    given, values = rows(), noise(200)
    values[:, :10] += 6.0 * np.array([row["group"] == "b" for row in given])[:, None]
    values += 3.0 * np.array([row["scan_age"] for row in given], float)[:, None]
    values[0, 50], values[:, 51] = np.nan, 1.0
    found = effects(values, design_of(given, ["group", "scan_age"]), permutations=PERMUTATIONS, seed=0)
    _, p = found["group[b]"]
    assert (p[:10] < ALPHA).all() and not (p[10:] < ALPHA).any()
    assert np.isnan(p[[50, 51]]).all()


def test_false_positives_come_at_their_rate():
    """Groups at random on noise: of 40, any vertex below 0.05 in at most 6 (binomial, 99 %); benchmarks has 200."""
    false, values, random = 0, noise(100), np.random.default_rng(1)
    for _ in range(GROUPS):
        given = [{**row, "group": name} for row, name in zip(rows(), random.permutation(list("ab" * 6)), strict=True)]
        _, p = effects(values, design_of(given, ["group"]), permutations=100, seed=0)["group[b]"]
        false += bool((p < ALPHA).any())
    assert false <= 6


def test_a_population_has_stacks_maps_a_design_and_a_table(tmp_path):
    ball, sheet = ball_surface(3, 1.0), []
    height = ball.points[:, 2]
    for number, row in enumerate(rows(8)):
        name, folder = f"s{number}", tmp_path / f"sub-s{number}"
        run = folder / f"simulation/sub-{name}_hemi-L_res-4000um_desc-latticeFolded"
        files = surface_files(run, f"sub-{name}_hemi-L", 30.0)
        depth = np.where((height > 0.5) & (row["group"] == "b"), 5.0, 1.0) + 0.1 * noise(len(height), number, 1)[0]
        write_surface(TriSurface(RADIUS * ball.points, ball.faces), files["surface"])
        write_fields({"depth": depth}, files["depth"])
        write_surface(ball_surface(3, 50.0), folder / "sphere.surf.gii")
        write_fields({"parcel": (height > 0.5).astype(np.int32)}, folder / "p.label.gii")
        case = Case(name, None, "L", 28.0, folder / "white.surf.gii", sphere=folder / "sphere.surf.gii")
        sheet.append(replace(case, fields={"parcel": folder / "p.label.gii"}, extra={"group": str(row["group"])}))
    found = tmp_path / "found"
    options = {"weeks": [30.0], "measures": ["depth"], "subdivisions": 3, "permutations": PERMUTATIONS}
    write_study(sheet, tmp_path, found, model=["group"], parcels="parcel", **options)
    stack = nib.load(found / "hemi-L_week-30_depth.func.gii")
    assert [array.meta["Name"] for array in stack.darrays] == [case.name for case in sheet]
    assert stack.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    maps, common = read_fields(found / "hemi-L_week-30_depth.shape.gii"), icosphere(3).points[:, 2]
    common = common / common.max()
    assert set(maps) == {"mean", "spread", "t_group[b]", "p_group[b]"}
    assert (maps["p_group[b]"][common > 0.6] < ALPHA).all()
    assert not (maps["p_group[b]"][common < 0.3] < ALPHA).any()
    record = json.loads((found / "population.json").read_text())["Model"]["hemi-L_week-30"]
    assert record["effects"]["group[b]"]["depth"]["smallest_p"] < ALPHA
    assert "/NumWaves\t2\n/NumPoints\t8\n/Matrix\n" in (found / "hemi-L_week-30_design.mat").read_text()
    assert (found / "hemi-L_week-30_design.con").read_text().endswith("/Matrix\n1\t0\n")
    assert (found / "figure_hemi-L_week-30.png").stat().st_size
    table = read_tsv(found / "population.tsv")
    means = {(row["case"], row["parcel"]): float(row["value"]) for row in table.to_dict("records")}
    assert means["sub-s1_hemi-L", "1"] == pytest.approx(5, abs=0.3)
    assert means["sub-s0_hemi-L", "1"] == pytest.approx(1, abs=0.3)
    with pytest.raises(InputError, match="31 weeks"):
        write_study(sheet, tmp_path, found, **{**options, "weeks": [31.0]})
