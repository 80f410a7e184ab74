"""cortet in a few calls: `mesh`, `fold`, `growth`, `certify`, `repair`, `compare`, from files or arrays to results.

Surfaces may be files, NiBabel images, meshes of PyVista or trimesh, or pairs of arrays. Nothing is written unless a
result is saved. The command line and the workflow do the same with files.
"""

from __future__ import annotations

import html
import re
import sys
import tempfile
from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.config import Config, load, read
from cortet.errors import InputError
from cortet.formats import format_of, read_mesh
from cortet.formats.gifti import hemisphere_of, read_surface, surface_of
from cortet.formats.ownership import guarded
from cortet.formats.placement import placed
from cortet.formats.tables import names
from cortet.formats.volumes import Volume
from cortet.geometry.limits import SHELL_MM, require_within
from cortet.geometry.nesting import nested
from cortet.measure.certify import Certificate
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface, region_names, require_measurable
from cortet.pipeline import Meshed, Step, mesh_surface
from cortet.solver_files.export import export
from cortet.solver_files.label_surfaces import inner_surfaces, with_shell
from cortet.solver_files.sets import named_sets
from cortet.solver_files.volumes import (
    TISSUE_COLUMNS,
    label_names,
    read_volumes,
    require_in_place,
    with_volumes,
)

if TYPE_CHECKING:
    import pandas as pd
    import pyvista

    from cortet.measure.surface_growth import Growth

#: a file of any format that is read, `TriSurface`, NiBabel's `GiftiImage`, PyVista's `PolyData`, trimesh's `Trimesh`,
#: or vertices (n, 3) in mm and faces (m, 3)
SurfaceLike = Any
#: a file, or keys of the configuration by section
Settings = str | Path | Mapping[str, Any]

#: width and height of the picture in a notebook, pixels
_PICTURE = (640, 480)


def surface(shape: SurfaceLike) -> TriSurface:
    """A surface from whatever holds one.

    Raises
    ------
    InputError : it holds no triangles, or is of no kind that is known
    """
    if isinstance(shape, TriSurface):
        return shape
    if isinstance(shape, str | Path):
        return read_surface(shape)
    if hasattr(shape, "agg_data") and hasattr(shape, "darrays"):  # nibabel.gifti.GiftiImage
        return surface_of(shape)
    if hasattr(shape, "regular_faces"):  # pyvista.PolyData
        if not shape.is_all_triangles:
            raise InputError("the PolyData has faces that are no triangles", remedy="call its triangulate() before")
        return TriSurface(shape.points, shape.regular_faces, dict(shape.point_data))
    if hasattr(shape, "vertices") and hasattr(shape, "faces"):  # trimesh.Trimesh
        return TriSurface(shape.vertices, shape.faces)
    if isinstance(shape, tuple | list) and len(shape) == 2:
        return TriSurface(shape[0], shape[1])
    raise InputError(
        f"a {type(shape).__name__} is no surface",
        remedy="give a file, a NiBabel image, a mesh of PyVista or trimesh, or vertices and faces",
    )


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh with its certificate and the surface that was meshed."""

    mesh: TetMesh
    certificate: Certificate
    #: that was meshed: the one given, mended and smoothed
    surface: TriSurface
    #: gestational age, weeks, and hemisphere, where they are known
    ga: float | None = None
    hemi: Literal["L", "R"] | None = None
    config: Config = field(default_factory=Config)
    #: files that it was made from, which nothing is written to
    inputs: tuple[Path, ...] = ()
    #: a row for each label of each volume, as `solver_files.volumes.TISSUE_COLUMNS`
    tissue_rows: tuple[Mapping[str, Any], ...] = ()
    #: volume -> label -> name
    label_names: Mapping[str, Mapping[int, str]] = field(default_factory=dict)

    @property
    def points(self) -> FloatArray:
        """Nodes: (n, 3) mm."""
        return self.mesh.points

    @property
    def cells(self) -> IntArray:
        """Tetrahedra: (m, 4)."""
        return self.mesh.cells

    @property
    def certified(self) -> bool:
        """Whether the mesh passed every check."""
        return self.certificate.certified

    @property
    def quality(self) -> FloatArray:
        """q of each tetrahedron, 0 for the regular one: (m,)."""
        from cortet.measure.quality import quality

        return quality(self.points, self.cells)

    def checks(self) -> pd.DataFrame:
        """The checks of the certificate: name, whether passed, finding."""
        import pandas as pd

        return pd.DataFrame([asdict(check) for check in self.certificate.checks])

    def tissues(self) -> pd.DataFrame:
        """What of the mesh has each label of its volumes: tetrahedra, mL, worst q, mean share inside."""
        import pandas as pd

        return pd.DataFrame(list(self.tissue_rows), columns=names(TISSUE_COLUMNS))

    def to_pyvista(self) -> pyvista.UnstructuredGrid:
        """The mesh for PyVista, with its fields and the quality q of each tetrahedron."""
        import pyvista

        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: self.cells}, self.points)
        for name, values in self.mesh.point_data.items():
            grid.point_data[name] = values
        for name, values in (*self.mesh.cell_data.items(), ("q", self.quality)):
            grid.cell_data[name] = values
        return grid

    def plot(self, size: tuple[int, int] = (1200, 900)) -> NDArray[np.uint8]:
        """A picture of the mesh, cut open, transparent around it: (height, width, 4), drawn without a display."""
        from cortet.report.render import cut_view

        return cut_view(self.mesh, regions=bool(self.surface.inner), size=size)

    def named(self) -> TetMesh:
        """The mesh with its named sets, as files hold it; they take the place of the numbers of regions."""
        return named_sets(
            self.mesh,
            **self.config.export.sets,
            inner=list(self.surface.inner),
            label_names=self.label_names,
            tissues=self.label_names,
        )

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the mesh in the format of the file's ending, verified, with its sidecar.

        Parameters
        ----------
        force : write also a mesh that is not certified, and over a file that cortet did not make

        Raises
        ------
        InputError : the mesh is not certified, or a file stands there that cortet did not make
        """
        path = Path(path)
        solver = format_of(path).name
        if not self.certified and not force:
            raise InputError(
                f"is not written, as the mesh is not certified: {'; '.join(self.certificate.reasons)}",
                file=path,
                remedy="give force=True to write it anyway",
            )
        with guarded(self.inputs, files=[path], force=force):
            export(
                self.named(),
                path,
                solver=solver,
                certificate=asdict(self.certificate),
                unit=self.config.export.carp_unit,
                frame=self.surface.frame,
                interior=self.config.transfer.interior,
                holes=self.config.export.holes,
                uncertified=force,
            )
        return path

    def __repr__(self) -> str:
        verdict = "certified" if self.certified else f"NOT certified: {'; '.join(self.certificate.reasons)}"
        return f"<Mesh: {len(self.cells):,} tetrahedra, worst q {self.certificate.quality.q.max:.3f}, {verdict}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{'✓' if check.passed else '✗'}</td>"
            f'<td style="text-align: left">{html.escape(check.finding)}</td></tr>'
            for check in self.certificate.checks
        )
        return f"<p>{html.escape(repr(self)[1:-1])}</p>{_image(self.plot(_PICTURE))}<table>{rows}</table>"


def mesh(
    shape: SurfaceLike,
    cell_size: float | None = None,
    *,
    ga: float | None = None,
    hemi: Literal["L", "R"] | None = None,
    inner: Mapping[str, SurfaceLike] | None = None,
    shell: float | None = None,
    fields: Mapping[str, Any] | None = None,
    volumes: Mapping[str, str | Path | Volume] | None = None,
    settings: Settings | None = None,
    progress: bool | Callable[[Step], None] = True,
) -> Mesh:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    cell_size : edge length of the tetrahedra, mm; None: that of the settings
    ga : gestational age, weeks
    hemi : "L" or "R"; None: what the file says, if it does
    inner : closed surfaces inside, name of the region within -> surface, or labels of a volume: "dseg.nii.gz:5,6"
    shell : mm, from the surface to a smooth one around it; what is between is meshed as the region `csf`
    fields : values per vertex (n,) or (n, k) by name, which the mesh gets, too
    volumes : images whose labels, numbers or tensors the tetrahedra get, by name: NIfTI or MGZ
    settings : a configuration file, or its keys by section: {"repair": {"enabled": True}}
    progress : False is silent; a function is called after every stage

    Raises
    ------
    InputError : the surface cannot be meshed, a volume does not lie around it, or a setting is impossible
    """
    data = dict(settings) if isinstance(settings, Mapping) else read(Path(settings)) if settings is not None else {}
    if cell_size is not None:
        data["generate"] = {**(data.get("generate") or {}), "cell_size": cell_size}
    config, outer, source = load(data), surface(shape), shape if isinstance(shape, str | Path) else None
    require_measurable(outer)
    if hemi not in ("L", "R", None):
        raise InputError(f"{hemi!r} is no hemisphere", remedy='use "L", "R" or None')
    if not isinstance(inner, Mapping | None):
        raise InputError("the inner surfaces have no names", remedy='give them by name: {"white": surface}')
    _require_fields(fields or {})
    if fields:
        outer = replace(outer, point_data={**outer.point_data, **fields})
    from_files = {name: str(one) for name, one in (inner or {}).items() if isinstance(one, str | Path)}
    within = inner_surfaces(from_files, outer, config.placement(), handles=config.handles())
    others = {name: surface(one) for name, one in (inner or {}).items() if name not in from_files}
    images = read_volumes(volumes or {})
    in_mm = placed(outer, config.placement())
    require_in_place(images, in_mm)
    whole = nested(outer, {**within.surfaces, **others})
    if shell is not None:
        require_within(shell, SHELL_MM, "the distance of the shell in mm")
        whole = with_shell(whole, shell, config.placement())
    made: Meshed = mesh_surface(
        whole,
        config,
        gestational_age=ga,
        source=source,
        inner_sources=within.files,
        case=Path(source).name.partition(".")[0] if source else "",
        progress=progress if callable(progress) else _told if progress else lambda _: None,
    )
    filled, rows = with_volumes(made.mesh, images, frame=in_mm.frame, shares=config.export.label_shares)
    given = (source, *within.files.values(), *(image.file for image in images.values() if image.file))
    files = tuple(Path(file) for file in given if file is not None)
    side = hemi or (hemisphere_of(source) if source else None)
    return Mesh(filled, *made[1:], ga, side, config, files, tuple(rows), label_names(images))


def _require_fields(fields: Mapping[str, Any]) -> None:
    """Raise InputError for fields that no file could hold."""
    for name, values in fields.items():
        if not (isinstance(name, str) and re.fullmatch(r"\w[\w .-]*", name)):
            raise InputError(f"{name!r} is no name of a field", remedy="use letters, digits, _ and -")
        if (kind := np.asarray(values).dtype).kind not in "fiub":
            raise InputError(f"the field {name} holds values of type {kind}", remedy="give real numbers")


def _told(step: Step) -> None:
    _say(f"{step.stage}: {step.seconds:.1f} s")


def _say(line: str) -> None:
    """Put a line where a terminal and a notebook show it apart from results."""
    sys.stderr.write(f"{line}\n")


def growth(
    early: SurfaceLike,
    later: SurfaceLike,
    ages: tuple[float, float],
    *,
    spheres: tuple[SurfaceLike, SurfaceLike] | None = None,
    smooth: float | None = None,
) -> tuple[dict[str, NDArray[Any]], Growth]:
    """How much each spot of a surface has grown until a later age.

    Parameters
    ----------
    ages : gestational ages of the two, weeks
    spheres : registered spheres of the two, through which their vertices correspond; None: they do by their numbers
    smooth : full width at half maximum of the smoothing along the surface, mm; None: as much as noise asks for

    Returns
    -------
    fields for `mesh`, by which a mesh of `early` grows when it is folded; and what was measured

    Raises
    ------
    InputError : the vertices do not correspond, or the ages do not rise
    """
    from cortet.measure.surface_growth import measured, through_spheres
    from cortet.simulation.growth_map import field_of

    if not ages[0] < ages[1]:
        raise InputError(f"the later age, {ages[1]:g} weeks, is not after the early one", remedy="give both, rising")
    first, last = surface(early), surface(later)
    if spheres:
        last = through_spheres(last, surface(spheres[1]), surface(spheres[0]))
    found = measured(first, last, smooth)
    return {field_of(ages[1]): found.tensors}, found


def _tetrahedra(made: TetMesh | Mesh | str | Path) -> TetMesh:
    """The tetrahedral mesh of whatever holds one.

    Raises
    ------
    InputError : a file holds no mesh, or it is of no kind that is known
    """
    if isinstance(made, str | Path):
        return read_mesh(Path(made))
    if isinstance(made, Mesh | TetMesh):
        return made.mesh if isinstance(made, Mesh) else made
    raise InputError(f"a {type(made).__name__} is no mesh", remedy="give a file, or what `cortet.mesh` returns")


def certify(
    made: TetMesh | Mesh | str | Path,
    shape: SurfaceLike,
    cell_size: float | None = None,
    settings: Settings | None = None,
) -> Certificate:
    """Judge any tetrahedral mesh against the surface that it should fill.

    Parameters
    ----------
    cell_size : mm, by which distances are judged; None: taken from the mesh
    """
    from cortet.measure.certify import certify as judged

    config = load(settings if settings is not None else {})
    limits = config.arguments("certify", {"cell_size": cell_size})
    return judged(_tetrahedra(made), surface(shape), **limits)


def repair(shape: SurfaceLike, settings: Settings | None = None) -> tuple[TriSurface, dict[str, Any]]:
    """Mend a surface that is open, not manifold, turned inside out or crosses itself; also says what was done."""
    from cortet.stages.repair import repair as mended

    given = read_surface(shape, finite=False) if isinstance(shape, str | Path) else surface(shape)
    config = load(settings if settings is not None else {"repair": {"enabled": True}})
    result, report = mended(given, **config.arguments("repair", {"source": None, "inside": False}))
    return result, asdict(report)


def compare(
    meshes: Mapping[str, TetMesh | Mesh | str | Path], shape: SurfaceLike, cell_size: float | None = None
) -> pd.DataFrame:
    """The numbers of several meshes of one surface side by side: a row per number, a column per mesh."""
    import pandas as pd

    from cortet.report.comparison_page import comparison_rows

    if not isinstance(meshes, Mapping):
        raise InputError("the meshes have no names", remedy='give them by name: {"mine": mesh}')
    rows = comparison_rows({name: asdict(certify(one, shape, cell_size)) for name, one in meshes.items()})
    values = [[value for value, _ in row["values"]] for row in rows]
    return pd.DataFrame(values, index=[row["name"] for row in rows], columns=list(meshes))


@dataclass(frozen=True, eq=False)
class Folded:
    """A fold: how it ended, its table, and the folder that holds its frames."""

    #: as `verdict.json`
    verdict: dict[str, Any]
    #: a row per `record_interval`, as `fold.tsv`
    table: pd.DataFrame
    folder: Path
    hemi: Literal["L", "R"] | None
    #: removes the folder once nobody holds the fold any more, where the user named none
    _keeper: Any = field(default=None, repr=False)

    def at(self, ga: float) -> TetMesh:
        """The mesh of the frame nearest to an age, weeks."""
        from cortet.formats import vtu
        from cortet.report.fold_figures import series
        from cortet.simulation.journal import SERIES

        frames = series(self.folder / SERIES)
        return vtu.read(min(frames, key=lambda frame: abs(frame[1] - ga))[0])

    def plot(self) -> NDArray[np.uint8]:
        """The surface at the end, seen from its side: (height, width, 3)."""
        from cortet.report.fold_figures import series, views
        from cortet.simulation.journal import SERIES

        return next(views([series(self.folder / SERIES)[-1][0]], self.hemi))

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.verdict['reason'])}</p>{_image(self.plot())}"


def fold(
    made: TetMesh | Mesh,
    ga: float | None = None,
    hemi: Literal["L", "R"] | None = None,
    *,
    folder: str | Path | None = None,
    progress: bool | Callable[..., None] = True,
    **settings: Any,
) -> Folded:
    """Let a mesh grow and fold.

    Parameters
    ----------
    ga : gestational age of the mesh, weeks; None: that with which it was made
    hemi : "L" or "R" for half a brain; None: that of the mesh
    folder : gets table and frames, and a run that was killed goes on there; None: a folder that goes with the result
    settings : keys of the section `fold`: end, thickness, model, ...

    Raises
    ------
    InputError : the age is not known, or the mesh cannot be folded
    """
    import pandas as pd

    from cortet.formats.tsv import read_tsv
    from cortet.simulation.fold import fold as folded
    from cortet.simulation.journal import TABLE, per_percent
    from cortet.simulation.plausible import refuse_shell
    from cortet.simulation.state import Settings as FoldSettings

    if isinstance(made, Mesh):
        refuse_shell(region_names(made.surface.inner))
        ga, hemi = made.ga if ga is None else ga, hemi or made.hemi
    if ga is None:
        raise InputError("the gestational age of the mesh is not known", remedy="give ga, in weeks")
    keeper = tempfile.TemporaryDirectory(prefix="cortet-fold-") if folder is None else None
    place = Path(keeper.name if keeper else folder or "")
    values = load({"fold": settings}).arguments("fold", {"gestational_age": ga, "hemisphere": hemi})
    speak = progress if callable(progress) else per_percent(_say)
    mesh = made if isinstance(made, TetMesh) else made.mesh
    regions = (*values["core_regions"], *values["region_stiffness"])
    if isinstance(made, Mesh) and any(isinstance(region, str) for region in regions):
        mesh = made.named()
    verdict = folded(mesh, place, FoldSettings(**values), speak if progress else None)
    table = read_tsv(place / TABLE).apply(pd.to_numeric, errors="coerce")
    return Folded(asdict(verdict), table, place, hemi, keeper)


def _image(pixels: NDArray[np.uint8]) -> str:
    """A picture as an element of a page."""
    from cortet.report.render import webp

    return f'<img src="data:image/webp;base64,{b64encode(webp(pixels)).decode()}" alt="">'
