"""What all benchmarks share: a question as a command, a process that is measured, a mesh and what it took, a table."""

from __future__ import annotations

import re
import resource
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from cyclopts import App, Parameter

from cortet.config import Config, load
from cortet.errors import CortetError
from cortet.meshes import TriSurface
from cortet.phantoms import phantom
from cortet.pipeline import Meshed, Step, mesh_surface
from cortet.stages.stage import About, State

ROOT = Path(__file__).resolve().parents[1]
Row = Mapping[str, Any]
_PROCESS = Path("/proc/self")


def command(about: str | None, *questions: Callable[..., int | None]) -> App:
    """The command of a file: the first question is asked where the first word names no other one."""
    one_word = Parameter(negative=(), consume_multiple=True)
    app = App(help=about, help_format="plaintext", default_parameter=one_word)
    app.default(questions[0])
    for question in questions[1:]:
        app.command(question)
    return app


# --- tables ----------------------------------------------------------------------------------------------------------


class Table:
    """Rows below a heading, each printed as it ends."""

    def __init__(self, *columns: str) -> None:
        self.columns = columns
        self._print(columns)

    def add(self, *parts: Row) -> dict[str, Any]:
        """Print a row, which is given in parts; the row."""
        row = {key: value for part in parts for key, value in part.items()}
        cells = [_cell(row.get(column, "")) for column in self.columns]
        self._print(cells)
        return row

    def values(self, *values: object) -> None:
        """Print a row that is given by its values."""
        self.add(dict(zip(self.columns, values, strict=True)))

    def _print(self, cells: Sequence[str]) -> None:
        widths = (max(len(column), 9) for column in self.columns)
        print("  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip(), flush=True)


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else " ".join(str(value).split())


def print_power(name: str, rows: Iterable[Row], x: str = "tets", y: str = "cpu_seconds") -> None:
    """With which power of `x` the values `y` of some rows grow (least squares of the logarithms), from two sizes on."""
    known = [row for row in rows if x in row]
    if len({row[x] for row in known}) > 1:
        sizes, values = ([row[key] for row in known] for key in (x, y))
        print(f"{name}: {y} grows as {x}^{np.polyfit(np.log(sizes), np.log(values), 1)[0]:.2f}")


# --- what is measured ------------------------------------------------------------------------------------------------


def alone(measure: Callable[..., Row], *given: Any) -> Row:
    """A row that is measured in a fresh process; `why_not` where that could not, or ended without a word."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            return pool.submit(_answer, measure, *given).result()
        except BrokenProcessPool:
            return {"why_not": "the process ended without a word"}


def _answer(measure: Callable[..., Row], *given: Any) -> Row:
    try:
        return measure(*given)
    except CortetError as error:
        return {"why_not": str(error)}


def cpu_seconds() -> float:
    """CPU seconds of this process, all its threads, and of its children that ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def reset_peak_memory() -> None:
    """Start a new measurement of the peak (Linux: proc(5), clear_refs); no effect elsewhere."""
    if (_PROCESS / "clear_refs").exists():
        (_PROCESS / "clear_refs").write_text("5")


def peak_memory_mb() -> int | None:
    """Peak resident memory since the last reset, MB; None if the system does not report it."""
    if not (_PROCESS / "status").exists():
        return None
    found = re.search(r"VmHWM:\s+(\d+) kB", (_PROCESS / "status").read_text())
    return round(int(found[1]) * 1024 / 1e6) if found else None


@contextmanager
def spent() -> Iterator[dict[str, float]]:
    """CPU seconds that a block takes, and MB of its peak above what was there before."""
    reset_peak_memory()
    before, used = peak_memory_mb() or 0, dict[str, float]()
    began = cpu_seconds()
    yield used
    used |= {"cpu_seconds": cpu_seconds() - began, "peak_MB": (peak_memory_mb() or 0) - before}


class Line(NamedTuple):
    """A mesh, and what the line took to make it, without the certificate."""

    made: Meshed
    #: report of each stage
    reports: dict[str, Any]
    #: CPU and wall seconds, and MB of the peak above what was there before
    used: dict[str, float]


def mesh(
    surface: TriSurface,
    config: Config,
    say: Callable[[Step, float], None] = lambda *_: None,
    small: TriSurface | None = None,
    **known: Any,
) -> Line:
    """Mesh a surface, another, `small` one before it, which compiles; `say` hears of stages and their CPU seconds."""
    coarse = config.generate.model_copy(update={"cell_size": [4.0]})
    mesh_surface(State(small or phantom(24.0, subdivisions=3)), config.model_copy(update={"generate": coarse}))
    reports: dict[str, Any] = {}
    reset_peak_memory()
    idle, last = peak_memory_mb() or 0, cpu_seconds()
    used = {"cpu_seconds": 0.0, "wall_seconds": 0.0, "peak_MB": 0.0}

    def after(step: Step) -> None:
        nonlocal last
        now = cpu_seconds()
        used["cpu_seconds"] += now - last
        used["wall_seconds"] += step.seconds
        used["peak_MB"] = (peak_memory_mb() or 0) - idle
        reports[step.stage] = step.report
        say(step, now - last)
        last = cpu_seconds()

    return Line(mesh_surface(State(surface), config, About(**known), progress=after), reports, used)


def config_of(cell_size: float, *changes: str, **data: Any) -> Config:
    """A configuration at one cell size; changes are `section.key=value`, as in its file, or the name of a mesher."""
    merged = {**data, "generate": {**data.get("generate", {}), "cell_size": cell_size}}
    for change in filter(None, changes):
        key, _, value = (change if "=" in change else f"generate.meshers=[{change}]").partition("=")
        section, _, name = key.partition(".")
        merged[section] = {**merged.get(section, {}), name: yaml.safe_load(value)}
    return load(merged)


def name_of(file: Path) -> str:
    """Name of a surface in a table."""
    return file.name.removesuffix(".surf.gii")
