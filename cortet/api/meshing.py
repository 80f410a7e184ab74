"""`mesh` and its result."""

from __future__ import annotations

import html
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from dataclasses import fields as fields_of
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cortet.api.delivery import Made, deliver, file_of
from cortet.api.given import (
    Settings,
    SurfaceLike,
    brought,
    cortex,
    depths_of,
    require_hemisphere,
    require_region_names,
    sections,
    surface,
    values_of,
)
from cortet.config import load
from cortet.errors import InputError
from cortet.formats import format_of, read_mesh
from cortet.formats.electrodes import contacts_of
from cortet.formats.gifti import hemisphere_of, kind_of
from cortet.formats.ownership import guarded
from cortet.formats.placement import placed
from cortet.formats.set_arrays import with_sets
from cortet.formats.tables import names
from cortet.formats.tags import regions
from cortet.formats.volumes import TISSUE_COLUMNS, Volume
from cortet.geometry.interpolation import applied
from cortet.geometry.kernel_cache import require_threads
from cortet.geometry.limits import CELL_SIZE_MM, SCAN_AGES, require_within
from cortet.geometry.nesting import nested, sheets
from cortet.measure.certify import with_contacts, with_remarks
from cortet.measure.electrodes import ElectrodeRecord, around_contacts, with_electrodes
from cortet.measure.layers import require_layers
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface, by_region, region_names, require_measurable
from cortet.pipeline import Step, mesh_surface
from cortet.solver_files.export import with_sets as with_named_sets
from cortet.solver_files.fields import require_finite, with_fields, with_q, without_q
from cortet.solver_files.laminar import Laminar
from cortet.solver_files.meshed import (
    Origin,
    refuse_uncertified_name,
)
from cortet.solver_files.sidecar import CHANGED, changed_since
from cortet.solver_files.surface_map import SurfaceMap, surface_map
from cortet.solver_files.volumes import backgrounds, label_names, read_volumes, with_volumes
from cortet.stages.stage import About, State

if TYPE_CHECKING:
    import pandas as pd
    import pyvista
    from nibabel import spatialimages

#: width and height of the picture in a notebook, pixels
_PICTURE = (640, 480)


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Made):
    """A mesh with its certificate and the surface that was meshed."""

    @property
    def ga(self) -> float | None:
        """Gestational age, weeks, if it is known."""
        return self.origin.age

    @property
    def hemi(self) -> Literal["L", "R"] | None:
        """Hemisphere, if it is known."""
        return self.origin.hemisphere

    @property
    def points(self) -> FloatArray:
        """Nodes: (n, 3) mm."""
        return self.mesh.points

    @property
    def cells(self) -> IntArray:
        """Tetrahedra: (m, 4)."""
        return self.mesh.cells

    @property
    def volume(self) -> float:
        """Volume, mm³."""
        return float(signed_volumes(self.points, self.cells).sum())

    @property
    def certified(self) -> bool:
        """Whether the mesh passed every check."""
        return self.certificate.certified

    @property
    def quality(self) -> FloatArray:
        """q of each tetrahedron, 0 for the regular one: (m,)."""
        return quality(self.points, self.cells)

    def to_surface(
        self, values: ArrayLike, *, depth: float | tuple[float, float] | None = None, region: str | None = None
    ) -> NDArray[Any]:
        """Values of the mesh at the vertices of the surface that was given: (v,) or (v, k).

        A vertex gets the value at the nearest point of the boundary, where the vertex went as the surface was smoothed.
        Numbers are interpolated; of integers, which are labels, the one with the most weight is taken.

        Parameters
        ----------
        values : (n,) or (n, k) of nodes, or (m,) or (m, k) of tetrahedra, which are averaged around the corners of the
            tetrahedron that holds the point, within its region; masked numbers are NaN
        depth : mm below each vertex, along the inward normal of the meshed surface, or the ends of a range, whose mean
            is taken; NaN for a vertex with no such point in the mesh
        region : inside which surface, by name; None: the outermost one that was given
        """
        found = self.surface_map(region)
        return brought(values, lambda given: found.on_surface(given, depth))

    def laminar_profile(
        self, values: ArrayLike, depths: Sequence[float], *, equivolumetric: bool = True, region: str | None = None
    ) -> NDArray[Any]:
        """Values of the mesh at depths of the cortex below the vertices of a given surface: (v, d) or (v, d, k).

        Points lie along columns of the cortex, which lead from the pial to the white surface. The mesh has an inner
        surface `white`, and at least two elements across the cortex for depths to mean something.

        Parameters
        ----------
        values : of nodes or tetrahedra, as in `to_surface`
        depths : (d,), each from 0, the pial, to 1, the white surface
        equivolumetric : whether a depth is a share of the volume of a column, or of its length
        region : inside which surface, as in `to_surface`; its vertices, those of `white` for example

        Returns
        -------
        NaN for a vertex without a column, as in the medial wall

        Examples
        --------
        >>> profile = head.laminar_profile(field, [0.1, 0.3, 0.5, 0.7, 0.9])
        """
        laminar = Laminar(self.surface_map(region), self.surface.inner, equivolumetric=equivolumetric)
        every = [laminar.weights(depth) for depth in depths_of(depths)]
        return brought(values, lambda given: np.stack([one.of(given) for one in every], axis=1))

    def laminar_surfaces(
        self, depths: Sequence[float], *, equivolumetric: bool = True, region: str | None = "white"
    ) -> list[TriSurface]:
        """The surfaces at depths of the cortex, with the vertices and triangles of a surface that was given.

        A vertex without a column, as in the medial wall, stays where it is on the meshed surface.

        Parameters
        ----------
        depths, equivolumetric : as in `laminar_profile`
        region : inside the surface whose vertices are moved along the columns
        """
        found = self.surface_map(region)
        laminar = Laminar(found, self.surface.inner, equivolumetric=equivolumetric)
        native, every = replace(found.native, point_data={}), map(laminar.points, depths_of(depths))
        return [replace(native, points=np.where(np.isfinite(points), points, found.points)) for points in every]

    def from_surface(self, values: ArrayLike, *, region: str | None = None) -> NDArray[Any]:
        """Values of the given surface, (v,) or (v, k), at the nodes: (n,) or (n, k), NaN inside.

        A node of the boundary gets the value of the surface where it lies.

        Parameters
        ----------
        values : numbers; integers are labels, which are never averaged
        region : inside which surface, as in `to_surface`
        """
        matrix = self.surface_map(region).from_surface

        def bring(given: NDArray[Any]) -> NDArray[Any]:
            if len(given) != matrix.shape[1]:
                raise InputError(
                    f"{len(given):,} values for a surface of {matrix.shape[1]:,} vertices",
                    remedy="give one for each vertex of the input surface",
                )
            return applied(matrix, given)

        return brought(values, bring)

    def surface_map(self, region: str | None = None) -> SurfaceMap:
        """How the nodes and the vertices of a given surface belong together, as sparse matrices.

        Parameters
        ----------
        region : inside the surface; None: the outermost one that was given
        """
        require_threads()
        name = next(iter(self.native), "") if region is None else region
        if name not in self.native:
            what = f"the mesh has no surface {name!r}" if self.native else "the surface of the mesh is not known"
            named = (
                f"name one of {', '.join(self.native)}" if self.native else "mesh it with cortet, or keep its sidecar"
            )
            raise InputError(what, remedy=named)
        if name not in self._maps:
            self._maps[name] = surface_map(
                self.mesh,
                sheets(self.surface)[region_names(self.surface.inner).index(name)],
                self.native[name],
                number=region_names(self.surface.inner).index(name),
                renumbered="resample" in self.certificate.parameters,
            )
        return self._maps[name]

    @cached_property
    def _maps(self) -> dict[str, SurfaceMap]:
        return {}

    def checks(self) -> pd.DataFrame:
        """The checks of the certificate: name, whether passed, finding."""
        import pandas as pd

        return pd.DataFrame([asdict(check) for check in self.certificate.checks])

    def tissues(self) -> pd.DataFrame:
        """The part of the mesh with each label of its volumes: tetrahedra, mL, worst q, mean share inside."""
        import pandas as pd

        return pd.DataFrame(list(self.tissue_rows), columns=names(TISSUE_COLUMNS))

    def electrodes(self) -> pd.DataFrame:
        """The contacts on the mesh: distance moved, area beside that of the circle, faces, region, and further numbers.

        The values of a contact at the nodes are the field `electrode_NAME`; they sum to 1.
        """
        import pandas as pd

        found = [asdict(record) for record in self.certificate.electrodes]
        return pd.DataFrame(found, columns=[field.name for field in fields_of(ElectrodeRecord)])

    @property
    def regions(self) -> dict[str, int]:
        """Name -> number of each region, from the outside in, as files have them; without inner surfaces by depth."""
        return regions(self.named())

    def to_pyvista(self) -> pyvista.UnstructuredGrid:
        """The mesh for PyVista with the arrays of its VTU file: fields, named sets, `q` and `region`."""
        import pyvista

        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: self.cells}, self.points)
        of_nodes, of_cells = with_sets(with_q(self.named()))
        grid.point_data.update(of_nodes)
        grid.cell_data.update(of_cells)
        return grid

    def plot(self, size: tuple[int, int] = (1200, 900)) -> NDArray[np.uint8]:
        """A picture of the mesh, cut open, with the rest transparent: (height, width, 4); needs no display."""
        from cortet.report.render import cut_view

        return cut_view(self.mesh, regions=bool(self.surface.inner), size=size)

    def picture(self, path: str | Path, **how: Any) -> None:
        """Draw the mesh into a PNG file as `cortet picture` does: with a legend, a scale bar, and where anterior is.

        Parameters
        ----------
        how : `axis`, `position`, `view`, `regions` and `size` of `cortet.report.render.picture`
        """
        from cortet.report.render import picture

        picture(self.named(), path, **how)

    def page(self, path: str | Path, *, files: Sequence[tuple[str, str]] = (), force: bool = False) -> None:
        """Write an HTML page about the mesh: verdict, pictures, sections, every number with its limit.

        Parameters
        ----------
        path : `.html`
        files : address of further files, as seen from the page, and the words of the link to each
        force : also replace a file that cortet did not make; an input is never overwritten

        Raises
        ------
        InputError : the file exists and cortet did not make it, or the name has another ending
        """
        target = Path(path)
        if target.suffix.lower() not in (".html", ".htm"):
            raise InputError("does not end with .html", file=target, remedy="name a page, x.html")
        from cortet.report.case_page import Checked, about, write_case_page
        from cortet.report.slices import slices

        mesher = self.certificate.parameters.get("generate", {}).get("mesher")
        known = {"surface": self.origin.kind, "scan_age": self.ga, "cell_size_mm": self.cell_size}
        known |= {name: one for name, one in {"mesher": mesher, "hemi": self.hemi}.items() if one}
        given = next(iter(self.native.values()), self.surface)
        with tempfile.TemporaryDirectory() as folder:
            drawn = None
            if self.volumes:
                drawn = Path(folder) / "slices.png"
                slices(self.mesh, *next(iter(self.volumes.items())), drawn, given.frame)
            certificate = json.loads(json.dumps(asdict(self.certificate)))
            shown = Checked(self.mesh, given, self.surface, certificate, files, self.tissue_rows, drawn)
            with guarded(self.inputs, files=[target], force=force):
                write_case_page(shown, target, facts=about(known))

    def named(self) -> TetMesh:
        """The mesh with its named sets and the numbers of its regions, as files hold it."""
        sets = self.config.export.sets(self.origin.kind)
        return with_named_sets(self.mesh, self.surface, self.origin, sets=sets, labels=label_names(self.volumes))[0]

    def save(self, path: str | Path, *, force: bool = False, uncertified: bool = False) -> Path:
        """Write the mesh in the format that the file's ending names, with its companions.

        They are the sidecar, the certificate, the surface that was meshed, and a table of the labels of volumes.

        Parameters
        ----------
        force : also replace a file that cortet did not make. A file that was given by its name is never overwritten;
            NiBabel's images of surfaces do not know theirs
        uncertified : also write a mesh that is not certified, as `x_uncertified.vtu` in place of `x.vtu`

        Returns
        -------
        The file of the mesh

        Raises
        ------
        InputError : the mesh is not certified, or the file exists and cortet did not make it
        """
        path = Path(path)
        format_of(path)
        require_threads()
        if self.certified:
            refuse_uncertified_name(path)
        uncertified = uncertified or self.config.export.uncertified
        target = file_of(path, certified=self.certified)
        if not self.certified and not uncertified:
            raise InputError(
                f"was not written because the mesh is not certified: {'; '.join(self.certificate.reasons)}",
                file=path,
                remedy=f"give uncertified=True to write it as {target.name}",
            )
        with guarded(self.inputs, files=[target], force=force):
            deliver(self, path, force=force, uncertified=uncertified)
        return target

    def __repr__(self) -> str:
        verdict = "; ".join([self.certificate.verdict, *self.certificate.reasons])
        q = self.certificate.quality.q
        return (
            f"<Mesh: {len(self.points):,} nodes, {len(self.cells):,} tetrahedra\n"
            f" worst q {q.max:.3f}, mean {q.mean:.3f}; regions: {', '.join(self.regions)}\n"
            f" {verdict}>"
        )

    def _repr_html_(self) -> str:
        text = html.escape(repr(self)[1:-1]).replace("\n", "<br>")
        return f"<p>{text}</p>{image(self.plot(_PICTURE))}{self.certificate._repr_html_()}"


def mesh(
    shape: SurfaceLike,
    cell_size: float | None = None,
    *,
    ga: float | None = None,
    hemi: Literal["L", "R"] | None = None,
    inner: Mapping[str, SurfaceLike] | None = None,
    fields: Mapping[str, Any] | None = None,
    volumes: Mapping[str, str | Path | spatialimages.SpatialImage | Volume] | None = None,
    electrodes: Mapping[str, Sequence[float]] | pd.DataFrame | str | Path | None = None,
    sphere: SurfaceLike | None = None,
    settings: Settings | None = None,
    progress: bool | Callable[[Step], None] = True,
) -> Mesh:
    """Mesh the inside of a closed surface, and check the mesh.

    Parameters
    ----------
    shape : a file, NiBabel's `GiftiImage`, PyVista's `PolyData`, trimesh's `Trimesh`, or vertices (n, 3) and faces
        (m, 3); mm, unless `gate.unit` of the settings says otherwise
    cell_size : edge length of the tetrahedra, mm; None: that of the settings
    ga : gestational age, weeks
    hemi : "L" or "R"; None: what the file says, if anything
    inner : closed surfaces inside, name of the region within -> surface
    fields : values per vertex (n,) or (n, k) by name, or files of them, which the mesh also gets
    volumes : images whose labels, numbers or tensors the tetrahedra get, by name: NIfTI or MGZ, or NiBabel's images
    electrodes : contacts, name -> (x, y, z) or (x, y, z, radius), mm, in the coordinates of the surface; or a table
        with columns `name`, `x`, `y`, `z`, and `radius` or `size` (mm2); or a `*_electrodes.tsv` of BIDS
    sphere : of the surface, through which it is put onto the common mesh (`resample`)
    settings : a configuration file, or its keys by section: {"repair": {"enabled": True}}
    progress : False: silent; a function: called after every stage

    Returns
    -------
    nodes (n, 3) mm, tetrahedra (m, 4), fields, regions, and the certificate

    Raises
    ------
    InputError : the surface cannot be meshed, a volume does not contain it, a contact lies outside, or a setting is
        impossible
    CortetError : a stage failed

    Examples
    --------
    >>> made = cortet.mesh("x.surf.gii", cell_size=4.0, ga=28, progress=False)
    >>> made.certified, list(made.regions)
    (True, ['cortex', 'core'])
    >>> made.save("made.vtu").name
    'made.vtu'
    """
    require_hemisphere(hemi)
    require_region_names(inner or ())
    if ga is not None:
        require_within(ga, SCAN_AGES, "the gestational age in weeks")
    config = load(sections(settings))
    size = config.generate.cell_size[0] if cell_size is None else cell_size
    require_within(size, CELL_SIZE_MM, "the cell size in mm")
    size = float(size)
    source, field_files = _file(shape), _files(fields)
    whole = _whole(shape, fields or {}, inner or {}, finite=not config.enabled("repair"))
    if config.export.layers is not None:
        require_layers(whole)
    images = read_volumes(volumes or {})
    in_mm = placed(whole, config.placement())
    contacts = () if electrodes is None else contacts_of(electrodes, in_mm.frame, config.placement())
    around = around_contacts(contacts, in_mm)
    background = backgrounds(images, in_mm)
    for one in background if progress else ():
        say(one.sentence)
    inner_files = _files(inner)
    known = {name: inner_files[name] for name in whole.inner if name in inner_files}
    origin = Origin(
        {} if source is None else by_region(source, known),
        fields=field_files,
        volumes={name: str(file) for name, file in _files(volumes).items()},
        age=None if ga is None else float(ga),
        hemisphere=hemi or (hemisphere_of(source) if source else None),
        kind=kind_of(source) if source else None,
    )
    made = mesh_surface(
        State(in_mm, None if sphere is None else surface(sphere)),
        config,
        About(
            cell_size=size,
            gestational_age=origin.age,
            hemi=origin.hemisphere,
            to_mm=config.placement(),
            contacts=around,
            source=None if source is None else str(source),
            sphere_file=str(sphere) if _file(sphere) else None,
            inner={name: str(file) for name, file in inner_files.items()},
        ),
        case=Path(source).name.partition(".")[0] if source else "",
        progress=teller(progress),
    )
    filled, rows = with_volumes(made.mesh, images, frame=in_mm.frame, background=background)
    filled, records = with_electrodes(filled, contacts, in_mm.inner, config.export.layers)
    large = [one.sentence for one in background if one.large]
    image_files = [volume.file for volume in images.values()]
    read_from = (source, _file(sphere), *inner_files.values(), *field_files.values(), *image_files, _file(electrodes))
    return Mesh(
        filled,
        with_contacts(with_remarks(made.certificate, large), filled, records),
        made.surface,
        size,
        origin,
        config,
        inputs=tuple(Path(file) for file in read_from if file),
        tissue_rows=tuple(rows),
        volumes=images,
        native=dict(zip(region_names(in_mm.inner), sheets(in_mm), strict=True)),
    )


def _whole(
    shape: SurfaceLike, fields: Mapping[str, Any], inner: Mapping[str, SurfaceLike], *, finite: bool
) -> TriSurface:
    """A surface with its fields and its inner surfaces, as given; `finite`: whether coordinates must be finite."""
    outer = cortex(shape, finite=finite)
    if finite or not len(outer.faces):
        require_measurable(outer)
    field_files = _files(fields)
    in_memory = {name: values for name, values in fields.items() if name not in field_files}
    of_vertices = {**outer.point_data, **in_memory}
    for name, values in of_vertices.items():
        require_finite(values_of(values, f"the field {name}"), f"the field {name}")
    outer = with_fields(replace(outer, point_data=of_vertices), field_files)
    return nested(outer, {name: cortex(one, finite=finite) for name, one in inner.items()})


def _file(given: Any) -> str | Path | None:
    """What is given, if it is a file."""
    return given if isinstance(given, str | Path) else None


def _files(given: Mapping[str, Any] | None) -> dict[str, str | Path]:
    """Those of some given things that are files."""
    return {name: one for name, one in (given or {}).items() if isinstance(one, str | Path)}


def teller(progress: bool | Callable[[Step], None]) -> Callable[[Step], None]:
    """What is called after every stage: the function of the user, or one that says the seconds of a stage, or none."""
    if callable(progress):
        return progress
    return (lambda step: say(f"{step.stage}: {step.seconds:.1f} s")) if progress else lambda _: None


def say(line: str) -> None:
    """Print a line where a terminal or a notebook shows it apart from results."""
    sys.stderr.write(f"{line}\n")


def tetrahedra(made: TetMesh | Mesh | str | Path) -> TetMesh:
    """The tetrahedral mesh from any object that holds one; says if its file was changed after cortet wrote it."""
    if isinstance(made, str | Path):
        file = Path(made)
        if changed_since(file):
            say(f"{file}: {CHANGED}")
        return without_q(read_mesh(file))
    if isinstance(made, Mesh | TetMesh):
        return made.mesh if isinstance(made, Mesh) else made
    raise InputError(
        f"an object of type {type(made).__name__} is not a mesh", remedy="give a file, or what `cortet.mesh` returns"
    )


def image(pixels: NDArray[np.uint8]) -> str:
    """A picture as an HTML element."""
    from cortet.report.pages import data_uri
    from cortet.report.render import webp

    return f'<img src="{data_uri(webp(pixels))}" alt="">'
