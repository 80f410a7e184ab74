"""Commands that make a mesh: `mesh`, `improve`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

import cortet
from cortet.cli.meshes import print_verdict
from cortet.cli.shared import MESHES, Configured, Writes, add
from cortet.cli.values import (
    Electrodes,
    InnerFiles,
    InputFile,
    Layering,
    MeshFile,
    NamedFiles,
    O,
    OutputFile,
    Picture,
    Sizes,
    number,
)
from cortet.errors import UsageError, counted
from cortet.formats import format_of
from cortet.formats.ownership import may_write, refuse_companion
from cortet.geometry.limits import SCAN_AGES

#: columns of the table of stages
HEAD = ("stage", "seconds", "nodes", "tets", "mean q", "q_max", "q > 0.6")
#: what the set cortex of a mesh without inner surfaces is, by the kind of its surface
CORTEX_OF = {
    "white": "the surface is a white surface: the mesh holds white matter without the cortex "
    "(`cortet fold` takes its outermost layer as cortex)",
    None: "neither name nor content say if the surface is white or pial: the set cortex is the outermost layer, "
    "as in a pial surface (if it is white, set export.cortex_layer: false)",
}

if TYPE_CHECKING:
    from cortet.api.meshing import Mesh
    from cortet.pipeline import Step


def add_commands(app: App) -> None:
    """Add `mesh` and `improve`."""
    add(app, MESHES, mesh, improve)


@Parameter(name="*")
@dataclass(frozen=True)
class Views:
    """What shows a mesh.

    Parameters
    ----------
    picture
        Also draw the mesh cut open, coloured by region, or by q if it has one region.
    slices
        Also draw slices of the first volume overlaid with the mesh.
    page
        Also write an HTML page about the mesh.
    """

    picture: Picture | None = None
    slices: Picture | None = None
    page: Annotated[OutputFile | None, Parameter(metavar="HTML")] = None

    def write(self, made: Mesh, temporary: Callable[[Path], Path], files: Mapping[Path, str]) -> None:
        """Write those that are asked for; names of those of a mesh that is not certified say so.

        Parameters
        ----------
        temporary : gives the temporary file of each
        files : to which the page leads, and what they are
        """
        from cortet.api.delivery import file_of

        def named(view: Path) -> Path:
            return file_of(view, certified=made.certified)

        if self.slices:
            from cortet.report.slices import slices

            given = next(iter(made.native.values()), made.surface)
            slices(made.mesh, *next(iter(made.volumes.items())), temporary(named(self.slices)), given.frame)
            print(f"{named(self.slices)}: drawn")
        if self.picture:
            made.picture(temporary(named(self.picture)))
            print(f"{named(self.picture)}: drawn")
        if self.page:
            seen_from = self.page.absolute().parent
            links = {
                os.path.relpath(file.absolute(), seen_from): f"{file.name} ({what})" for file, what in files.items()
            }
            made.page(temporary(named(self.page)), files=[*links.items()])
            print(f"{named(self.page)}: written")


def mesh(
    surface: Path,
    /,
    *,
    output: Annotated[OutputFile, O, Parameter(metavar="OUT")],
    inner: InnerFiles = (),
    size: Sizes = (),
    ga: Annotated[float | None, number(*SCAN_AGES, "WEEKS")] = None,
    field: NamedFiles = (),
    sphere: InputFile | None = None,
    configured: Configured = Configured(),
    volume: NamedFiles = (),
    layers: Layering | None = None,
    electrodes: InputFile | None = None,
    electrode: Electrodes = (),
    views: Views = Views(),
    how: Writes = Writes(),
) -> int:
    """Mesh one surface and certify the mesh.

    Parameters
    ----------
    surface
        Closed surface in mm: GIfTI, FreeSurfer, STL, PLY, OBJ or OFF.
    output
        Mesh file; its extension selects the format.
    ga
        Gestational age; the setting published chooses its smoothing by age.
    field
        Per-vertex field (GIfTI, FreeSurfer or text) to transfer to the mesh; repeatable.
    sphere
        Registered sphere of SURFACE, for resampling onto the common mesh.
    volume
        NIfTI or MGZ whose labels, values or tensors are transferred to tetrahedra; FILE:KIND selects which; repeatable.
    layers
        Number of layers of the cortex, or their shares of its volume, pial first, 1,1,2; needs an inner surface white.
    electrodes
        Table of contacts: *_electrodes.tsv of BIDS, or columns name, x, y, z and size in mm2.

    Examples
    --------
    cortet mesh lh.pial.surf.gii --inner lh.white.surf.gii -o lh.inp
    """
    from cortet.api.delivery import files
    from cortet.config import load
    from cortet.formats.tables import printed
    from cortet.formats.volumes import TISSUE_COLUMNS
    from cortet.meshes import by_region
    from cortet.solver_files.meshed import refuse_uncertified_name, require_own_stem

    if electrodes and electrode:
        raise UsageError("--electrodes and --electrode exclude each other", remedy="add the contact to the table")
    if views.slices and not volume:
        raise UsageError("--slices needs a volume", remedy="give one: --volume NAME=FILE")
    # a file that cannot be written is refused before the work
    refuse_uncertified_name(output)
    settings = configured.settings(size, layers)
    cell_size = configured.cell_size or load(settings).generate.cell_size[0]
    format_of(output)
    outs = [files(output, dict(inner), certified=is_so, volumes=bool(volume)) for is_so in (True, False)]
    every = [file for out in outs for file in out.all]
    for file in every:
        may_write(file)
    for view in (views.page, views.picture, views.slices):
        if view and view.absolute() in [one.absolute() for one in every]:
            refuse_companion(view)
    if not how.force:
        require_own_stem(output, by_region(surface, dict(inner)), cell_size=cell_size)
    made = cortet.mesh(
        surface,
        cell_size,
        ga=ga,
        inner=dict(inner),
        fields=dict(field),
        volumes=dict(volume),
        electrodes=dict(electrode) or electrodes,
        sphere=sphere,
        settings=settings,
        progress=table_of_stages(),
    )
    print()
    for contact in made.certificate.electrodes:
        area = f", {contact.area_mm2:.2f} mm2 on {counted(contact.faces, 'face')}" if contact.area_mm2 else ""
        print(f"electrode {contact.name}: {contact.kind}, moved {contact.moved_mm:.2f} mm{area}")
    if made.tissue_rows:
        print(printed(TISSUE_COLUMNS, made.tissue_rows) + "\n")
    _deliver(made, output, force=how.force, views=views)
    if made.certified and not inner and made.config.export.cortex_layer is None and made.origin.kind in CORTEX_OF:
        print(CORTEX_OF[made.origin.kind])
    return 0 if made.certified else 1


def improve(
    file: MeshFile,
    /,
    *,
    output: Annotated[OutputFile, O, Parameter(metavar="OUT")],
    surface: InputFile | None = None,
    configured: Configured = Configured(),
    how: Writes = Writes(),
) -> int:
    """Improve a mesh of any program by S3 to S6, and certify it.

    Parameters
    ----------
    output
        Mesh file; its extension selects the format.
    surface
        Closed surface that the mesh fills (default: from the sidecar).

    Examples
    --------
    cortet improve brain.msh --surface lh.pial.surf.gii -o better.vtu
    """
    from cortet.formats import read_mesh
    from cortet.measure.quality import summarise
    from cortet.solver_files.meshed import refuse_uncertified_name

    format_of(output)
    refuse_uncertified_name(output)
    before = summarise(read_mesh(file))
    made = cortet.improve(file, surface, configured.cell_size, settings=configured.settings())
    now = made.certificate.quality
    print(f"worst q {before.q.max:.3f}, now {now.q.max:.3f}; {before.tets:,} tetrahedra, now {now.tets:,}")
    _deliver(made, output, force=how.force)
    return 0 if made.certified else 1


def _deliver(made: Mesh, output: Path, *, force: bool, views: Views = Views()) -> None:
    """Write a mesh and what belongs to it, and print the verdict and what was written.

    A mesh that is not certified gets another name, so that an earlier mesh and its certificate stay.
    """
    from cortet.api.delivery import deliver, files

    made = replace(made, certificate=replace(made.certificate, case=output.stem))
    out = files(output, made.surface.inner, certified=made.certified, volumes=bool(made.tissue_rows))
    uncertified = made.config.export.uncertified
    is_written = made.certified or uncertified
    links = {out.mesh: f"the result, {format_of(out.mesh).name}"} if is_written else {}
    links[out.certificate] = "certificate, JSON"
    told = deliver(
        made, output, force=force, uncertified=uncertified, views=lambda temporary: views.write(made, temporary, links)
    )
    print_verdict(made.certificate)
    print(f"{out.certificate}: every number with its limit")
    if is_written:
        for what in told:
            print(f"{out.mesh}: {what}")
        print(f"{out.mesh}: written, with the meshed surface: {next(iter(out.surfaces.values())).name}")
    if not made.certified:
        print(f"{output}: not written" + ("; the earlier file stays" if output.exists() else ""))


def table_of_stages() -> Callable[[Step], None]:
    """A function that prints a row for each completed stage, below the names of the columns."""
    from cortet.measure.quality import quality
    from cortet.meshes import TetMesh

    rows: list[tuple[str, ...]] = [HEAD]

    def print_row(step: Step) -> None:
        numbers = [f"{step.seconds:.1f}", str(len(step.result.points))]
        if isinstance(step.result, TetMesh):
            q = quality(step.result.points, step.result.cells)
            numbers += [str(len(q)), f"{q.mean():.4f}", f"{q.max():.4f}", str(int((q > 0.6).sum()))]
        rows.append((step.stage, *numbers))
        while rows:
            name, *cells = rows.pop(0)
            print(f"{name:<16}" + "".join(f"{cell:>10}" for cell in cells), flush=True)

    return print_row
