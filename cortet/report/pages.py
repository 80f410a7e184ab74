"""Pages for a browser: each is one file, reads the same without scripts, and asks the network for nothing.

Every text is escaped (Jinja2), and the page's own policy allows no script but those it was written with, each named by
its hash, and no request at all: names and messages on it come from files that anybody may have written.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import jinja2

from cortet import __version__
from cortet.formats.atomic import atomic_path
from cortet.report.figures import BLUE

#: of the pages of cases and of the cohort, and of their templates
VERSION: int = 3

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("cortet.report", "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write(template: str, path: str | Path, *, scripts: Sequence[str] = (), **content: Any) -> None:
    """Write a page.

    Parameters
    ----------
    template : name of a file of `cortet/templates`
    scripts : texts of the scripts that run on it, in this order
    content : what the template shows
    """
    page = _TEMPLATES.get_template(template).render(
        content,
        policy=_policy(scripts),
        scripts=scripts,
        style=source("style.css"),
        version=__version__,
    )
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def source(name: str) -> str:
    """Text of a style sheet or script of `cortet/templates`."""
    return (files("cortet.report") / "templates" / name).read_text(encoding="utf-8")


def data_uri(content: bytes, media_type: Literal["image/webp", "image/png"]) -> str:
    """A file as an address that holds it."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


def embedded(svg: str, name: str) -> str:
    """A figure of ours as part of a page, on its ground and with its black and blue.

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
    """What a browser may do on the page (Content Security Policy, level 2): run these scripts, show what it holds."""
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{value}'" for value in hashes) or "'none'"
    rules = ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", f"script-src {allowed}"]
    return "; ".join([*rules, "base-uri 'none'", "form-action 'none'"])
