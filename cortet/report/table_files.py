"""A table in the forms it is needed in: TSV with a JSON sidecar for machines; LaTeX, Markdown and HTML for readers."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.tsv import MISSING, write_tsv

VERSION: int = 1

Row = Mapping[str, Any]

#: what headings and cells hold -> how LaTeX sets it; the rest is escaped
_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "#": r"\#",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
    "_": r"\_",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"$<$",
    ">": r"$>$",
    "±": r"$\pm$",
}  # fmt: skip
_HTML_STYLE = (
    "body{font:14px sans-serif;margin:1.5em}"
    "table{border-collapse:collapse;border-top:2px solid;border-bottom:2px solid}"
    "th{border-bottom:1px solid;text-align:left}th,td{padding:.25em .8em;white-space:nowrap;vertical-align:top}"
    "tr.rule td{border-top:1px solid}td:last-child{white-space:normal}p{max-width:60em}"
    "dt{font-weight:bold;margin-top:.5em}"
)


@dataclass(frozen=True)
class Shown:
    """One column for readers, which may gather several columns of the TSV."""

    heading: str
    #: text of the cell of a row
    text: Callable[[Row], str]
    description: str


@dataclass(frozen=True)
class Table:
    """What a table is made of besides its rows."""

    title: str
    #: column of the TSV -> its description and units, as in a BIDS sidecar
    columns: Mapping[str, Mapping[str, Any]]
    shown: Sequence[Shown]
    #: readers see a line between two rows for which this differs
    group: Callable[[Row], Any] = lambda _: None


def write(table: Table, rows: Sequence[Row], *paths: str | Path) -> None:
    """Write the table once per path, in the form of its suffix: tsv, json (the sidecar of the TSV), tex, md or html."""
    cells = [[column.text(row) for column in table.shown] for row in rows]
    headings = [column.heading for column in table.shown]
    starts = [i > 0 and table.group(rows[i - 1]) != table.group(row) for i, row in enumerate(rows)]
    texts = {".tex": _latex, ".md": _markdown, ".html": _html}
    for path in map(Path, paths):
        if path.suffix == ".tsv":
            write_tsv(rows, list(table.columns), path)
        elif path.suffix == ".json":
            write_json(table.columns, path)
        else:
            with atomic_path(path) as temporary:
                temporary.write_text(texts[path.suffix](table, headings, cells, starts), encoding="utf-8")


def write_view(table: str | Path, sidecar: str | Path, path: str | Path, *, title: str) -> None:
    """Write an HTML page of a TSV, each column explained as its sidecar does."""
    explained = json.loads(Path(sidecar).read_text(encoding="utf-8"))
    header, *rows = (line.split("\t") for line in Path(table).read_text(encoding="utf-8").splitlines())
    shown = [Shown(name, itemgetter(name), _explanation(explained[name])) for name in header]
    write(Table(title, explained, shown), [dict(zip(header, row, strict=True)) for row in rows], path)


def write_page(text: str, path: str | Path, *, title: str) -> None:
    """Write an HTML page of one paragraph."""
    with atomic_path(path) as temporary:
        temporary.write_text(f"{_head(title)}\n<p>{html.escape(text)}</p>\n</html>\n", encoding="utf-8")


def _explanation(entry: Mapping[str, Any]) -> str:
    """What a sidecar says of a column, in one line."""
    parts = [str(entry["Description"])]
    parts += [f"{key.lower()}: {entry[key]}" for key in ("Units", "Threshold") if key in entry]
    parts += [f"{level}: {meaning}" for level, meaning in entry.get("Levels", {}).items()]
    return "; ".join(parts)


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many decimals, or `n/a`."""
    return MISSING if value is None else f"{value:.{digits}f}"


def mean_and_sd(mean: float | None, sd: float | None, digits: int = 3) -> str:
    """`mean ± sd`; the mean alone where there is no sd."""
    return number(mean, digits) + ("" if sd is None else f" ± {sd:.{digits}f}")


def median_and_range(median: float | None, low: float | None, high: float | None, digits: int = 3) -> str:
    """`median [low-high]`; the median alone where all are the same."""
    spread = "" if low is None or high is None or low == high else f" [{low:.{digits}f}-{high:.{digits}f}]"
    return number(median, digits) + spread


def _latex(table: Table, headings: Sequence[str], cells: Sequence[Sequence[str]], starts: Sequence[bool]) -> str:
    def line(texts: Sequence[str]) -> str:
        escaped = ["".join(_LATEX.get(letter, letter) for letter in text) for text in texts]
        return " & ".join(re.sub(r"(?<=\d)-(?=\d)", "--", text) for text in escaped) + r" \\"  # ranges

    body = [("\\midrule\n" if start else "") + line(row) for start, row in zip(starts, cells, strict=True)]
    top = [f"% {table.title}; needs the package booktabs", rf"\begin{{tabular}}{{{'l' * len(headings)}}}", r"\toprule"]
    return "\n".join([*top, line(headings), r"\midrule", *body, r"\bottomrule", r"\end{tabular}", ""])


def _markdown(table: Table, headings: Sequence[str], cells: Sequence[Sequence[str]], _: Sequence[bool]) -> str:
    def line(texts: Sequence[str]) -> str:
        return "| " + " | ".join(text.replace("|", r"\|") for text in texts) + " |"

    notes = [f"- **{column.heading}**: {column.description}" for column in table.shown]
    lines = [f"**{table.title}**", "", line(headings), "|" + "---|" * len(headings), *map(line, cells), "", *notes]
    return "\n".join([*lines, ""])


def _html(table: Table, headings: Sequence[str], cells: Sequence[Sequence[str]], starts: Sequence[bool]) -> str:
    def line(tag: str, texts: Sequence[str], start: bool = False) -> str:
        inside = "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts)
        return f"<tr{' class=rule' if start else ''}>{inside}</tr>"

    body = [line("td", row, start) for start, row in zip(starts, cells, strict=True)]
    notes = [
        f"<dt>{html.escape(column.heading)}</dt><dd>{html.escape(column.description)}</dd>" for column in table.shown
    ]
    lines = [_head(table.title), "<table>", line("th", headings), *body, "</table>", "<dl>", *notes, "</dl>"]
    return "\n".join([*lines, "</html>", ""])


def _head(title: str) -> str:
    name = html.escape(title)
    head = f"<!doctype html><html lang=en><meta charset=utf-8><title>{name}</title><style>{_HTML_STYLE}</style>"
    return f"{head}\n<h3>{name}</h3>"
