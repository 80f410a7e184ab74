"""Commands on surfaces: `gate`, `repair`, `layers`, `phantom`."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

import cortet
from cortet.cli.shared import SURFACES, Common, Writes, add
from cortet.cli.values import (
    CellSize,
    Hemisphere,
    InputFile,
    Layering,
    NamedFiles,
    O,
    SurfaceFile,
    number,
)
from cortet.errors import CortetError, InputError, counted
from cortet.formats.atomic import atomic_folder, write_record
from cortet.formats.ownership import may_write
from cortet.geometry.limits import PHANTOM_AGES, SCAN_AGES, SUBDIVISIONS, THICKNESS_MM

if TYPE_CHECKING:
    from cortet.stages.gate import GateReport


def add_commands(app: App) -> None:
    """Add the commands on surfaces."""
    add(app, SURFACES, gate, repair, layers, phantom)


def gate(
    surfaces: Annotated[Sequence[Path], Parameter(name="SURFACE")],
    /,
    *,
    allow_genus: Annotated[int, number(0, 10_000, "N", whole=True)] = 0,
    ga: Annotated[float | None, number(*SCAN_AGES, "WEEKS")] = None,
    _: Common = Common(),
) -> int:
    """Check whether each surface can be meshed.

    Parameters
    ----------
    allow_genus
        Accept up to N handles.
    ga
        Gestational age, to check the volume by.

    Examples
    --------
    cortet gate *.surf.gii
    """
    from cortet.api.given import cortex
    from cortet.config import load
    from cortet.formats.gifti import hemisphere_of
    from cortet.stages.gate import gate

    config, refused = load({"gate": {"allow_genus": allow_genus}}), 0
    for path in surfaces:
        try:
            given, hemi = cortex(path), hemisphere_of(path)
            report = gate(given, config.gate, source=str(path), gestational_age=ga, hemi=hemi)[1]
        except CortetError as error:
            refused += 1
            print(f"refused   {error}", flush=True)
        else:
            print(f"accepted  {path}: {_findings(report)}", flush=True)
    return 1 if refused else 0


def repair(
    surface: Path,
    /,
    *,
    output: Annotated[SurfaceFile, O],
    config: InputFile | None = None,
    field: NamedFiles = (),
    _: Writes = Writes(),
) -> int:
    """Repair a broken surface within limits.

    Parameters
    ----------
    surface
        GIfTI or FreeSurfer surface.
    output
        GIfTI; the report is written next to it.
    config
        YAML file whose section repair holds the limits.
    field
        Per-vertex field, GIfTI.

    Examples
    --------
    cortet repair broken.surf.gii -o mended.surf.gii
    """
    from cortet.api.given import cortex
    from cortet.formats.gifti import write_surface
    from cortet.solver_files.fields import with_fields
    from cortet.stages.repair import record_path

    record = record_path(output)
    may_write(record)
    given = with_fields(cortex(surface, finite=False), dict(field)) if field else surface
    made, done = cortet.repair(given, config or {})
    with atomic_folder(record) as folder:
        write_surface(made, folder / output.name)
        write_record(done, folder / record.name)
    for step in done["steps"]:
        print(f"{step['count']} {step['done']}")
    if not done["repaired"]:
        print("nothing to repair")
    else:
        there, back = done["file_to_surface_mm"]["max"], done["surface_to_file_mm"]["max"]
        print(f"largest distance from the file to the repaired surface {there:.3f} mm, and back {back:.3f} mm")
        print(f"volume {done['volume_ml']:.2f} mL ({done['relative_volume_change']:+.3%})")
    print(f"{output}: written, with {record.name}")
    return 0


def phantom(
    *,
    ga: Annotated[float, number(*PHANTOM_AGES, "WEEKS")],
    output: Annotated[SurfaceFile, O],
    hemi: Hemisphere = "L",
    subdivisions: Annotated[int, number(*SUBDIVISIONS, "N", whole=True)] = 5,
    seed: Annotated[int, number(0, 2**32 - 1, "N", whole=True)] = 0,
    pial: SurfaceFile | None = None,
    sphere: SurfaceFile | None = None,
    thickness: Annotated[float, number(*THICKNESS_MM, "MM")] = 1.5,
    _: Writes = Writes(),
) -> int:
    """Make a synthetic cortex of any gestational age.

    Parameters
    ----------
    ga
        Gestational age.
    hemi
        Hemisphere (default: L).
    subdivisions
        Subdivisions of the icosahedron (default: 5).
    seed
        Seed of the individual variation (default: 0).
    pial
        File for the pial surface; -o then gets a white surface inside it.
    sphere
        Also write the sphere of the phantom.
    thickness
        Thickness of the cortex between the two surfaces (default: 1.5).

    Examples
    --------
    cortet phantom --ga 30 -o phantom.surf.gii
    """
    from cortet.formats.gifti import write_surface
    from cortet.phantoms import inset, phantom_with_sphere

    surface, ball = phantom_with_sphere(ga, hemisphere=hemi, subdivisions=subdivisions, seed=seed)
    made = {pial: surface, output: inset(surface, thickness)} if pial else {output: surface}
    if sphere:
        write_surface(ball, sphere)
    for file, one in made.items():
        write_surface(one, file)
        print(f"{file}: {len(one.points)} vertices, {len(one.faces)} faces")
    return 0


def layers(
    white: Annotated[Path, Parameter(name="WHITE")],
    pial: Annotated[Path, Parameter(name="PIAL")],
    /,
    *,
    layers: Layering,
    output: Annotated[SurfaceFile, O],
    cell_size: CellSize | None = None,
    _: Writes = Writes(),
) -> int:
    """Make the surfaces between layers of the cortex, along its columns.

    This meshes the cortex. Each surface has the vertex numbering and the triangles of WHITE.

    Parameters
    ----------
    white
        Inner surface of the cortex.
    pial
        Outer surface of the cortex.
    layers
        Number of layers, or the share of each of the volume of the cortex, pial first, 1,1,2.
    output
        GIfTI files NAME1.surf.gii, NAME2.surf.gii, ..., outermost first: one fewer than there are layers.
    cell_size
        Cell size of the mesh; smaller cells give more exact depths (default: half the median thickness).

    Examples
    --------
    cortet layers lh.white lh.pial --layers 4 -o lh.surf.gii
    """
    from cortet.api.given import cortex
    from cortet.api.meshing import mesh
    from cortet.formats.gifti import write_surface
    from cortet.geometry.closest_point import closest_points, tree_of
    from cortet.geometry.intersection import self_intersections
    from cortet.geometry.topology import enclosed_volume
    from cortet.measure.layers import bounds_of

    depths = bounds_of(layers).tolist()[1:-1]
    if not depths:
        raise InputError("a single layer has no inner surface", remedy="give --layers 2 or more")
    name, _, suffixes = output.name.partition(".")
    files = [output.with_name(f"{name}{number}.{suffixes}") for number in range(1, len(layers))]
    for file in (output, *files):
        may_write(file)
    inside, outside = cortex(white), cortex(pial)
    if enclosed_volume(inside.points, inside.faces) > enclosed_volume(outside.points, outside.faces):
        white, pial, inside, outside = pial, white, outside, inside
        print(f"{white} is the smaller surface, so cortet takes it as the inner one")
    if cell_size is None:
        across = closest_points(tree_of(outside), inside.points).distances
        cell_size = round(statistics.median(across.tolist()) / 2, 2)
        print(f"cells of {cell_size:g} mm, half the median distance between the surfaces")
    # columns need no certified mesh, and the stages that make it certified take most of the time
    as_given = {stage: {"enabled": False} for stage in ("smooth_surface", "clean", "reconnect")}
    made = mesh(pial, inner={"white": white}, cell_size=cell_size, settings=as_given)
    surfaces = made.laminar_surfaces(depths)
    for depth, surface, file in zip(depths, surfaces, files, strict=True):
        write_surface(surface, file, like=white)
        crossing = len(self_intersections(surface))
        print(
            f"{file}: depth {depth:.3f}"
            + (f", {counted(crossing, 'triangle intersects', 'triangles intersect')} others" if crossing else "")
        )
    return 0


def _findings(report: GateReport) -> str:
    """The findings and repairs of the gate, in one line."""
    mended = {
        "unused vertices dropped": report.unused_vertices_dropped,
        "faces turned outward": report.faces_reoriented,
        "intersecting faces separated": report.crossing_faces_repaired,
    }
    size = f"{report.vertices} vertices, {report.volume_ml:.1f} mL, {report.area_mm2:.0f} mm2"
    doubt = [f"warning: {report.doubt}"] if report.doubt else []
    return "; ".join([size, *(f"{count} {what}" for what, count in mended.items() if count), *doubt])
