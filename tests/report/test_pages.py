"""A page holds all it shows, quotes others without obeying them, and is the same file every time."""

from __future__ import annotations

import base64
import hashlib
import io
import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from shapes import ball_mesh, ball_surface, shell_mesh

from cortet.config.sections import Certify
from cortet.config.stages import Resample
from cortet.measure.certify import certify
from cortet.measure.layers import layer_records
from cortet.meshes import REGION, TriSurface
from cortet.report.case_page import Checked, write_case_page, write_failure_page
from cortet.report.pictures import thumbnail
from cortet.stages.repair import repair
from cortet.stages.resample import resample

HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)> & "quoted" `<b>`'
FAILURE = {
    "stage": "gate",
    "state": "failed",
    "reason": f"a.gii: {HOSTILE}",
    "remedy": "close it (all of it)",
    "log": "logs/a.log",
}
MESH, SURFACE = ball_mesh(2, radius=20.0), ball_surface(3, radius=20.0)
FLAT = TriSurface(np.full((3, 3), np.nan), [[0, 1, 2]])


@pytest.fixture(scope="module")
def certificate() -> dict[str, Any]:
    return asdict(certify(MESH, SURFACE, case="sub-a_hemi-L"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, certificate: dict[str, Any]) -> str:
    return case_page(tmp_path_factory.mktemp("page"), certificate)


def case_page(
    folder: Path,
    certificate: dict[str, Any],
    given: TriSurface = SURFACE,
    meshed: TriSurface = SURFACE,
    files: tuple[tuple[str, str], ...] = (),
    **more: Any,
) -> str:
    write_case_page(Checked(MESH, given, meshed, certificate, files), folder / "a.html", **more)
    return (folder / "a.html").read_text(encoding="utf-8")


def test_layers_are_listed_and_drawn(tmp_path, certificate):
    mesh = shell_mesh(23.0, 17.0, 4, 2)
    centres = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    mesh = replace(mesh, cell_data={REGION: np.where(centres > 19.9, 1, 2).astype(np.int32)})
    layers = [asdict(layer) for layer in layer_records(mesh, ["white"], [1, 1])]
    meshed = replace(SURFACE, inner={"white": SURFACE})
    write_case_page(Checked(mesh, SURFACE, meshed, {**certificate, "layers": layers}), tmp_path / "a.html")
    shown = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "Layers of the cortex" in shown and "0.000 to 0.500" in shown and f"{layers[0]['volume_ml']:.3f}" in shown
    assert "layer 1 yellow, layer 2 violet" in shown


def failure_page(folder: Path, surface: TriSurface | None = None, **more: Any) -> str:
    write_failure_page("sub-a_hemi-L", FAILURE, folder / "a.html", surface=surface, **more)
    return (folder / "a.html").read_text(encoding="utf-8")


def visible(page: str) -> str:
    """What a reader sees of a page, roughly."""
    return re.sub(r"<[^>]*>", " ", re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL))


@pytest.mark.parametrize(("surface", "drawn"), [(ball_surface(2), True), (FLAT, False), (None, False)])
def test_a_thumbnail_shows_the_surface_if_it_can_be_drawn(surface, drawn):
    content = thumbnail(surface, None)
    assert len(content) < 10_000
    alpha = np.asarray(PIL.Image.open(io.BytesIO(content)).convert("RGBA"))[..., 3]
    assert (alpha > 0).any() == drawn


def test_checks_have_their_limits_and_worst_elements_their_locations(page, certificate):
    rows = re.findall(r'<th scope="row">([^<]*)</th><td class="n">([^<]*)</td><td>([^<]*)</td>', page)
    shown = {name.lower(): (value, limit) for name, value, limit in rows}
    for check in certificate["checks"]:
        value, limit = shown[check["name"].lower()]
        assert float(value.split()[0]) == pytest.approx(check["value"], rel=1e-3)
        assert f"{check['limit']:g}" in limit if check["comparison"] else limit == "no limit"
    for element in certificate["worst_elements"]:
        assert f'<th scope="row">{element["element"]}</th><td class="n">{element["q"]:.4f}</td>' in page
        assert "{:.2f}, {:.2f}, {:.2f}".format(*element["centre_mm"]) in page


def test_what_was_changed_of_the_surface_is_said_where_and_shown(tmp_path, page):
    broken = TriSurface(SURFACE.points, SURFACE.faces[SURFACE.points[SURFACE.faces, 2].max(axis=1) < 18])
    made, mended = repair(broken, source="a.gii")
    _, resampled = resample(ball_surface(2, radius=20.0), ball_surface(2), Resample(subdivisions=3))
    reports = {"repair": {**asdict(mended), "inner": {"white": asdict(mended)}}, "resample": asdict(resampled)}
    native = TriSurface(SURFACE.points * 1.01, SURFACE.faces)
    certificate = asdict(certify(MESH, made, native=native, reports=reports))
    text = case_page(tmp_path, certificate, broken, made)
    assert mended.steps[0].done in visible(text) and "Inner surface white" in visible(text)
    assert "({:.1f}, {:.1f}, {:.1f})".format(*mended.steps[0].places_mm[0]) in text
    assert "642 instead of 162" in text and f"{resampled.resampled_to_native_mm.mean:.4g}" in text
    assert f"{certificate['native']['native_to_boundary_mm']['mean']:.4g}" in text
    for panel in ('id="repair"', 'id="resampled"'):
        assert panel in text and panel not in page


def test_a_failed_case_says_what_failed_why_and_what_to_do(tmp_path):
    text = visible(failure_page(tmp_path, replace(SURFACE, faces=SURFACE.faces[1:])))
    for part in ("gate", "a.gii:", "close it (all of it)", "logs/a.log", "Edges in one face only"):
        assert part in text
    assert "It cannot be read." in failure_page(tmp_path, trouble="It cannot be read.")
    assert "not finite" in failure_page(tmp_path, FLAT)


def test_what_others_wrote_is_quoted_not_obeyed(tmp_path, certificate):
    reasons = [*certify(MESH, SURFACE, Certify(q_max=0.01)).reasons, HOSTILE]
    hostile = {**certificate, "case": HOSTILE, "certified": False, "reasons": reasons, "input": {"file": HOSTILE}}
    hostile |= {"parameters": {"gate": HOSTILE}, "versions": {HOSTILE: HOSTILE}}
    hostile["worst_elements"] = [{**certificate["worst_elements"][0], "reason": HOSTILE, "remedy": HOSTILE}]
    case = case_page(tmp_path, hostile, files=((HOSTILE, HOSTILE),), facts={HOSTILE: HOSTILE}, cohort=HOSTILE)
    assert 'id="reasons"' in case and "must be below 0.01" in case and 'class="bad"' in case
    for page in (case, failure_page(tmp_path, facts={HOSTILE: HOSTILE})):
        assert "<script>alert" not in page and "<img src=x" not in page and "<b>" not in page
        assert "&lt;script&gt;alert(1)" in page


def test_only_the_scripts_of_the_page_may_run(tmp_path, page):
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="(.*?)"', page)
    allowed = set(re.findall(r"sha256-([^&]*)&", policy))
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    assert allowed == {base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts}
    assert len(scripts) == 2 and policy.startswith("default-src &#39;none&#39;")
    assert "script-src &#39;none&#39;" in failure_page(tmp_path)


def test_a_page_is_one_small_file_the_same_every_time_that_points_nowhere_else(tmp_path, page, certificate):
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href|action)="(?!data:|#)[^"]*"', markup)
    assert "@import" not in markup and "url(http" not in markup
    assert len(page) < 1_500_000 and case_page(tmp_path, certificate) == page
