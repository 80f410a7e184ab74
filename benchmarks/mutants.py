"""Do the tests notice small faults in the code?

    python benchmarks/mutants.py [--mutants 40] [--seed 1] [--rooms measure optimise stages formats] [--limit 300]

One row per fault: a comparison turned, + and - exchanged, another number, a condition negated, a `not` dropped, `min`
for `max`, `and` for `or`. As many faults in each room, at random; they are the same as long as the code is. Each stands
alone in a copy of the checkout, which keeps compiled kernels in a folder of its own. There the tests of its room run
until one fails: then it is found, and also where they take more than `limit` seconds. Before, all of them must pass.
"""

from __future__ import annotations

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from _frame import ROOT, Table, command

from cortet.geometry.kernel_cache import cache_folder

PAIRS = ("<,>=", ">,<=", "==,!=", "+,-", "*,/", "and,or", "min,max", "is,is not", "in,not in")
#: what takes the place of a word
OTHER = {a: b for pair in PAIRS for a, b in (pair.split(","), pair.split(",")[::-1])}


class Mutant(NamedTuple):
    """A change of the bytes from start to end."""

    file: Path
    start: int
    end: int
    new: str
    said: str


def mutants(
    *,
    mutants: int = 40,
    seed: int = 1,
    rooms: Sequence[str] = ("measure", "optimise", "stages", "formats"),
    limit: float = 300.0,
) -> None:
    """Make small faults and see which of them the tests find."""
    table, chosen, outcomes = Table(f"{'file':32}", "line", "change       ", "outcome"), random.Random(seed), []
    with tempfile.TemporaryDirectory(prefix="cortet-mutants-") as folder:
        copy = copied(Path(folder))
        for room in rooms:
            if (outcome := tested(copy, room, limit)) != "survived":
                sys.exit(f"tests/{room}, without a fault: {outcome}")
            possible = [one for file in sorted(ROOT.glob(f"cortet/{room}/*.py")) for one in changes(file)]
            for mutant in sorted(chosen.sample(possible, mutants // len(rooms))):
                name, source = mutant.file.relative_to(ROOT), mutant.file.read_bytes()
                (copy / name).write_bytes(source[: mutant.start] + mutant.new.encode() + source[mutant.end :])
                outcomes.append(tested(copy, room, limit))
                (copy / name).write_bytes(source)
                table.values(name, source[: mutant.start].count(b"\n") + 1, mutant.said, outcomes[-1])
    print(f"found: {len(outcomes) - outcomes.count('survived')} of {len(outcomes)}")


def copied(folder: Path) -> Path:
    """A copy of the checkout, the shared data beside it, and the kernels compiled so far."""
    shutil.copytree(ROOT, folder / "copy", ignore=shutil.ignore_patterns(".*", "__pycache__"))
    (folder / "shared").symlink_to(ROOT.parent / "shared")
    shutil.copytree(cache_folder(), folder / "cache" / "cortet" / "kernels")
    return folder / "copy"


def tested(copy: Path, room: str, limit: float) -> str:
    """What the tests of a room say of a copy."""
    places = {"PYTHONPATH": str(copy), "XDG_CACHE_HOME": str(copy.parent / "cache")}
    program = [sys.executable, *f"-m pytest tests/{room} -x -q -n 0 -p no:cacheprovider".split()]
    how = {"cwd": copy, "env": os.environ | places, "capture_output": True}
    try:
        done = subprocess.run(program, check=False, timeout=limit, **how)
    except subprocess.TimeoutExpired:
        return "found (time)"
    return "found" if done.returncode else "survived"


def changes(file: Path) -> Iterator[Mutant]:
    """All small changes within the functions of a file."""
    source = file.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def span(node: ast.expr) -> tuple[int, int]:
        return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

    def other(start: int, end: int) -> Iterator[Mutant]:
        if (old := source[start:end].decode().strip("() \n")) in OTHER:
            start += source[start:end].index(old.encode())
            yield Mutant(file, start, start + len(old), OTHER[old], f"{old} -> {OTHER[old]}")

    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for node in dict.fromkeys(inner for function in functions for part in function.body for inner in ast.walk(part)):
        match node:
            case ast.If(test=test) | ast.IfExp(test=test):
                yield Mutant(file, *span(test), f"not ({source[slice(*span(test))].decode()})", "if -> if not")
            case ast.UnaryOp(op=ast.Not()):
                yield Mutant(file, span(node)[0], span(node)[0] + len("not"), "", "not ->")
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                yield Mutant(file, *span(node), str(value + 1), f"{value} -> {value + 1}")
            case ast.Call(func=ast.Name() | ast.Attribute() as function):
                yield from other(span(function)[1] - len("min"), span(function)[1])
            case ast.Compare(left=a, comparators=[b]) | ast.BinOp(left=a, right=b) | ast.BoolOp(values=[a, b]):
                yield from other(span(a)[1], span(b)[0])


main = command(__doc__, mutants)

if __name__ == "__main__":
    main()
