"""Pages for a browser: each is one file, reads the same without scripts, and makes no network request.

A page is a list of panels, and a panel a list of parts. A part is the name of a macro of `templates/macros.html.j2` or
`case.html.j2`, with the macro's arguments; `templates/page.html.j2` is the page around them.

Anybody may have written the files from which names and messages come. So every text is escaped (Jinja2), and the page's
policy allows no request and only the page's own scripts, each by its hash.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import itertools
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jinja2

from cortet.formats.atomic import atomic_path
from cortet.formats.tables import Column, Row
from cortet.formats.tsv import MISSING
from cortet.report.colours import BLUE
from cortet.version import __version__

#: version of the pages of cases and of the cohort, and of their templates
VERSION: int = 13

#: characters that turn the direction of a text, so that a name may read as another one
_TURNING = dict.fromkeys(
    (0x200E, 0x200F, 0x061C, *range(0x202A, 0x202F), *range(0x2066, 0x206A)), "\N{REPLACEMENT CHARACTER}"
)

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("cortet.report", "templates"),
    autoescape=True,
    finalize=lambda value: value.translate(_TURNING) if isinstance(value, str) else value,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters["json"] = functools.partial(json.dumps, indent=2)
#: sides of the head, as captions call them
SIDES: dict[Literal["L", "R"], str] = {"L": "left", "R": "right"}

#: a text of more characters gets room for several lines in a cell
_LONG = 40

#: a macro and its argument, or its arguments by name
Part = tuple[str, Any]


class Panel(NamedTuple):
    """A section of a page."""

    #: its anchor on the page, for links and the style sheet
    name: str
    title: str
    parts: Sequence[Part]


def write(
    path: str | Path,
    title: str,
    panels: Sequence[Panel],
    *,
    heading: str | None = None,
    state: str = "",
    verdict: str = "",
    top: Sequence[Part] = (),
    end: Sequence[Part] = (),
    cohort: str = "",
    wide: bool = False,
    scripts: Sequence[str] = (),
) -> None:
    """Write a page.

    Parameters
    ----------
    title : title of the window
    heading : heading of the page; None: the title
    state : state of the case, beside the heading
    verdict : words for the state, if they say more
    top : parts between heading and panels
    end : parts after the panels
    cohort : address of the cohort page, as seen from this page
    wide : whether the page holds wide tables
    scripts : texts of the scripts of the page, in the order in which they run
    """
    page = _TEMPLATES.get_template("page.html.j2").render(
        title=title,
        panels=panels,
        heading=heading,
        state=state,
        verdict=verdict,
        top=top,
        end=end,
        cohort=cohort,
        wide=wide,
        scripts=scripts,
        policy=_policy(scripts),
        style=source("style.css"),
        version=__version__,
    )
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def table(
    caption: str,
    columns: Sequence[Column],
    rows: Iterable[Row],
    *,
    name: str = "",
    cohort: bool = False,
    sortable: bool = False,
    first: int | None = None,
    attributes: Iterable[Row] = (),
) -> Part:
    """A table as a part of a page; its first column names the rows.

    Parameters
    ----------
    columns : columns with a form hold numbers; a heading shows its description under the mouse
    rows : value by name of the column: a text, a number, or the macro of a cell and what it shows
    name : name for screen readers; empty: the caption
    cohort : the table has many columns, and its first column stays in sight
    sortable : `table.js` sorts and filters it
    first : number of columns shown at first; the reader can choose others (`table.js`); None: all
    attributes : attributes of the HTML element of each row
    """
    return "table", {
        "caption": caption,
        "name": name or caption,
        "sortable": sortable,
        "attributes": {"id": "table" if sortable else None, "class": "cohort" if cohort else None},
        "headings": [
            (
                column.heading,
                {
                    "class": "n" if column.form else None,
                    "title": column.description or None,
                    "data-more": "" if first is not None and place >= first else None,
                },
            )
            for place, column in enumerate(columns)
        ],
        "rows": [
            ([_cell(column, row, sortable) for column in columns], own)
            for row, own in itertools.zip_longest(rows, attributes, fillvalue=dict[str, Any]())
        ],
    }


def _cell(column: Column, row: Row, sortable: bool) -> tuple[str | Part, dict[str, Any]]:
    """Content of a cell, and the attributes of its HTML element."""
    value = row.get(column.name)
    if isinstance(value, tuple):
        return value, {"class": "n" if column.form else value[0]}
    text = column.text(row)
    kind = "n" if column.form else "t" if len(text) > _LONG else None
    return "" if text == MISSING else text, {"class": kind, "data-value": column.number(row) if sortable else None}


def source(name: str) -> str:
    """Text of a style sheet or script of `cortet/templates`."""
    return Path(__file__).with_name("templates").joinpath(name).read_text(encoding="utf-8")


def data_uri(webp: bytes) -> str:
    """A `data:` address that holds a WebP picture."""
    return f"data:image/webp;base64,{base64.b64encode(webp).decode()}"


def embedded(svg: str, name: str) -> str:
    """A figure as part of a page, with the page's background, black and blue.

    Parameters
    ----------
    svg : text of an SVG file that `cortet.report.figures` made
    name : put before its ids, to keep them apart from those of other figures
    """
    text = svg[svg.index("<svg") :]
    for colour, ours in (("#000000", "currentColor"), ("#ffffff", "none"), (BLUE.lower(), "var(--bar)")):
        text = text.replace(colour, ours)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", text)
    return text.replace("<svg ", '<svg aria-hidden="true" focusable="false" ', 1)


def _policy(scripts: Sequence[str]) -> str:
    """Content Security Policy (level 2) of a page: a browser may run these scripts and show the page's own content."""
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{value}'" for value in hashes) or "'none'"
    rules = ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", f"script-src {allowed}"]
    return "; ".join([*rules, "base-uri 'none'", "form-action 'none'"])
