"""`certify` and `repair`: check meshes, repair surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cortet.api.files import NO_FILES, filling, known_electrodes, known_repair, known_size
from cortet.api.given import Settings, SurfaceLike, cortex, sections
from cortet.api.meshing import Mesh
from cortet.config import load
from cortet.formats.placement import placed
from cortet.measure.certify import Certificate, with_contacts
from cortet.measure.certify import certify as checked
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.sidecar import read_sidecar
from cortet.stages.gate import require_size
from cortet.stages.repair import repair as mended
from cortet.stages.separate import separate


def certify(
    made: TetMesh | Mesh | str | Path,
    shape: SurfaceLike | None = None,
    cell_size: float | None = None,
    settings: Settings | None = None,
    *,
    inner: Mapping[str, str | Path] = NO_FILES,
) -> Certificate:
    """Check any tetrahedral mesh against the surface that it should fill.

    Parameters
    ----------
    made : a file, what `mesh` or `read` returns, or a `TetMesh`; coordinates in mm
    shape : closed surface, mm, as `mesh` takes it; None: the one that was meshed, as far as that is known. It is also
        taken in place of the file from which a mesh with a sidecar was made
    cell_size : mm, the scale of limits on distances; None: the one that the mesh was made with, if that is known: of
        what `cortet.mesh` returns, and of a file with its certificate beside it. Else distances are reported, and
        have no limit
    inner : region -> file of a closed surface inside `shape`
    settings : a configuration file, or its keys by section: {"certify": {"q_max": 0.5}}

    Returns
    -------
    `checks`, each a number beside its limit, and what follows from them: `certified`, `reasons`

    Examples
    --------
    >>> found = cortet.certify("x.vtu", "x.meshed.surf.gii")
    >>> found.certified, found.reasons
    (True, ())
    """
    config = load(sections(settings))
    mesh, filled, source = filling(made, shape, config, inner)
    if filled.inner and cell_size is not None and source is not None and str(source) == str(shape):
        filled, _report = separate(filled, cell_size=cell_size)  # not as it was meshed: move surfaces apart as then
    size = known_size(made) if cell_size is None else cell_size
    found = checked(
        mesh,
        filled,
        config.certify,
        cell_size=size,
        case=Path(made).stem if isinstance(made, str | Path) else "",
        source=source,
        parameters={"certify": {**config.certify.values(), "cell_size": size}},
        reports=known_repair(made, source),
        layers=_layers_of(made),
    )
    return with_contacts(found, mesh, known_electrodes(made, mesh))


def _layers_of(made: TetMesh | Mesh | str | Path) -> Sequence[float] | None:
    """The layers that a mesh was made with, as far as that is known."""
    if isinstance(made, str | Path):
        return (read_sidecar(Path(made)).get("made_from") or {}).get("layers")
    return None if isinstance(made, TetMesh) else made.config.export.layers


def repair(shape: SurfaceLike, settings: Settings | None = None) -> tuple[TriSurface, dict[str, Any]]:
    """Repair a surface that is open, not manifold, turned inside out or crosses itself.

    Parameters
    ----------
    shape : surface, mm unless `gate.unit` says otherwise, as `mesh` takes it; coordinates in a file may be non-finite
    settings : a configuration file, or its keys by section: {"repair": {"max_hole": 50.0}}

    Returns
    -------
    the repaired surface, vertices (n, 3) mm and faces (m, 3); and what was done, by the keys of `RepairReport`

    Raises
    ------
    CortetError : there is not one right answer, or a setting is impossible

    Examples
    --------
    >>> sound = cortet.surface("x.surf.gii")
    >>> closed, done = cortet.repair((sound.points, sound.faces[1:]))
    >>> len(closed.faces) == len(sound.faces)
    True
    """
    given = cortex(shape, finite=False)
    config = load(settings if settings is not None else {"repair": {"enabled": True}})
    to_mm = config.placement()
    source = str(shape) if isinstance(shape, str | Path) else None
    result, report = mended(placed(given, to_mm), config.repair, source=source, allow_genus=config.gate.allow_genus)
    require_size(result, file=source, to_mm=to_mm or 1.0, stated=to_mm is not None)
    return result, asdict(report)
