"""The configuration: what is accepted, what is refused and how, and what `config.yaml` names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest
import yaml

from cortet import config
from cortet.config import keys_not_given
from cortet.config.section import MesherName
from cortet.errors import InputError
from cortet.meshers import MESHERS
from cortet.stages import require_programs

ROOT = Path(__file__).parents[2]


def test_config_yaml_is_valid_and_names_only_keys_that_exist():
    text = (ROOT / "config.yaml").read_text(encoding="utf-8")
    config.load(yaml.safe_load(text))
    every = config.render(config.Config().model_dump(mode="json"))
    keys, known = (set(re.findall(r"^[# ]*([a-z_]+):", some, flags=re.MULTILINE)) for some in (text, every))
    assert keys <= known and {"cohort", "sheet", "cell_size", "formats", "ten_nodes", "settings"} <= keys


def test_what_is_rendered_is_read_back():
    everything = config.Config().model_dump(mode="json")
    assert config.load(yaml.safe_load(config.render(everything))) == config.Config()


def test_the_names_in_the_configuration_are_those_of_meshers():
    assert get_args(MesherName) == tuple(MESHERS)


def test_a_backend_without_what_is_asked_of_it_is_refused_when_the_configuration_is_read():
    with pytest.raises(InputError, match=r"clean.*meshtool moves the boundary freely.*set clean.boundary: free"):
        config.load({"clean": {"backend": "meshtool"}})
    assert config.load({"setting": "published", "clean": {"backend": "meshtool"}}).clean.backend == "meshtool"


def test_a_program_that_is_called_and_missing_is_named_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"meshtool is not installed.*clean.backend: cortet"):
        require_programs(config.load({"setting": "published", "clean": {"backend": "meshtool"}}))
    require_programs(config.Config())


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"clean": {"treshold": [0.5]}}, "unknown key clean.treshold; did you mean clean.thresholds?"),
        ({"clena": {}}, "unknown key clena; did you mean clean?"),
        ({"q_max": 0.6}, "unknown key q_max; did you mean"),
        ({"nothing like it": 1}, "unknown key nothing like it; `cortet config` prints"),
        *(({"generate": {"cell_size": size}}, f"generate.cell_size = {size}") for size in (-1, 300, True)),
        ({"generate": {"cell_size": 0.00051}}, "multiple of 0.001 mm"),
        ({"fold": {"real_surfaces": {2: "x"}}}, "fold.real_surfaces.2"),
        ({"fold": {"end": 400}}, "fold.end = 400"),
        ({"fold": {"regions": {1: [1, float("nan"), 1]}}}, "fold.regions.1 = nan"),
        ({"setting": "paper"}, "'default', 'folding', 'cgal' or 'published'"),
        *(({"fold": {"core_relaxation": years}}, f"fold.core_relaxation = {years}") for years in (0, 1e-6)),
        ({"fold": {"region_relaxation": {3: 1e-4}}}, "fold.region_relaxation.3 = 0.0001"),
    ],
)
def test_a_bad_key_is_named_with_its_remedy(data, words):
    with pytest.raises(InputError) as error:
        config.load({**data, "snap": {"enable": True}})
    assert words in str(error.value) and "snap.enable" in str(error.value), "all bad keys are named at once"


def test_settings_are_those_of_the_paper_or_of_cortet_and_single_keys_override_them():
    default, cgal = config.load({}), config.load({"setting": "cgal", "generate": {"cell_size": 1.0}})
    published = config.load({"setting": "published", "clean": {"boundary": "fixed"}})
    assert default == config.Config() and default.generate.meshers == ["lattice"]
    assert cgal.generate.meshers == ["cgal"] and cgal.generate.cell_size == [1.0]
    for setting, stages in ((default, (False, True)), (cgal, (True, True)), (published, (True, False))):
        assert (setting.enabled("relocate"), setting.enabled("reconnect")) == stages and setting.enabled("clean")
    assert published.generate.facet_distance == [0.5] and published.relocate.boundary == "free"
    assert published.clean.boundary == "fixed"


def test_null_is_a_value_and_an_empty_section_is_as_if_it_were_left_out():
    assert config.load({"time_limit": None}).time_limit is None, "no limit"
    assert config.load({"clean": None}) == config.Config()


@pytest.mark.parametrize("text", ["- a list", "a: [", ""])
def test_a_file_that_is_no_configuration_is_refused_by_name(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"mine\.yaml"):
        config.load(path)


def test_what_another_file_sets_in_place_of_a_default_is_named():
    shipped = {"generate": {"cell_size": [1.6], "seed": 0}, "output": "mine"}
    assert keys_not_given(shipped, {"output": "mine"}) == ["generate.cell_size: [1.6] (default: [0.6])"]
    assert keys_not_given(shipped, shipped) == []
