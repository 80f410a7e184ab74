"""The experiment on convergence runs on any cohort: every size, realisation and mesher, one table, one sentence."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cortet.formats.gifti import read_surface, write_fields, write_surface
from cortet.meshes import TriSurface
from tests.integration.study import Study


def test_a_realisation_is_made_of_what_the_sheet_says(study: Study) -> None:
    """The same surface in metres, with a field that stops growth: it has the size of the other, and does not grow."""
    first, second = study.cases()
    surface = read_surface(Path(second.surface))
    write_surface(TriSurface(surface.points / 1000, surface.faces), Path(second.surface))
    field = study.folder / "surfaces/still.shape.gii"
    write_fields({"growth": np.zeros(len(surface.points))}, field)
    study.write_cases([first, replace(second, unit="m", fields={"growth": field})])
    study.config["fold"] = {
        "allow_volume": True,
        "model": "braingrowth",
        "end": 24.3,
        "thickness": 3.0,
        "frame_interval": 0.3,
    }
    study.config["experiments"] = {
        "convergence": {"cases": 2, "cell_size": [5.0, 4.0], "seeds": [0], "meshers": ["lattice"]}
    }
    study.jobs_of_run("convergence")
    volumes = {}
    for name in "ab":
        folder = min((study.outputs / f"sub-{name}/convergence").iterdir())
        with (folder / "fold.tsv").open(newline="") as file:
            rows = list(csv.DictReader(file, delimiter="\t"))
        volumes[name] = [float(row["volume_mm3"]) for row in (rows[0], rows[-1])]
    assert volumes["b"][0] == pytest.approx(volumes["a"][0], rel=0.05)
    assert volumes["a"][1] > 1.001 * volumes["a"][0]
    assert volumes["b"][1] == pytest.approx(volumes["b"][0], rel=1e-4)


def test_cell_sizes_and_realisations_of_a_case_are_folded_and_compared(study: Study) -> None:
    study.config["fold"] = {"allow_volume": True, "end": 24.3, "thickness": 3.0, "frame_interval": 0.3}
    study.config["experiments"] = {
        "convergence": {
            "cases": ["sub-a_hemi-L"],
            "cell_size": [5.0, 4.0, 3.2],
            "seeds": [0, 1],
            "meshers": ["lattice"],
        }
    }
    jobs = study.jobs_of_run("convergence")
    assert ("convergence", "-") in jobs
    folders = sorted((study.outputs / "sub-a/convergence").iterdir())
    assert [folder.name.split("_res-")[1] for folder in folders] == [
        f"{size}um_desc-lattice_seed-{seed}" for size in (3200, 4000, 5000) for seed in (0, 1)
    ]
    records = [json.loads((folder / "record.json").read_text()) for folder in folders]
    assert [record["outcome"] for record in records] == ["folded"] * 6
    assert records[0]["tets"] != records[1]["tets"]  # another direction of the lattice
    with (study.outputs / "cohort/table-convergence.tsv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file, delimiter="\t") if float(row["cell_size_mm"]) > 0]
    assert [(float(row["cell_size_mm"]), row["runs"]) for row in rows] == [(5.0, "2"), (4.0, "2"), (3.2, "2")]
    assert all(abs(float(row["correlation_realisations"])) <= 1 for row in rows)
    assert "of the thickness" in (study.outputs / "cohort/convergence.txt").read_text()
    assert (study.outputs / "cohort/figure-convergence.png").exists()
    assert study.jobs_of_run("convergence") == set()  # nothing is left to do
