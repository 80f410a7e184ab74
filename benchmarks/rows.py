"""Tables of benchmarks: each row comes from a process of its own and is printed as it ends."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from typing import Any


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
