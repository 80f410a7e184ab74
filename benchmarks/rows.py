"""Tables of benchmarks: each row comes from a process of its own and is printed as it ends."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np


def in_own_process(measure: Callable[..., None], *args: object) -> dict[str, Any]:
    """Run `measure(*args, answer)` in a fresh process, whose end without an answer is an answer, too."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=measure, args=(*args, send))
    process.start()
    send.close()
    try:
        row: dict[str, Any] = receive.recv()
    except EOFError:
        row = {"surface": str(args[0]), "h_mm": args[1], "why_not": "the process ended without a word"}
    process.join()
    return row


def print_row(columns: Sequence[str], row: dict[str, Any]) -> None:
    """One line of tab-separated values."""
    values = (row.get(column, "") for column in columns)
    print(*(f"{value:.4g}" if isinstance(value, float) else value for value in values), sep="\t", flush=True)


def print_power(name: str, rows: Iterable[dict[str, Any]], x: str = "tets", y: str = "cpu_s") -> None:
    """With which power of `x` the values `y` of some rows grow (least squares of the logarithms), from two sizes on."""
    known = [row for row in rows if x in row]
    if len({row[x] for row in known}) > 1:
        sizes, values = ([row[key] for row in known] for key in (x, y))
        print(f"{name}: {y} grows as {x}^{np.polyfit(np.log(sizes), np.log(values), 1)[0]:.2f}")
