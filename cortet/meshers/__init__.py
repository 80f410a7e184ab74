"""Ways to fill a surface with tetrahedra, which `cortet.stages.generate` chooses from: each declares itself.

This is the only list. Like stage modules, mesher modules are light; modules whose names begin with `_` are parts of
meshers and load with them. A new mesher is a new file in this folder (CONTRIBUTING.md shows one).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cortet.meshers.mesher import Mesher
from cortet.sections import public_modules

__all__ = ["BASELINES", "MESHERS", "OWN", "Mesher", "MesherName"]


def _found() -> dict[str, Mesher]:
    """The meshers that all modules in this folder declare, by name, in their order."""
    meshers = [mesher for module in public_modules(__name__, __path__) for mesher in getattr(module, "MESHERS", ())]
    return {mesher.name: mesher for mesher in sorted(meshers, key=lambda mesher: (mesher.order, mesher.name))}


MESHERS = _found()
#: those of the line
OWN = {name: mesher for name, mesher in MESHERS.items() if mesher.own}
#: those of other projects, to compare with
BASELINES = {name: mesher for name, mesher in MESHERS.items() if not mesher.own}

if TYPE_CHECKING:
    MesherName = str
else:  # what a section of the configuration may name
    MesherName = Literal[tuple(MESHERS)]
