"""The output folder describes itself as BIDS asks."""

from __future__ import annotations

import json
from pathlib import Path

import cortet
from cortet.cohort.bids import write_dataset_description


def test_the_folder_says_what_made_it_and_what_is_not_bids(tmp_path: Path) -> None:
    write_dataset_description(tmp_path / "dataset_description.json", tmp_path / ".bidsignore")
    description = json.loads((tmp_path / "dataset_description.json").read_text())
    assert {"Name", "BIDSVersion"} <= description.keys()  # required of every dataset
    assert description["DatasetType"] == "derivative"
    assert description["GeneratedBy"] == [{"Name": "cortet", "Version": cortet.__version__}]
    assert "cohort" in (tmp_path / ".bidsignore").read_text().splitlines()
