"""The studies run on phantoms by their own Snakefile: every realisation and kind, one table each."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cortet.formats.gifti import write_fields, write_surface
from cortet.phantoms import phantom, phantom_with_sphere

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
FOLD = {"force": True, "end": 24.3, "thickness": 3.0, "frame_interval": 0.3}


def run(folder: Path, config: dict[str, Any]) -> str:
    """Run the studies in a folder; what Snakemake said."""
    (folder / "studies.yaml").write_text(yaml.safe_dump({"output": "results", **config}))
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "studies/Snakefile"), "--cores", "2"]
    command += ["--configfile", "studies.yaml", "--show-failed-logs"]
    done = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def test_folds_are_measured_by_week_beside_real_brains(tmp_path):
    for age in (24, 25):
        write_surface(phantom(float(age), subdivisions=4), tmp_path / f"{age}.surf.gii")
    brain = {"surface": "24.surf.gii", "ga": 24, "hemi": "L"}
    study = {"brains": {"a": brain}, "weeks": [24, 24.3], "cell_size": [6.0, 5.0]}
    uneven = {"undulation": {"mean_mm": 3, "sd_mm": 0.3, "length_mm": 6, "seed": 0}}
    study["levers"] = {"usual": {}, "turned": {"generate": {"seed": 1}}, "uneven": uneven}
    real = {"young": {**brain, "ga": 24}, "old": {**brain, "surface": "25.surf.gii", "ga": 25}}
    study["real"] = {**real, "newborn": {**real["old"], "born": True}}
    run(tmp_path, {"settings": {"fold": FOLD}, "late": study})
    rows = rows_of(tmp_path / "results/table-late.tsv")
    assert [row["kind"] for row in rows] == [
        "newborn",
        "fetus",
        "fetus",
        *[*["turned"] * 2, *["uneven"] * 2, *["usual"] * 2] * 2,
    ]
    assert float(rows[7]["area_cm2"]) < float(rows[8]["area_cm2"]) < float(rows[1]["area_cm2"])
    words = (tmp_path / "results/table-late.txt").read_text()
    assert "24.3 weeks" in words
    assert "| usual | 6 | usual | 5 | 24.3 | 1 |" in words and "| usual | 5 | turned | 5 | 24.3 | 1 |" in words


def test_later_surfaces_of_a_series_are_predicted_and_compared(tmp_path):
    files = {}
    for age in (24.0, 24.5):
        surface, sphere = phantom_with_sphere(age, hemisphere="L", subdivisions=4)
        files[age] = f"{age}.surf.gii"
        write_surface(surface, tmp_path / files[age])
        write_surface(sphere, tmp_path / f"{age}.sphere.gii")
    upper = phantom(24.0, subdivisions=4).points[:, 2] > 0
    write_fields({"label": np.where(upper, 1, 2).astype(np.int32)}, tmp_path / "lobes.label.gii")
    series = {"hemi": "L", "surfaces": files, "labels": "lobes.label.gii"}
    series |= {"spheres": [f"{age}.sphere.gii" for age in files]}
    study = {"series": {"a": series}, "cell_size": 5.0, "rounds": 2, "until": 24.5, "seed": 0}
    study |= {"kinds": ["mechanics", "path", "nothing"]}
    run(tmp_path, {"settings": {"fold": {**FOLD, "frame_interval": 0.1}}, "prediction": study})
    folder = tmp_path / "results/prediction"
    records = {path.parent.name: json.loads(path.read_text()) for path in folder.glob("*/record.json")}
    assert set(records) == {f"a_desc-{kind}" for kind in ("mechanics", "path", "nothing")}
    assert records["a_desc-mechanics"]["verdict"]["outcome"] == "folded"
    assert [len(records[f"a_desc-{kind}"]["residuals"]) for kind in ("mechanics", "path", "nothing")] == [2, 0, 0]
    rows = rows_of(tmp_path / "results/table-prediction.tsv")
    table = {row["kind"]: row for row in rows if row["lobe"] == "n/a"}
    assert [row["lobe"] for row in rows if row["kind"] == "path"] == ["n/a", "1", "2"]
    assert float(table["path"]["gained_depth"]) == 1  # it knows the surface that it predicts
    assert (folder / "a_desc-path/errors.png").exists()
