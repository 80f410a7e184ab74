"""Writes what a study has found."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from cortet.formats.atomic import atomic_path
from cortet.report.figures import save
from cortet.report.table_files import Table, write


def write_outputs(
    outputs: Iterable[str | Path], table: Table, rows: pd.DataFrame, figure: Figure, words: str = ""
) -> None:
    """Write a table, its figure, and words about it, each in the form of the path's suffix."""
    paths = [*map(Path, outputs)]
    figures = [path for path in paths if path.suffix in (".svg", ".pdf", ".png")]
    texts = [path for path in paths if path.suffix == ".txt"]
    write(table, rows, *(path for path in paths if path not in (*figures, *texts)))
    save(figure, *figures)
    for path in texts:
        with atomic_path(path) as temporary:
            temporary.write_text(words, encoding="utf-8")
