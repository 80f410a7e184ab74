"""The version of cortet, and of the code of its parts, which files record."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

__version__: str = "0.2.0"


@cache
def version_of(module: str) -> int:
    """`VERSION` of a module of cortet (`stages.clean`), read from its source: importing it would load Numba or Gmsh."""
    path = Path(__file__).parent.joinpath(*module.split(".")).with_suffix(".py")
    if found := re.search(r"^VERSION: int = (\d+)$", path.read_text(encoding="utf-8"), re.MULTILINE):
        return int(found[1])
    raise LookupError(f"{path} declares no VERSION")
