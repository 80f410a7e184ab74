"""The output folder describes itself as BIDS asks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cortet
from cortet.cohort.app import lock, require_plain_python
from cortet.cohort.bids import Places, descriptions, provenance, write_dataset_description, write_descriptions
from cortet.config import load
from cortet.errors import InputError
from cortet.formats.tsv import read_tsv


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path / "derivatives/cortet", tmp_path / "dhcp")


def described(places: Places, *files: Path) -> dict[str, object]:
    places.output.mkdir(parents=True, exist_ok=True)
    description = places.output / "dataset_description.json"
    write_dataset_description(description, places.output / ".bidsignore", places.links(files))
    found: dict[str, object] = json.loads(description.read_text())
    return found


def test_the_folder_says_what_made_it_and_what_is_not_bids(places):
    description = described(places)
    assert {"Name", "BIDSVersion"} <= description.keys()  # required of every dataset
    assert description["DatasetType"] == "derivative"
    assert description["GeneratedBy"] == [{"Name": "cortet", "Version": cortet.__version__}]
    assert not {"SourceDatasets", "DatasetLinks"} & description.keys(), "phantoms come from nowhere"
    assert "cohort" in (places.output / ".bidsignore").read_text().splitlines()


def test_sources_are_bids_uris_whose_names_the_description_explains(places, tmp_path):
    other = tmp_path / "elsewhere/atlas data"
    other.mkdir(parents=True)
    (other / "dataset_description.json").write_text(json.dumps({"DatasetDOI": "doi:10.1/x"}))
    own, raw = places.output / "sub-1/anat/a b.gii", places.raw / "sub-1/anat/a.surf.gii"
    far, farther = other / "sub-2/anat/b.surf.gii", tmp_path / "loose/c.surf.gii"
    sidecar = provenance([own, raw, raw, far, farther], raw, places)
    sources = sidecar["Sources"]
    assert sources[:2] == ["bids::sub-1/anat/a%20b.gii", "bids:raw:sub-1/anat/a.surf.gii"] and len(sources) == 4
    assert sidecar["SpatialReference"] == sources[1] and "SpatialReference" not in provenance([own], None, places)
    links = described(places, raw, far, farther)["DatasetLinks"]
    for uri, file in zip(sources[1:], (raw, far, farther), strict=True):
        _, name, path = uri.split(":")
        assert (places.output / links[name].replace("%20", " ") / path).resolve() == file.resolve()
    datasets = described(places, raw, far, farther)["SourceDatasets"]
    assert {"URL": "../../dhcp"} in datasets and [one["DOI"] for one in datasets if "DOI" in one] == ["doi:10.1/x"]


def test_every_desc_is_documented(tmp_path):
    config = {"generate": {"meshers": ["lattice", "cgal"]}}
    settings = {"": load(config), "Published": load({**config, "setting": "published"})}
    write_descriptions(descriptions(settings), tmp_path / "descriptions.tsv")
    table = read_tsv(tmp_path / "descriptions.tsv").set_index("desc_id")["description"]
    assert "moves vertices" in table["desc-latticeCleaned"]
    assert table["desc-cgalPublishedCleaned"].endswith("(mesher cgal, setting published)")
    assert {"desc-smoothed", "desc-phantom", "desc-resampled", "desc-cgalGenerated"} <= set(table.index)
    assert "desc-cgalPublishedReconnected" not in table, "the setting has no such stage"
    assert "desc-cgalPublishedGenerated" not in table, "its meshes of S1 are shared"


def test_an_output_folder_with_braces_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(InputError, match=r"has braces in its name, which Snakemake reads as wildcards"):
        lock(tmp_path / "bids", tmp_path / "out{x}")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="output = 'out{x}': braces in the name of the output folder"):
        load({"output": "out{x}"})


@pytest.mark.parametrize("folder", ["my env", "env (1)", "it's", 'so "named"', "a$b"])
def test_a_python_that_snakemake_cannot_call_is_refused(folder):
    """Snakemake issue 2645."""
    require_plain_python("/home/josé/env-1.2/bin/python")
    with pytest.raises(InputError, match="Snakemake cannot run jobs with a Python whose path has"):
        require_plain_python(f"/home/{folder}/bin/python")
