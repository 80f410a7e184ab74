"""`fold` and its result, and `growth`, which a fold may use."""

from __future__ import annotations

import html
import logging
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.api.given import SurfaceLike, cortex, require_hemisphere, surface
from cortet.api.meshing import Mesh, image, say, tetrahedra
from cortet.config import load
from cortet.errors import InputError, UsageError
from cortet.formats.ownership import may_write
from cortet.geometry.limits import FOLD_AGES, require_within
from cortet.meshes import TetMesh, region_names
from cortet.solver_files.meshed import why_uncertified

if TYPE_CHECKING:
    import pandas as pd

    from cortet.config.fold import Fold
    from cortet.folding import surface_growth
    from cortet.solver_files.surface_map import SurfaceMap

__all__ = ["Folded", "fold", "growth"]

logger = logging.getLogger(__name__)


def growth(
    early: SurfaceLike,
    later: SurfaceLike,
    ages: tuple[float, float],
    *,
    spheres: tuple[SurfaceLike, SurfaceLike] | None = None,
    smooth: float | None = None,
) -> tuple[dict[str, NDArray[Any]], surface_growth.Growth]:
    """How much each spot of a surface has grown by a later age.

    Parameters
    ----------
    early, later : of the same cortex, anything that `mesh` takes
    ages : gestational ages of the two, weeks
    spheres : registered spheres of the two, through which their vertices correspond; None: by their numbers
    smooth : full width at half maximum of the smoothing along the surface, mm; None: as much as noise requires

    Returns
    -------
    fields for `mesh`, with which a mesh of `early` grows when it is folded; and the measured growth

    Raises
    ------
    InputError : the vertices do not correspond, or the second age is not later

    Examples
    --------
    >>> early, later = (cortet.phantom(age, subdivisions=3) for age in (28, 30))
    >>> fields, found = cortet.growth(early, later, (28, 30))
    >>> list(fields)
    ['growth_to_30']
    """
    from cortet.folding.surface_growth import measured, through_spheres
    from cortet.solver_files.names import growth_field
    from cortet.stages.gate import require_size

    if len(ages) != 2 or not ages[0] < ages[1]:
        raise UsageError(f"{', '.join(map(str, ages))} are not an early and a later age", remedy="give two, rising")
    first, last = cortex(early), cortex(later)
    if spheres:
        last = through_spheres(last, surface(spheres[1]), surface(spheres[0]))
    for one, given in ((first, early), (last, later)):
        file = given if isinstance(given, str | Path) else None
        require_size(one, file=file, option="give both surfaces in mm")
    found = measured(first, last, smooth)
    return {growth_field(ages[1]): found.tensors}, found


@dataclass(frozen=True, eq=False)
class Folded:
    """A fold: how it ended, its table, and the folder that holds its frames."""

    #: as `verdict.json`
    verdict: dict[str, Any]
    #: a row per `record_interval`, as `fold.tsv`
    table: pd.DataFrame
    folder: Path
    hemi: Literal["L", "R"] | None
    #: week of `fold.surfaces` -> files of the folded cortex, as `folding.measures.surface_files`
    surfaces: Mapping[float, Mapping[str, Path]] = field(default_factory=dict)
    #: if the user named no folder: removes it once the fold is no longer used
    _keeper: Any = field(default=None, repr=False)

    def at(self, ga: float) -> TetMesh:
        """The mesh of the frame nearest to an age, weeks."""
        from cortet.folding.journal import SERIES, series
        from cortet.formats import vtu

        frames = series(self.folder / SERIES)
        return vtu.read(min(frames, key=lambda frame: abs(frame[1] - ga))[0])

    def plot(self) -> NDArray[np.uint8]:
        """The surface at the end, seen from its side: (height, width, 3)."""
        from cortet.folding.fold_figures import views
        from cortet.folding.journal import SERIES, series

        return next(views([series(self.folder / SERIES)[-1][0]], self.hemi))

    def __repr__(self) -> str:
        return (
            f"<Folded: {self.verdict['reason']}\n"
            f" gyrification index {self.verdict['gyrification_index_last']:.3f},"
            f" {self.verdict['distorted_share']:.1%} of the tetrahedra distorted\n"
            f" {self.folder}>"
        )

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.verdict['reason'])}</p>{image(self.plot())}"


def fold(
    made: TetMesh | Mesh | str | Path,
    ga: float | None = None,
    hemi: Literal["L", "R"] | None = None,
    *,
    folder: str | Path | None = None,
    progress: bool | Callable[..., None] = True,
    **settings: Any,
) -> Folded:
    """Grow and fold a mesh.

    Parameters
    ----------
    made : a mesh, or its file
    ga : gestational age of the mesh, weeks; None: the age given when it was made, which the sidecar of a file records
    hemi : "L" or "R" for half a brain; None: that of the mesh, or of its sidecar
    folder : gets table and frames, and a run that was killed continues there; None: one that is deleted with the result
    settings : keys of the section `fold`: end, thickness, model, ...; `surfaces` of a mesh in memory adds frames alone

    Returns
    -------
    how it ended, its table, and its frames

    Raises
    ------
    InputError : the age is unknown, the mesh was made for another age or hemisphere, or it cannot be folded

    Examples
    --------
    >>> folded = cortet.fold("x.vtu", end=28.1, force=True, progress=False)  # its cells are coarse
    >>> folded.verdict["outcome"]
    'folded'
    """
    import pandas as pd

    from cortet.config.fold import Settings
    from cortet.folding.fold import SAME_AGE
    from cortet.folding.fold import fold as folded
    from cortet.folding.folded_surface import write_surfaces
    from cortet.folding.journal import TABLE, per_percent
    from cortet.folding.plausible import brain_of, refuse_space_around, require_same_brain
    from cortet.formats.tsv import read_tsv
    from cortet.geometry.kernel_cache import require_threads

    require_threads()
    require_hemisphere(hemi)
    if ga is not None:
        require_within(ga, FOLD_AGES, "the gestational age in weeks")
    mesh = tetrahedra(made)
    why: Sequence[str] = ()
    if isinstance(made, Mesh):
        refuse_space_around(region_names(made.surface.inner))
        require_same_brain((ga, hemi), (made.ga, made.hemi))
        ga, hemi, why = made.ga if ga is None else ga, hemi or made.hemi, made.certificate.reasons
    elif isinstance(made, str | Path):
        ga, hemi = brain_of(Path(made), ga, hemi)
        why = why_uncertified(Path(made))
    if why:
        logger.warning("the mesh that is folded is not certified: %s", "; ".join(why))
    chosen = load({"fold": settings}).fold
    if ga is None:
        raise InputError("the gestational age of the mesh is not known", remedy="give ga (--ga), in weeks")
    keeper = tempfile.TemporaryDirectory(prefix="cortet-fold-") if folder is None else None
    target = Path(keeper.name if keeper else folder or "")
    if target.exists() and not target.is_dir():
        raise InputError("is a file", file=target, remedy="give the name of a folder")
    # a mesh in memory has no file of its native surface: its frames at these weeks are all that is written
    home = _home(Path(made), mesh, target, chosen, ga) if chosen.surfaces and isinstance(made, str | Path) else None
    values = {**chosen.values(), "gestational_age": ga, "hemisphere": hemi}
    speak = progress if callable(progress) else per_percent(say)
    regions = (*values["core_regions"], *values["region_stiffness"], *values["region_relaxation"])
    if isinstance(made, Mesh) and any(isinstance(region, str) for region in regions):
        mesh = made.named()
    told = (speak, say) if progress else ()
    verdict = folded(mesh, target, Settings(**values), *told)
    table = read_tsv(target / TABLE).apply(pd.to_numeric, errors="coerce")
    written: dict[float, dict[str, Path]] = {}
    if home is not None:
        found, like, weeks = home
        written = {week: files for week, files in weeks.items() if week <= verdict.gestational_age + SAME_AGE}
        for week, files in written.items():
            write_surfaces(target, week, found, files, like=like, hemi=hemi)
    return Folded(asdict(verdict), table, target, hemi, written, keeper)


def _home(
    made: Path, mesh: TetMesh, folder: Path, settings: Fold, ga: float
) -> tuple[SurfaceMap, Path, dict[float, dict[str, Path]]]:
    """The map from a mesh to its native surface, the file of that, and week -> files of the folded surface."""
    from cortet.folding.measures import surface_files, weeks_of
    from cortet.formats.gifti import kind_of
    from cortet.solver_files.surface_map import map_of_file

    weeks = weeks_of(settings.surfaces, ga, settings.end)
    if missed := sorted({*settings.surfaces} - {*weeks}):
        raise InputError(
            f"the fold goes from {ga:g} to {settings.end:g} weeks, not to {missed[0]:g}",
            file=made,
            remedy="name weeks between them in fold.surfaces, or another fold.end",
        )
    found, like, _ = map_of_file(made, mesh)
    files = {week: surface_files(folder, made.stem, week, kind_of(like)) for week in weeks}
    for path in [path for some in files.values() for path in some.values()]:
        may_write(path)  # before the work
    return found, like, files
