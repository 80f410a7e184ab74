"""Synthetic brains of two groups: in group b the cortex of one quarter does not grow (README.md)."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from cortet.cohort.sheet import Case, write_sheet
from cortet.formats.gifti import write_fields, write_surface
from cortet.phantoms import phantom_with_sphere

cases = []
for number in range(10):
    surface, sphere = phantom_with_sphere(28, hemisphere="L", subdivisions=4, seed=number)
    parcel = 1 + (sphere.points[:, 1] > 0) + 2 * (sphere.points[:, 2] > 0)
    group = "ab"[number % 2]
    growth = np.where((parcel == 4) & (group == "b"), 0.0, 1.0)
    files = {kind: Path(f"population/{number}.{kind}.gii") for kind in ("surf", "sphere", "growth", "parcel")}
    write_surface(surface, files["surf"])
    write_surface(sphere, files["sphere"])
    write_fields({"growth": growth}, files["growth"])
    write_fields({"parcel": parcel.astype(np.int32)}, files["parcel"])
    fields = {"growth": files["growth"], "parcel": files["parcel"]}
    case = Case(f"{number:02}", None, "L", 28, files["surf"], sphere=files["sphere"], fields=fields)
    cases.append(replace(case, extra={"group": group}))
write_sheet(cases, Path("population/cohort.tsv"))
