"""Pages as a code host shows them, without a build."""

from __future__ import annotations

import re
from pathlib import Path

from docs.from_code import stages_table

DOCS = Path(__file__).parents[2] / "docs"


def test_pages_have_no_holes_without_a_build():
    """As a code host shows them: the table of stages is in its page, and each directive says where to look."""
    assert stages_table() in (DOCS / "stages/index.md").read_text("utf-8")
    empty = re.compile(r"^```\{(parameters|messages|limits|commands)\}.*\n```$", re.MULTILINE)
    assert not [page for page in DOCS.rglob("*.md") if empty.search(page.read_text("utf-8"))]
