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
from shapes import ball_mesh, ball_surface

from cortet.config.sections import Certify
from cortet.config.stages import Resample
from cortet.measure.certify import certify
from cortet.meshes import TriSurface
from cortet.report.case_page import about, write_case_page, write_failure_page
from cortet.report.pages import embedded
from cortet.report.pictures import thumbnail
from cortet.stages.repair import repair
from cortet.stages.resample import resample

HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)> & "quoted" `<b>`'
FAILURE = {
    "stage": "gate",
    "state": "failed",
    "reason": f"a.gii: {HOSTILE} (close it (all of it))",
    "problem": f"a.gii: {HOSTILE}",
    "remedy": "close it (all of it)",
    "log": "logs/a.log",
}


@pytest.fixture(scope="module")
def certificate() -> dict[str, Any]:
    return asdict(certify(ball_mesh(2, radius=20.0), ball_surface(3, radius=20.0), case="sub-a_hemi-L"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, certificate: dict[str, Any]) -> str:
    """The page of a mesh."""
    return case_page(tmp_path_factory.mktemp("page"), certificate)


def case_page(folder: Path, certificate: dict[str, Any], **more: Any) -> str:
    surface = ball_surface(3, radius=20.0)
    write_case_page(ball_mesh(2, radius=20.0), surface, certificate, folder / "a.html", meshed=surface, **more)
    return (folder / "a.html").read_text(encoding="utf-8")


def failure_page(folder: Path, surface: TriSurface | None = None, **more: Any) -> str:
    write_failure_page("sub-a_hemi-L", FAILURE, folder / "a.html", surface=surface, **more)
    return (folder / "a.html").read_text(encoding="utf-8")


def visible(page: str) -> str:
    """What a reader sees of a page, roughly."""
    return re.sub(r"<[^>]*>", " ", re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL))


@pytest.mark.parametrize("drawn", [True, False])
def test_a_thumbnail_shows_the_surface_and_is_empty_where_there_is_none(drawn: bool) -> None:
    broken = np.full((3, 3), np.nan)
    content = thumbnail(ball_surface(2) if drawn else TriSurface(broken, [[0, 1, 2]]), None)
    assert len(content) < 10_000
    alpha = np.asarray(PIL.Image.open(io.BytesIO(content)).convert("RGBA"))[..., 3]
    assert (alpha > 0).any() == drawn
    assert thumbnail(None, "L") == thumbnail(TriSurface(broken, [[0, 1, 2]]), "R")


def test_every_number_of_the_certificate_stands_beside_its_limit(page: str, certificate: dict[str, Any]) -> None:
    rows = re.findall(r'<th scope="row">([^<]*)</th><td class="n">([^<]*)</td><td>([^<]*)</td>', page)
    shown = {name.lower(): (value, limit) for name, value, limit in rows}
    words = {"<": "below", "<=": "at most", "==": "exactly", ">=": "at least"}
    for check in certificate["checks"]:
        value, limit = shown[check["name"].lower()]
        assert float(value.split()[0]) == pytest.approx(check["value"], rel=1e-3)
        bound = f"{words[check['comparison']]} {check['limit']:g}" if check["comparison"] else "no limit"
        assert limit.startswith(bound)


def test_the_worst_elements_are_located(page: str, certificate: dict[str, Any]) -> None:
    for element in certificate["worst_elements"]:
        x, y, z = element["centre_mm"]
        assert f'<th scope="row">{element["element"]}</th><td class="n">{element["q"]:.4f}</td>' in page
        assert f"{x:.2f}, {y:.2f}, {z:.2f}" in page


def test_a_repaired_surface_says_what_was_done_where_and_shows_it(tmp_path: Path, page: str) -> None:
    good = ball_surface(3, radius=20.0)
    broken = TriSurface(good.points, good.faces[good.points[good.faces, 2].max(axis=1) < 18])
    made, report = repair(broken, source="a.gii")
    reports = {"repair": {**asdict(report), "inner": {"white": asdict(report)}}}
    certificate = asdict(certify(ball_mesh(2, radius=20.0), made, reports=reports))
    assert certificate["input_repaired"]
    write_case_page(ball_mesh(2, radius=20.0), broken, certificate, tmp_path / "a.html", meshed=made)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    shown = visible(text)
    assert "The input was repaired" in shown and "Inner surface white" in shown
    assert report.steps[0].done in shown
    x, y, z = report.steps[0].places_mm[0]
    assert f"({x:.1f}, {y:.1f}, {z:.1f})" in shown
    assert "by its distance to the file, white at 0, red at" in text
    assert "The input was repaired" not in page


def test_a_surface_on_the_common_mesh_says_how_far_it_is_from_the_native_one(tmp_path: Path, page: str) -> None:
    made, report = resample(ball_surface(2, radius=20.0), ball_surface(2), Resample(subdivisions=3))
    certificate = asdict(certify(ball_mesh(2, radius=20.0), made, reports={"resample": asdict(report)}))
    shown = visible(case_page(tmp_path, certificate))
    assert "On the common mesh" in shown and "642 instead of 162" in shown
    assert f"{report.resampled_to_native_mm.mean:.4g}" in shown
    assert "On the common mesh" not in visible(page)


def test_a_mesh_that_is_not_certified_says_why(tmp_path: Path) -> None:
    bad = asdict(certify(ball_mesh(2, radius=20.0), ball_surface(3, radius=20.0), Certify(q_max=0.01)))
    page = case_page(tmp_path, bad)
    assert "Why it is not certified" in page and "must be below 0.01" in page
    assert re.search(r"1 of \d+ numbers are beyond their limit", page)


def test_a_failed_case_says_what_failed_why_and_what_to_do(tmp_path: Path) -> None:
    text = visible(failure_page(tmp_path, replace(ball_surface(3), faces=ball_surface(3).faces[1:])))
    for part in ("gate", "a.gii:", "close it (all of it)", "logs/a.log", "Edges in one face only"):
        assert part in text


def test_a_surface_that_cannot_be_read_is_no_obstacle(tmp_path: Path) -> None:
    assert "It cannot be read." in failure_page(tmp_path, trouble="It cannot be read.")
    far = TriSurface(np.full((3, 3), np.nan), [[0, 1, 2]])
    assert "not finite" in failure_page(tmp_path, far)


def test_what_others_wrote_is_quoted_not_obeyed(tmp_path: Path, certificate: dict[str, Any]) -> None:
    hostile = {**certificate, "case": HOSTILE, "certified": False, "reasons": [HOSTILE], "input": {"file": HOSTILE}}
    hostile |= {"parameters": {"gate": HOSTILE}, "versions": {HOSTILE: HOSTILE}}
    hostile["worst_elements"] = [{**certificate["worst_elements"][0], "reason": HOSTILE, "remedy": HOSTILE}]
    case = case_page(tmp_path, hostile, facts=[(HOSTILE, HOSTILE)], files=[(HOSTILE, HOSTILE)], cohort=HOSTILE)
    for page in (case, failure_page(tmp_path, facts=[(HOSTILE, HOSTILE)])):
        assert "<script>alert" not in page and "<img src=x" not in page and "<b>" not in page
        assert "&lt;script&gt;alert(1)" in page


def test_only_the_scripts_of_the_page_may_run(tmp_path: Path, page: str) -> None:
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="(.*?)"', page)
    allowed = set(re.findall(r"sha256-([^&]*)&", policy))
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    assert allowed == {base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts}
    assert len(scripts) == 2 and policy.startswith("default-src &#39;none&#39;")
    assert "script-src &#39;none&#39;" in failure_page(tmp_path)


def test_a_page_is_one_small_file_that_points_nowhere_else(page: str) -> None:
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href|action)="(?!data:|#)[^"]*"', markup)
    assert "@import" not in markup and "url(http" not in markup
    assert len(page) < 1_500_000


def test_a_page_is_the_same_file_every_time(tmp_path: Path, page: str, certificate: dict[str, Any]) -> None:
    assert case_page(tmp_path, certificate) == page


def test_every_picture_has_its_words(page: str) -> None:
    pictures = re.findall(r"<img [^>]*>", page)
    assert len(pictures) == 8
    assert all(re.search(r'alt="[^"]{10,}"', picture) for picture in pictures)
    charts = re.findall(r'<figure role="img" aria-label="([^"]*)">', page)
    assert len(charts) == 2 and all("This mesh:" in words for words in charts)


def test_what_is_not_known_of_a_case_is_left_out() -> None:
    assert about({"surface": "white"}) == [("Surface", "white, with the cortex outside it")]
    assert about({"surface": None, "scan_age": 28.0, "hemi": None}) == [
        ("Age at scan", "28 weeks"),
        ("Shape", "whole brain"),
    ]
    assert about({"cell_size": 0.6, "mesher": "cgal"}) == [("Cell size", "0.6 mm"), ("Mesher", "cgal")]


def test_a_figure_takes_the_colours_of_the_page() -> None:
    svg = '<?xml?><svg id="a"><metadata>date</metadata><path style="stroke: #000000" clip-path="url(#a)"/></svg>'
    drawn = embedded(svg, "one")
    assert drawn.startswith("<svg aria-hidden") and "date" not in drawn
    assert 'id="one-a"' in drawn and "url(#one-a)" in drawn and "stroke: currentColor" in drawn


def test_the_page_has_the_distances_to_the_native_surface(tmp_path: Path) -> None:
    mesh, made = ball_mesh(2, radius=20.0), ball_surface(3, radius=20.0)
    native = TriSurface(made.points * 1.01, made.faces)
    certificate = asdict(certify(mesh, made, native=native))
    write_case_page(mesh, native, certificate, tmp_path / "x.html", meshed=made)
    text = (tmp_path / "x.html").read_text()
    assert "Vertices and face centres of the native surface to the boundary" in text
    assert f"{certificate['native']['native_to_boundary_mm']['mean']:.4g}" in text
    assert "Area of the native surface" in text
