"""Every case of a run has its page, also one that failed, and one page leads to all of them."""

from __future__ import annotations

import base64
import re
from pathlib import Path

from tests.integration.study import Study


def page_of(study: Study, participant: str) -> Path:
    (page,) = study.files(f"sub-{participant}_*_report.html")
    return page


def linked(study: Study) -> dict[str, Path]:
    """Case -> page that the cohort's page leads to."""
    index = study.folder / "derivatives/cortet/cohort/index.html"
    links = re.findall(r'<th scope="row"><a href="([^"]*)">(.*?)</a>', index.read_text())
    return {name.replace("<wbr>", ""): (index.parent / address).resolve() for address, name in links}


def pictured(study: Study) -> list[bytes]:
    """The thumbnails on the cohort's page."""
    index = study.folder / "derivatives/cortet/cohort/index.html"
    held = re.findall(r'<img class="thumbnail" src="data:image/webp;base64,(.*?)"', index.read_text())
    return [base64.b64decode(content) for content in held]


def test_every_case_has_a_page_and_the_cohort_one_that_leads_to_them(finished):
    assert sorted(pictured(finished)) == sorted(file.read_bytes() for file in finished.files("*_thumbnail.webp"))
    assert len(pictured(finished)) == 2
    assert linked(finished) == {f"sub-{name}_hemi-L": page_of(finished, name).resolve() for name in "ab"}
    text = page_of(finished, "a").read_text()
    (back,) = re.findall(r'<nav aria-label="Cohort"><a href="([^"]*)">', text)
    assert (page_of(finished, "a").parent / back).resolve().name == "index.html"
    for file in re.findall(r'<a href="(sub-[^"]*)">', text):
        assert (page_of(finished, "a").parent / file).exists()


def test_pages_hold_no_time_and_are_made_alike_again(study):
    before = {path: path.read_bytes() for path in (*study.files("*_report.html"), *study.files("index.html"))}
    for path in before:
        path.unlink()
    assert study.jobs_of_run() == {("case_page", "sub-a"), ("case_page", "sub-b"), ("cohort_page", "-")}
    assert {path: path.read_bytes() for path in before} == before
