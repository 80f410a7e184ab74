"""`mesh` and its result."""

from __future__ import annotations

import html
import sys
from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.api.given import Settings, SurfaceLike, require_fields, require_hemisphere, require_named, surface
from cortet.config import Config, load, read
from cortet.errors import InputError
from cortet.formats import format_of
from cortet.formats.gifti import hemisphere_of, kind_of
from cortet.formats.ownership import guarded
from cortet.formats.placement import placed
from cortet.formats.tables import names
from cortet.formats.tags import regions
from cortet.formats.volumes import Volume
from cortet.geometry.limits import SHELL_MM, require_within
from cortet.geometry.nesting import nested
from cortet.measure.certify import Certificate, with_remarks
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface, by_region, require_measurable
from cortet.pipeline import Meshed, Step, mesh_surface, save, with_sets
from cortet.solver_files.earlier import read_today
from cortet.solver_files.label_surfaces import inner_surfaces, with_shell
from cortet.solver_files.meshed import Origin
from cortet.solver_files.volumes import (
    TISSUE_COLUMNS,
    backgrounds,
    label_names,
    read_volumes,
    require_in_place,
    with_volumes,
)

if TYPE_CHECKING:
    import pandas as pd
    import pyvista
    from nibabel.spatialimages import SpatialImage

#: width and height of the picture in a notebook, pixels
_PICTURE = (640, 480)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh with its certificate and the surface that was meshed."""

    mesh: TetMesh
    certificate: Certificate
    #: the surface that was meshed: the given one, repaired and smoothed
    surface: TriSurface
    #: gestational age, weeks, and hemisphere, if known
    ga: float | None = None
    hemi: Literal["L", "R"] | None = None
    config: Config = field(default_factory=Config)
    #: files that it was made from; they are never overwritten
    inputs: tuple[Path, ...] = ()
    #: region -> file of the surface that was given, and name -> file of its volumes, as far as they come from files
    given: Mapping[str, str | Path] = field(default_factory=dict)
    volumes: Mapping[str, str] = field(default_factory=dict)
    #: a row for each label of each volume, as `solver_files.volumes.TISSUE_COLUMNS`
    tissue_rows: tuple[Mapping[str, Any], ...] = ()
    #: volume -> label -> name
    label_names: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    #: which surface was given, if its file says: a mesh of a white one has no cortex
    kind: Literal["white", "pial"] | None = None

    @property
    def origin(self) -> Origin:
        """Where the mesh comes from, as far as it is known."""
        return Origin(self.given, volumes=self.volumes, age=self.ga, hemisphere=self.hemi, kind=self.kind)

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
        """The part of the mesh with each label of its volumes: tetrahedra, mL, worst q, mean share inside."""
        import pandas as pd

        return pd.DataFrame(list(self.tissue_rows), columns=names(TISSUE_COLUMNS))

    @property
    def regions(self) -> dict[str, int]:
        """Name -> number of each region, from the outside in, as files have them; without inner surfaces by depth."""
        return regions(self.named())

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
        """A picture of the mesh, cut open, with the rest transparent: (height, width, 4); needs no display."""
        from cortet.report.render import cut_view

        return cut_view(self.mesh, regions=bool(self.surface.inner), size=size)

    def named(self) -> TetMesh:
        """The mesh with its named sets and the numbers of its regions, as files hold it."""
        export = self.config.export
        sets = {"sets": export.sets(self.kind), "labels": self.label_names, "units": export.field_units}
        return with_sets(self.mesh, self.surface, self.origin, **sets)[0]

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the mesh in the format that the file's ending names, verified, with its companions.

        They are the sidecar, the certificate, the surface that was meshed, and a table of the labels of volumes.

        Parameters
        ----------
        force : also write a mesh that is not certified, and over a file that cortet did not make. A file that was given
            by its name is never overwritten; NiBabel's images of surfaces do not know theirs

        Raises
        ------
        InputError : the mesh is not certified, or the file exists and cortet did not make it
        """
        path = Path(path)
        format_of(path)
        if not self.certified and not force:
            raise InputError(
                f"is not written, as the mesh is not certified: {'; '.join(self.certificate.reasons)}",
                file=path,
                remedy="give force=True to write it anyway",
            )
        try:
            with guarded(self.inputs, files=[path], force=force):
                save(
                    Meshed(self.mesh, self.certificate, self.surface),
                    path,
                    self.config,
                    self.origin,
                    kind=self.kind,
                    labels=self.label_names,
                    rows=self.tissue_rows,
                    force=force,
                    uncertified=force,
                )
        except OSError as error:
            what, remedy = (
                f"cannot be written: {error.strerror or error}",
                "give a folder with space that you may write to",
            )
            raise InputError(what, file=path, remedy=remedy) from error
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
        return f"<p>{html.escape(repr(self)[1:-1])}</p>{image(self.plot(_PICTURE))}<table>{rows}</table>"


def mesh(
    shape: SurfaceLike,
    cell_size: float | None = None,
    *,
    ga: float | None = None,
    hemi: Literal["L", "R"] | None = None,
    inner: Mapping[str, SurfaceLike] | None = None,
    shell: float | None = None,
    fields: Mapping[str, Any] | None = None,
    volumes: Mapping[str, str | Path | SpatialImage | Volume] | None = None,
    settings: Settings | None = None,
    progress: bool | Callable[[Step], None] = True,
) -> Mesh:
    """Mesh the inside of a closed surface.

    Parameters
    ----------
    cell_size : edge length of the tetrahedra, mm; None: that of the settings
    ga : gestational age, weeks
    hemi : "L" or "R"; None: what the file says, if anything
    inner : closed surfaces inside, name of the region within -> surface, or labels of a volume: "dseg.nii.gz:5,6"
    shell : mm, from the surface to a smooth one around it; the space between is meshed as the region `csf`
    fields : values per vertex (n,) or (n, k) by name, which the mesh also gets
    volumes : images whose labels, numbers or tensors the tetrahedra get, by name: NIfTI or MGZ, or NiBabel's images
    settings : a configuration file, or its keys by section: {"repair": {"enabled": True}}
    progress : False: silent; a function: called after every stage

    Raises
    ------
    InputError : the surface cannot be meshed, a volume does not contain it, or a setting is impossible
    """
    data = dict(settings) if isinstance(settings, Mapping) else read(Path(settings)) if settings is not None else {}
    if cell_size is not None:
        data["generate"] = {**(data.get("generate") or {}), "cell_size": cell_size}
    config, outer, source = load(data), surface(shape), shape if isinstance(shape, str | Path) else None
    require_measurable(outer)
    require_hemisphere(hemi)
    for given, what in ((inner, "inner surfaces"), (fields, "fields"), (volumes, "volumes")):
        require_named(given, what)
    of_vertices = {**outer.point_data, **(fields or {})}
    require_fields(of_vertices)
    outer = replace(outer, point_data=of_vertices)
    from_files = {name: str(one) for name, one in (inner or {}).items() if isinstance(one, str | Path)}
    within = inner_surfaces(from_files, outer, config.placement(), handles=config.handles())
    others = {name: surface(one) for name, one in (inner or {}).items() if name not in from_files}
    images = read_volumes(volumes or {})
    in_mm = placed(outer, config.placement())
    require_in_place(images, in_mm)
    background = backgrounds(images, in_mm)
    for one in background if progress is True else ():
        say(one.sentence)
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
    large = [one.sentence for one in background if one.large]
    made = made._replace(certificate=with_remarks(made.certificate, large))
    shares = config.export.label_shares
    filled, rows = with_volumes(made.mesh, images, frame=in_mm.frame, shares=shares, background=background)
    read_from = (source, *within.files.values(), *(volume.file for volume in images.values()))
    files = tuple(Path(file) for file in read_from if file)
    side = hemi or (hemisphere_of(source) if source else None)
    kind = kind_of(source) if source else None
    named = {name: str(file) for name, file in (volumes or {}).items() if isinstance(file, str | Path)}
    return Mesh(
        filled,
        *made[1:],
        ga,
        side,
        config,
        inputs=files,
        given=_given(source, within.files, made.surface, shelled=shell is not None),
        volumes=named,
        tissue_rows=tuple(rows),
        label_names=label_names(images),
        kind=kind,
    )


def _given(
    source: str | Path | None, inner: Mapping[str, str], meshed: TriSurface, *, shelled: bool
) -> dict[str, str | Path]:
    """Region -> file of the surface that was given; none where the outer one is no file."""
    if source is None:
        return {}
    if shelled:
        (brain,) = meshed.inner.keys() - inner.keys()
        return {brain: source, **inner}
    return by_region(source, {name: inner[name] for name in meshed.inner if name in inner})


def _told(step: Step) -> None:
    say(f"{step.stage}: {step.seconds:.1f} s")


def say(line: str) -> None:
    """Print a line where a terminal or a notebook shows it apart from results."""
    sys.stderr.write(f"{line}\n")


def tetrahedra(made: TetMesh | Mesh | str | Path) -> TetMesh:
    """The tetrahedral mesh from any object that holds one.

    Raises
    ------
    InputError : a file holds no mesh, or the object is of an unknown kind
    """
    if isinstance(made, str | Path):
        mesh, told = read_today(Path(made))
        for line in told:
            say(line)
        return mesh
    if isinstance(made, Mesh | TetMesh):
        return made.mesh if isinstance(made, Mesh) else made
    raise InputError(f"a {type(made).__name__} is no mesh", remedy="give a file, or what `cortet.mesh` returns")


def image(pixels: NDArray[np.uint8]) -> str:
    """A picture as an HTML element."""
    from cortet.report.render import webp

    return f'<img src="data:image/webp;base64,{b64encode(webp(pixels)).decode()}" alt="">'
