"""The experiment on prediction runs on any cohort with a series, with mechanics and without: one table, one figure."""

from __future__ import annotations

import csv
import json

import numpy as np

from cortet.formats.gifti import write_fields
from cortet.phantoms import phantom
from tests.integration.study import Study

AGES = {"early": "24", "later": "24.5"}


def test_later_surfaces_of_a_series_are_predicted_and_compared(study: Study) -> None:
    upper = phantom(24.0, subdivisions=4).points[:, 2] > 0
    labels = study.folder / "lobes.label.gii"
    write_fields({"label": np.where(upper, 1, 2).astype(np.int32)}, labels)
    columns = ["participant_id", "session_id", "hemi", "scan_age", "surface", "sphere", "field_label"]
    columns += ["include", "exclude_reason"]
    sheet = [["series", name, "L", age, "phantom", "phantom", str(labels), "yes", ""] for name, age in AGES.items()]
    (study.folder / "cohort.tsv").write_text("\n".join("\t".join(row) for row in [columns, *sheet]) + "\n")
    study.config["phantom"] = {"subdivisions": 4}
    study.config["fold"] = {"allow_volume": True, "end": 25.0, "thickness": 3.0, "frame_interval": 0.1}
    study.config["experiments"] = {
        "prediction": {"cell_size": 4.0, "rounds": 2, "until": 24.5, "kinds": ["mechanics", "path", "nothing"]}
        | {"uncertain": ["mechanics"], "variants": {"coarser": {"cell_size": 5.0, "core_stiffness": 0.3}}}
    }
    jobs = study.jobs_of_run("prediction")
    assert ("prediction", "-") in jobs
    folder = study.outputs / "sub-series/ses-early/prediction"
    records = {
        path.parent.name.split("desc-")[1]: json.loads(path.read_text()) for path in folder.glob("*/record.json")
    }
    assert set(records) == {"mechanics", "mechanicsCoarser", "path", "nothing"}
    assert records["mechanics"]["verdict"]["outcome"] == "folded"
    assert [len(records[kind]["residuals"]) for kind in ("mechanics", "path", "nothing")] == [2, 0, 0]
    with (study.outputs / "cohort/table-prediction.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    table = {row["kind"]: row for row in rows if row["lobe"] == "n/a"}
    assert [row["lobe"] for row in rows if row["kind"] == "path"] == ["n/a", "1", "2"]
    assert float(table["path"]["gained_depth"]) == 1  # it knows the surface that it predicts
    assert (study.outputs / "cohort/figure-prediction.png").exists()
    assert len([*folder.glob("*/predicted.png"), *folder.glob("*/errors.png")]) == 2 * 3  # none of the variants
    spread = json.loads((folder / "sub-series_ses-early_hemi-L_desc-mechanics/spread.json").read_text())
    assert len(spread["runs"]) == 2 and spread["ages"][0]["depth_sd_mm"] > 0
    assert float(table["mechanics"]["depth_sd_mm"]) > 0 and table["path"]["depth_sd_mm"] == "n/a"
    assert study.jobs_of_run("prediction") == set()  # nothing is left to do
