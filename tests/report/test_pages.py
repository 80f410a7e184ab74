"""A page holds all it shows, quotes others without obeying them, and is the same file every time."""

from __future__ import annotations

import base64
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
from cortet.formats.electrodes import Contact
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.measure.electrodes import with_electrodes
from cortet.measure.quality import quality
from cortet.meshes import TetMesh, TriSurface
from cortet.report.boundary_view import boundary_view
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


def test_contacts_are_a_table_of_the_page_of_a_mesh_that_has_some(tmp_path, page, certificate):
    _, records = with_electrodes(MESH, [Contact("A1", (0, 0, 20.5), 6.0), Contact("B1", (1, 2, 3), None)])
    contacts = [asdict(replace(records[0], labels={"lobe": 3})), asdict(records[1])]
    text = case_page(tmp_path, {**certificate, "electrodes": contacts})
    (row,) = re.findall(r'<tr><th scope="row">A1</th>(.*?)</tr>', text)
    told = [f"{records[0].moved_mm:.2f}", f"{records[0].area_mm2:.2f}", "113.10", f"{records[0].radius_over_edge:.1f}"]
    assert re.findall(r">([^<>]+)<", row) == [*told, "lobe 3"]
    assert '<th scope="row">B1</th>' in text and 'id="contacts"' not in page


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


def test_a_name_that_turns_the_direction_of_text_is_shown_without_its_turn(tmp_path, certificate):
    """`x[U+202E]gpj.exe` would read as `xexe.jpg`."""
    case = case_page(tmp_path, {**certificate, "case": "x\u202egpj"}, facts={"\u2066y": "z\u202e"})
    assert not {"\u202e", "\u2066"} & {*case} and "x\ufffdgpj" in case


def test_a_page_is_one_small_file_the_same_every_time_that_points_nowhere_else(tmp_path, page, certificate):
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href|action)="(?!data:|#)[^"]*"', markup)
    assert "@import" not in markup and "url(http" not in markup and 'content="default-src &#39;none&#39;' in page
    assert len(page) < 1_500_000 and case_page(tmp_path, certificate) == page


def unpacked(view: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (mm), faces and q of a view, as the page reads them."""
    points, q = (np.frombuffer(base64.b64decode(view[key]), "<u2").astype(float) for key in ("points", "q"))
    faces = np.frombuffer(base64.b64decode(view["faces"]), f"<u{view['index_bytes']}")
    return view["low"] + view["step"] * points.reshape(-1, 3), faces.reshape(-1, 3), q / 65535


def dented(mesh: TetMesh) -> TetMesh:
    """The mesh with one of its boundary nodes pushed in, which makes the elements around it bad."""
    points = mesh.points.copy()
    points[boundary_surface(mesh)[1][0]] *= 0.9
    return TetMesh(points, mesh.cells)


def test_a_fine_boundary_is_simplified_and_keeps_its_worst_q():
    mesh = dented(ball_mesh(3, radius=20.0))
    boundary, nodes = boundary_surface(mesh)
    view = boundary_view(mesh, [], max_faces=300)
    points, faces, q = unpacked(view)
    assert view["face_count"] == len(faces) <= 300 < view["boundary_faces"] == len(boundary.faces)
    at_boundary = np.isin(mesh.cells, nodes).any(axis=1)
    assert q.max() == pytest.approx(quality(mesh.points, mesh.cells[at_boundary]).max(), abs=1e-4)
    dent = boundary.points[0]
    assert np.linalg.norm(points[q.argmax()] - dent) < 6  # mm, the length of an edge of what is left
