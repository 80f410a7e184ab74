"""What a fold needs besides its mesh."""

from __future__ import annotations

from typing import Literal

from cortet.config.fold import Fold


class Settings(Fold):
    """What a run needs besides its mesh: the section, and whose brain the mesh is."""

    gestational_age: float
    """Of the mesh, weeks; growth is relative to it."""
    hemisphere: Literal["L", "R"] | None = None
    """Half a brain, which the medial plane confines; null: a whole one."""
