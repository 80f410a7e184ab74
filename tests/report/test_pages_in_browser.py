"""Pages in a real browser without network: they ask for nothing, and can be read and worked by everybody."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright
from shapes import ball_mesh, ball_surface

from cortet.cohort.states import COLUMNS
from cortet.config.sections import Certify
from cortet.formats.atomic import write_json
from cortet.formats.tables import names
from cortet.formats.tsv import write_tsv
from cortet.measure.certify import certify
from cortet.report.case_page import Checked, write_case_page, write_failure_page
from cortet.report.cohort_page import write_cohort_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed (apt-get install chromium)")

#: WebGL on the processor, so that no graphics card is needed; no sandbox, since tests may run as root
OPTIONS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PAGES = ("case", "failure", "cohort")
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
#: worst q of the meshes of the cohort
WORST = {"a": 0.50, "b": 0.51, "c": 0.49, "d": 0.502, "e": 0.58, "f": 0.505}
PATIENCE = 120_000  # ms, of a busy machine


@dataclass
class Seen:
    """A page that is open, what it asked for and what went wrong on it."""

    page: Page
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a page of each kind."""
    folder = tmp_path_factory.mktemp("pages")
    mesh, surface = ball_mesh(2, radius=20.0), ball_surface(3, radius=20.0)
    certificate = asdict(
        certify(mesh, surface, Certify(q_max=0.3), case="sub-a_hemi-L", parameters={"clean": {"a": 1}})
    )
    shown = Checked(mesh, surface, surface, certificate)
    write_case_page(shown, folder / "case.html", facts={"Age": "28 weeks"}, cohort="cohort.html")
    failure = {"stage": "gate", "state": "failed", "reason": "a.gii: is open (close it)", "log": "logs/a.log"}
    opened = replace(surface, faces=surface.faces[1:])
    write_failure_page("sub-b_hemi-L", failure, folder / "failure.html", surface=opened, cohort="cohort.html")
    mesh_of = {"cell_size_mm": 0.6, "mesher": "cgal"}
    rows = [{"case": name, **mesh_of, "stage": "certify", "state": "certified"} for name in WORST]
    rows += [{"case": "y", **mesh_of, **failure}, {"case": "z", "state": "excluded", "reason": "motion"}]
    measured = [
        {"case": name, **mesh_of, "hemi": "L", "scan_age": 20 + 2 * n, "q_mean": 0.129, "q_max": q, "nodes": 1000}
        for n, (name, q) in enumerate(WORST.items())
    ]
    write_tsv(rows, names(COLUMNS), folder / "status.tsv")
    write_tsv(measured, list(measured[0]), folder / "quality.tsv")
    write_json({"q_max": {"Description": "Largest q", "Threshold": "< 0.6"}}, folder / "quality.json")
    pages = [{"case": row["case"], **mesh_of, "page": "case.html"} for row in rows]
    tables = folder / "quality.tsv", folder / "quality.json"
    write_cohort_page(folder / "status.tsv", tables, folder / "cohort.html", meshes=pages)
    return folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE)
        yield browser
        browser.close()


@pytest.fixture
def opened(browser: Browser, folder: Path) -> Iterator[Callable[..., Seen]]:
    """Opens a page in a browser that is offline."""
    contexts = []

    def open_page(name: str, **options: Any) -> Seen:
        contexts.append(browser.new_context(offline=True, **{"viewport": DESK, **options}))
        page = contexts[-1].new_page()
        page.set_default_timeout(PATIENCE)
        seen = Seen(page)
        page.on("request", lambda request: seen.requests.append(request.url))
        page.on("console", lambda message: seen.errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.goto((folder / f"{name}.html").as_uri())
        return seen

    yield open_page
    for context in contexts:
        context.close()


def drawn(part: Locator) -> np.ndarray:
    """A part of a page as it looks: (height, width, 3) uint8."""
    image = matplotlib.image.imread(io.BytesIO(part.screenshot()))
    return np.round(255 * image[:, :, :3]).astype(np.uint8)


def cases(page: Page) -> list[str]:
    """Names in the rows that are shown, from top to bottom."""
    return [name.strip() for name in page.locator("#table tbody tr:visible th").all_inner_texts()]


@pytest.mark.parametrize("name", PAGES)
def test_everybody_can_read_a_page_that_asks_for_nothing(opened, name):
    seen = opened(name)
    assert [url for url in seen.requests if not url.startswith("data:")] == [seen.page.url]
    assert seen.errors == []
    phone = {"viewport": PHONE, "has_touch": True, "is_mobile": True}
    for scheme, screen in (("light", {"viewport": DESK}), ("dark", phone)):
        page = opened(name, color_scheme=scheme, bypass_csp=True, **screen).page  # the checker is a script of its own
        found = Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth") <= screen["viewport"]["width"]
        ground = drawn(page.locator("header")).mean()
        assert ground > 200 if scheme == "light" else ground < 60


def test_a_reader_sorts_filters_and_chooses_columns(opened):
    page = opened("cohort").page
    assert cases(page)[:2] == ["y", "e"] and cases(page)[-1] == "z"
    heading = page.get_by_role("columnheader", name="Worst q")
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    assert cases(page)[: len(WORST)] == sorted(WORST, key=WORST.__getitem__)  # and those without a number last
    heading.get_by_role("button").press("Enter")
    assert cases(page)[: len(WORST)] == sorted(WORST, key=WORST.__getitem__, reverse=True)
    page.get_by_role("columnheader", name="Case").get_by_role("button").press("Space")
    assert heading.get_attribute("aria-sort") is None and cases(page) == [*WORST, "y", "z"]

    page.get_by_role("searchbox").fill("IS OPEN")
    assert cases(page) == ["y"] and page.locator("#count").inner_text() == "1 of 8 shown"
    page.get_by_role("searchbox").fill("")
    page.locator("#state").select_option("excluded")
    assert cases(page) == ["z"]
    page.get_by_role("button", name="Show all").press("Enter")
    expect(page.locator("#count")).to_have_text("8 of 8 shown")

    headings = page.get_by_role("columnheader")
    assert headings.count() == 8
    page.locator("#columns summary").click()
    page.locator("#columns input:not(:checked)").first.check()
    assert headings.count() == 9 and page.locator("#chosen").inner_text().startswith("9 of ")
    page.get_by_label("column Worst q").uncheck()
    assert headings.count() == 8

    page.get_by_role("link", name="e", exact=True).click()
    assert page.get_by_role("heading", level=1).inner_text().startswith("sub-a_hemi-L")
    page.get_by_role("link", name="All cases").click()
    assert page.get_by_role("heading", level=1).inner_text() == "All cases"


def test_the_view_shows_the_boundary_in_its_colours_and_turns(opened):
    page = opened("case").page
    canvas = page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    front = drawn(canvas).astype(int)
    colourful = np.ptp(front, axis=2) > 40
    assert 0.1 < colourful.mean() < 0.6  # a ball in the middle of the view
    assert colourful[front.shape[0] // 2, front.shape[1] // 2]
    canvas.press("ArrowLeft")
    turned = drawn(canvas).astype(int)
    assert np.abs(turned - front).max() > 40
    page.get_by_role("button", name="farther").click()
    assert (np.ptp(drawn(canvas).astype(int), axis=2) > 40).mean() < 0.8 * colourful.mean()
    page.get_by_role("button", name="top").click()
    canvas.click()
    assert page.locator("#picked").inner_text().startswith("q 0.")
