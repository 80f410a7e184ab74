"""The same surface through the command, Python and the workflow: the same mesh, byte for byte, and the same records."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import cortet
from cortet.cli import main
from cortet.cohort.sheet import Case
from cortet.formats.gifti import write_surface
from cortet.formats.volumes import write_volume
from cortet.meshes import TriSurface
from tests.integration.study import Study, surface

pytestmark = pytest.mark.thorough

ASIDE = np.array([100.0, 0, 0])


def inputs(folder: Path) -> dict[str, Path]:
    """Two surfaces in metres and a volume of labels in a folder."""
    pial = surface(0)
    pial = TriSurface(pial.points + ASIDE, pial.faces)
    inner = TriSurface(0.7 * (pial.points - ASIDE) + ASIDE, pial.faces)
    files = {name: folder / f"{name}.{end}" for name, end in (("pial", "surf.gii"), ("white", "surf.gii"))}
    files["tissue"] = folder / "tissue.nii.gz"
    for name, one in (("pial", pial), ("white", inner)):
        write_surface(TriSurface(one.points / 1000, one.faces), files[name])
    to_mm = np.diag([1.0, 1, 1, 1])
    to_mm[:3, 3] = [80.0, -20, -20]
    labels = np.where(np.indices((40, 40, 40))[1] > 20, 2, 1).astype(np.int16)
    write_volume(labels, to_mm, files["tissue"])
    files["tissue"].with_name("tissue.tsv").write_text("index\tname\n1\tback\n2\tfront\n")
    return files


def test_three_doors_lead_to_the_same_files(tmp_path):
    study = Study(tmp_path)
    (tmp_path / "surfaces").mkdir()
    files = inputs(tmp_path / "surfaces")
    study.config |= {
        "gate": {"unit": "m"},
        "export": {"formats": ["vtu"], "ten_nodes": ["abaqus"]},
        "generate": {"cell_size": [4.0]},
    }
    config = tmp_path / "alone.yaml"
    config.write_text(yaml.safe_dump(study.config))

    case = Case("a", None, "L", 24.0, files["pial"], inner={"white": files["white"]})
    study.write_cases([replace(case, volumes={"tissue": str(files["tissue"])})])
    assert study.run("participants").returncode == 0
    assert study.files("*_tennodes.inp")
    given = [str(files["pial"]), "--inner", f"white={files['white']}", "--volume", f"tissue={files['tissue']}"]
    command = tmp_path / "command/x.vtu"
    command.parent.mkdir()
    page = str(tmp_path / "command.html")
    assert main(["mesh", *given, "--config", str(config), "--ga", "24", "-o", str(command), "--page", page]) == 0
    made = cortet.mesh(
        files["pial"],
        inner={"white": files["white"]},
        volumes={"tissue": files["tissue"]},
        ga=24.0,
        settings=config,
        progress=False,
    )
    python = tmp_path / "python/x.vtu"
    python.parent.mkdir()
    made.save(python)
    made.page(tmp_path / "python.html")

    (workflow,) = study.files("*Solver_sets.vtu")
    assert command.read_bytes() == python.read_bytes() == workflow.read_bytes()
    assert {path.name for path in command.parent.iterdir()} == {path.name for path in python.parent.iterdir()}
    companions = ("x.meshed.surf.gii", "x.meshed-white.surf.gii", "x.volumes.tsv")
    for name in companions:
        assert (command.parent / name).read_bytes() == (python.parent / name).read_bytes(), name

    records = [json.loads(path.with_name(f"{path.name}.json").read_text()) for path in (command, python, workflow)]
    certificates = [json.loads((path.parent / "x.certificate.json").read_text()) for path in (command, python)]
    certificates.append(json.loads(study.files("*certificate.json")[0].read_text()))
    given_to: list[dict[str, str]] = []
    for record in records:
        origin = record.pop("made_from")
        given_to.append({region: one["sha256"] for region, one in origin["given"].items()})
        assert set(origin["meshed"]) == {"cortex", "white"} and origin["volumes"]["tissue"]["sha256"]
        assert origin["gestational_age"] == 24
        record.pop("files")
    assert given_to[0] == given_to[1] == given_to[2]
    assert records[0] == records[1] == records[2]
    for certificate in certificates:
        for key in ("case", "input", "files", "made_by"):
            certificate.pop(key, None)
    checks = [certificate["checks"] for certificate in certificates]
    assert checks[0] == checks[1] == checks[2]
    assert len({certificate["mesh_sha256"] for certificate in certificates}) == 1
    assert panels(tmp_path / "command.html") == panels(tmp_path / "python.html") == panels(*study.files("*report.html"))


def panels(page: Path) -> dict[str, str]:
    """Name -> HTML of each panel of the page of a mesh; the last one names files."""
    named = re.split(r'<section aria-labelledby="(\w+)">', page.read_text())[1:]
    return dict(zip(named[0::2], named[1::2], strict=True)) | {"record": ""}
