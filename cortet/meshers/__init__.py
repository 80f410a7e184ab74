"""Ways to fill a surface with tetrahedra, which `cortet.stages.generate` chooses from: each declares itself.

Every job of the workflow loads this list, so modules of meshers import what is heavy where they use it. Modules whose
names begin with `_` are parts of meshers. A new mesher is a new file in this folder (CONTRIBUTING.md shows one).
"""

from __future__ import annotations

from cortet.meshers import baselines, cgal, lattice
from cortet.meshers.mesher import Mesher

__all__ = ["BASELINES", "MESHERS", "OWN", "Mesher"]

#: all meshers by name
MESHERS = {mesher.name: mesher for mesher in (*cgal.MESHERS, *lattice.MESHERS, *baselines.MESHERS)}
#: those of the line
OWN = {name: mesher for name, mesher in MESHERS.items() if mesher.own}
#: those of other projects, to compare with
BASELINES = {name: mesher for name, mesher in MESHERS.items() if not mesher.own}
