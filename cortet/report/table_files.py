"""Tables in several forms: TSV with a JSON sidecar for machines; LaTeX for readers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from pandas.io.formats.style import Styler

from cortet.formats.atomic import atomic_path
from cortet.formats.tables import Column, Row, described, headed, write_table
from cortet.formats.tsv import MISSING

VERSION: int = 6

#: what LaTeX prints only in mathematical mode
_MATHEMATICAL = {"<": "$<$", ">": "$>$", "±": r"$\pm$", "²": "$^2$"}
#: symbols of quantities in headings, which print has in italics, and their index; LaTeX escapes what is before it
_SYMBOL = re.compile(r"\b([hJnqr])(?:\\?_(max))?\b")
#: LaTeX of a column of sentences, and the longest text that stands in one line of it, characters
_SENTENCES, _LINE = "p{2.4cm}", 30
#: a cell that holds a number, alone or with its spread, or a range
_NUMBER = re.compile(r"[-+]?[\d.,]+(?:e[-+]\d+|-[\d.,]+)?(?: ± .*| \[.*| \(.*)?")


@dataclass(frozen=True)
class Table:
    """Properties of a table besides its rows."""

    title: str
    #: of the TSV
    columns: Sequence[Column]
    #: names of columns; of those with a heading, readers see these first. None: they see all columns as in the TSV
    first: Sequence[str] | None = None
    #: names of columns; readers see a line between two rows that differ in one of them
    group: Sequence[str] = ()

    @property
    def printed(self) -> list[Column]:
        """The columns that readers see."""
        if self.first is not None:
            return headed(self.columns, self.first)
        return [Column(one.name, described(one.entry), heading=one.name) for one in self.columns]


def write(table: Table, rows: pd.DataFrame | Iterable[Row], *paths: str | Path) -> None:
    """Write the table once per path, in the form of its suffix: tsv, json (the sidecar of the TSV) or tex.

    Parameters
    ----------
    rows : the columns of the TSV, and further ones, some of which readers see
    """
    frame = rows if isinstance(rows, pd.DataFrame) else pd.DataFrame(list(rows), dtype=object)
    texts, starts = printed(table, frame), starts_of_groups(frame, table.group)
    for path in map(Path, paths):
        if path.suffix == ".tex":
            with atomic_path(path) as temporary:
                temporary.write_text(_latex(table, texts, starts), encoding="utf-8")
        else:
            write_table(table.columns, frame, path)


def printed(table: Table, rows: pd.DataFrame) -> pd.DataFrame:
    """The cells as readers see them, all strings, without line ends; one column per printed column."""
    records = rows.astype(object).where(rows.notna(), None).to_dict("records")
    texts = [[" ".join(column.text(row).split()) for column in table.printed] for row in records]
    return pd.DataFrame(texts, columns=[column.heading for column in table.printed], dtype=object)


def starts_of_groups(rows: pd.DataFrame, group: Sequence[str]) -> list[int]:
    """Indices of the rows that differ from the previous row in one of the columns `group`; never the first row."""
    if not group:
        return []
    numbers = rows.groupby(list(group), dropna=False, sort=False).ngroup().to_numpy()
    return [row for row in range(1, len(numbers)) if numbers[row] != numbers[row - 1]]


def number(value: float | None, digits: int = 3) -> str:
    """A number with `digits` decimals and a comma before thousands, or `n/a`."""
    return MISSING if value is None or not math.isfinite(value) else f"{value:,.{digits}f}"


def mean_and_sd(mean: float | None, sd: float | None, digits: int = 3, *, n: int | None = None) -> str:
    """`mean ± sd`, of two values `mean [low-high]`; the mean alone if there is no sd, or if it is 0.

    There are more decimals than `digits` if the sd of three or more values needs them, and fewer if it has more than
    two digits that count.

    Parameters
    ----------
    n : number of values
    """
    if mean is None or not sd or n == 1 or not math.isfinite(sd):
        return number(mean, digits)
    if n == 2:  # a deviation of two values says nothing that they do not say
        half = sd / 2**0.5
        return median_and_range(mean, mean - half, mean + half, digits)
    two = max(1 - math.floor(math.log10(sd)), 0)
    enough = next((more for more in range(min(digits, two), digits + 6) if round(sd, more)), digits)
    return f"{number(mean, enough)} ± {number(sd, enough)}"


def median_and_range(median: float | None, low: float | None, high: float | None, digits: int = 3) -> str:
    """`median [low-high]`; the median alone if all are the same."""
    ends = [number(end, digits) for end in (low, high) if end is not None]
    spread = f" [{'-'.join(ends)}]" if len(set(ends)) == 2 else ""
    return number(median, digits) + spread


def _latex(table: Table, texts: pd.DataFrame, starts: Sequence[int]) -> str:
    """LaTeX in letters of 7 points, as figures have, so that the tables of the paper fit both columns of a journal."""
    style = Styler(texts).hide(axis="index")
    kinds = [_alignment(texts.iloc[:, place]) for place in range(len(texts.columns))]
    style.format(_mathematical, escape="latex").format_index(_heading, axis="columns", escape="latex")
    for place in (place for place, kind in enumerate(kinds) if kind == _SENTENCES):
        ragged = {texts.columns[place]: lambda text: rf"\raggedright {_mathematical(text)}"}
        style.format(ragged, subset=[texts.columns[place]], escape="latex")
    with pd.option_context("styler.render.max_elements", texts.size):  # else pandas would leave out rows
        lines = style.to_latex(hrules=True, column_format="".join(["@{}", *kinds, "@{}"])).splitlines()
    first = lines.index(r"\midrule") + 1
    for row in reversed(starts):
        lines.insert(first + row, r"\midrule")
    lines = [re.sub(r" \\\\$", r" \\tabularnewline", line) for line in lines]  # \\ ends lines within a cell
    head = [f"% {table.title}; needs the package booktabs", r"{\scriptsize\setlength{\tabcolsep}{2.5pt}%"]
    return "\n".join([*head, *lines, "}", ""])


def _alignment(texts: pd.Series[str]) -> str:
    """Numbers to the right, words to the left, sentences in lines."""
    if _of_numbers(texts):
        return "r"
    return _SENTENCES if texts.str.len().max() > _LINE else "l"


def _mathematical(text: str) -> str:
    """A text escaped for LaTeX, with an en dash in ranges, and with mathematical mode for the signs that need it."""
    for sign, command in _MATHEMATICAL.items():
        text = text.replace(sign, command)
    text = re.sub(r"^-(?=\d)|(?<=[ \[])-(?=\d)|(?<=\d )-(?= )", "$-$", text)
    return re.sub(r"(?<=\d)-(?=\d)", "--", text)


def _heading(text: str) -> str:
    """A heading escaped for LaTeX, with its symbols in mathematical mode."""
    return _SYMBOL.sub(
        lambda found: f"${found[1]}" + (rf"_\mathrm{{{found[2]}}}" if found[2] else "") + "$", _mathematical(text)
    )


def _of_numbers(texts: pd.Series[str]) -> bool:
    """Whether all cells of a column that have a value hold numbers."""
    known = [text for text in texts if text != MISSING]
    return bool(known) and all(map(_NUMBER.fullmatch, known))
