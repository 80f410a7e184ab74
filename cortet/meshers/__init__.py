"""Ways to fill a surface with tetrahedra, which `cortet.stages.generate` chooses from: each declares itself.

This is the only list. Like the modules of stages, those here are light; modules whose names begin with `_` are parts of
meshers, and load with them. A new mesher is a new file in this folder (CONTRIBUTING.md shows one).
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from cortet.meshers.mesher import Mesher

__all__ = ["BASELINES", "MESHERS", "OWN", "Mesher"]


def _found() -> dict[str, Mesher]:
    """The meshers that all modules in this folder declare, by name, in their order."""
    modules = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__) if module.name[0] != "_"]
    meshers = [mesher for module in modules for mesher in getattr(module, "MESHERS", ())]
    return {mesher.name: mesher for mesher in sorted(meshers, key=lambda mesher: (mesher.order, mesher.name))}


MESHERS = _found()
#: those of the line
OWN = {name: mesher for name, mesher in MESHERS.items() if mesher.own}
#: those of other projects, to compare with
BASELINES = {name: mesher for name, mesher in MESHERS.items() if not mesher.own}
