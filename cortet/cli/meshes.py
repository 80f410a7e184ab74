"""Commands on meshes: `quality`, `certify`, `cite`, `convert`, `quadratic`, `picture`, `project`."""

from __future__ import annotations

import json as json_format
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

import cortet
from cortet.cli.shared import MESHES, Common, Configured, Writes, add
from cortet.cli.values import (
    Below,
    Depth,
    FieldsFile,
    InnerFiles,
    InputFile,
    MeshFile,
    O,
    OutputFile,
    Picture,
    number,
)
from cortet.errors import InputError, UsageError, counted
from cortet.geometry.limits import MOST_LAYERS

if TYPE_CHECKING:
    from cortet.measure.certify import Certificate

Unit = Literal["mm", "um"]


def add_commands(app: App) -> None:
    """Add the commands on meshes."""
    add(app, MESHES, quality, certify, cite, convert, quadratic, picture, project)


def quality(file: MeshFile, /, *, json: bool = False, _: Common = Common()) -> int:
    """Measure the elements of a mesh.

    Parameters
    ----------
    json
        Print all numbers and the histogram as JSON.

    Examples
    --------
    cortet quality lh.vtu
    """
    from cortet.api.meshing import tetrahedra
    from cortet.measure.quality import summarise
    from cortet.report.numbers import ELEMENTS

    found = asdict(summarise(tetrahedra(file)))
    if json:
        print(json_format.dumps(found, indent=2, allow_nan=False))
        return 0
    further = {
        "Smallest volume": "{volume_min_mm3:.3g} mm3",
        "Stable time step": "{stable_time_step:.4g}, in mm / sqrt(mu / density)",
    }
    for name, form in {**ELEMENTS, **further}.items():
        print(f"{name:<30}{form.format_map(found)}")
    return 0


def certify(
    file: MeshFile,
    surface: Path | None = None,
    /,
    *,
    inner: InnerFiles = (),
    configured: Configured = Configured(),
    output: Annotated[OutputFile | None, O, Parameter(metavar="JSON")] = None,
    _: Writes = Writes(),
) -> int:
    """Check a mesh against the surface it was made from.

    Parameters
    ----------
    surface
        Surface that the mesh fills (default: the meshed surface, from the sidecar).
    output
        Also write the certificate to this file.

    Examples
    --------
    cortet certify lh.vtu lh.pial.surf.gii --cell-size 0.6
    """
    from cortet.formats.atomic import write_json
    from cortet.formats.certificates import sealed

    certificate = cortet.certify(file, surface, configured.cell_size, configured.settings(), inner=dict(inner))
    _say_meshed(Path(certificate.input["file"]), surface, file)
    if output:
        write_json(sealed(asdict(certificate)), output)
    for check in certificate.checks:
        print(f"{'pass' if check.passed else 'FAIL'}  {check.finding}")
    print_verdict(certificate)
    return 0 if certificate.certified else 1


def cite(file: MeshFile, folds: Sequence[Path] = (), /, *, _: Common = Common()) -> int:
    """Print a paragraph about a mesh and its folds for a methods section, with its references.

    Parameters
    ----------
    folds
        Folders that `cortet fold` wrote.

    Examples
    --------
    cortet cite lh.vtu folded
    """
    from cortet.api.meshing import tetrahedra
    from cortet.folding.sentences import fold_sentences, verdict_of_fold
    from cortet.formats.certificates import certificate_of
    from cortet.formats.hashing import mesh_sha256
    from cortet.report.methods import bibliography, methods_of_mesh, with_citations
    from cortet.solver_files.meshed import certificate_file
    from cortet.solver_files.sidecar import read_sidecar

    certificate, origin = certificate_of(certificate_file(file)), read_sidecar(file).get("made_from") or {}
    if certificate.get("mesh_sha256") != mesh_sha256(tetrahedra(file)):
        what = "has no certificate next to it, or that of another mesh, of an earlier version, or one that was edited"
        raise InputError(what, file=file, remedy="name a mesh that `cortet mesh` wrote, or mesh the surface again")
    verdicts = {folder: verdict_of_fold(folder) for folder in folds}
    for folder, verdict in verdicts.items():
        if verdict.get("tets") != certificate["quality"]["tets"]:
            what = f"holds no finished fold of {file.name} by this version of cortet"
            raise InputError(what, file=folder, remedy="fold the mesh again, or name another folder")
    age, hemi = origin.get("gestational_age"), origin.get("hemisphere")
    folded = fold_sentences({folder.name: verdict for folder, verdict in verdicts.items()})
    paragraph = methods_of_mesh(certificate, age, hemi, folded)
    print(with_citations(paragraph, [certificate]))
    print(bibliography([certificate]))
    return 0


def _say_meshed(source: Path, given: Path | None, mesh: Path) -> None:
    """Say which surface takes the place of the one that was given, if another one does."""
    if source != given:
        print(f"{source}: the surface that was meshed, according to the sidecar of {mesh.name}")


def convert(
    source: Annotated[Path, Parameter(name="IN")],
    target: Annotated[OutputFile, Parameter(name="OUT")],
    /,
    *,
    unit: Unit = "um",
    source_unit: Literal["mm", "m", "cm", "um"] | None = None,
    tags: Annotated[str | None, Parameter(metavar="VOLUME")] = None,
    _: Writes = Writes(),
) -> int:
    """Convert a mesh file to the format of another solver.

    Parameters
    ----------
    target
        Output mesh; its extension selects the format.
    unit
        Unit of a CARP file that cortet writes (default: um).
    source_unit
        Unit of IN (default: from its sidecar, else um for CARP and mm for other formats).
    tags
        Number tetrahedra by the labels of this volume instead of by region.

    Examples
    --------
    cortet convert lh.vtu lh.inp
    """
    from cortet.solver_files.export import convert

    for change in convert(source, target, unit=unit, source_unit=source_unit, tags=tags):
        print(f"{target}: {change}")
    print(f"{target}: written")
    return 0


def quadratic(
    file: MeshFile,
    surface: Path | None = None,
    /,
    *,
    output: Annotated[OutputFile, O, Parameter(metavar="OUT")],
    max_boundary_distance: Annotated[float, number(0, 1000, "MM")] = 1e-3,
    _: Writes = Writes(),
) -> int:
    """Write a mesh as ten-node tetrahedra whose midside nodes lie on the surface.

    Parameters
    ----------
    surface
        Surface that the mesh fills (default: the meshed surface, from the sidecar).
    output
        .inp, .feb, .msh, .vtu or .xdmf.
    max_boundary_distance
        Limit of the distance of boundary nodes to the surface (default: 0.001).

    Examples
    --------
    cortet quadratic lh.vtu -o lh10.inp
    """
    from cortet.api.files import filling
    from cortet.config import Config
    from cortet.geometry.quadratic import quadratic
    from cortet.solver_files.export import refuse_failed
    from cortet.solver_files.ten_nodes import write_ten_nodes

    mesh, filled, source = filling(file, surface, Config())
    refuse_failed(mesh, file, output)
    _say_meshed(source or file, surface, file)
    curved = quadratic(mesh, filled, max_boundary_distance=max_boundary_distance)
    told = write_ten_nodes(mesh, curved, output)
    straight = curved.straightened_for_elements + curved.straightened_for_crossings
    print(
        f"{counted(curved.curved, 'edge follows', 'edges follow')} the surface (midside nodes moved by up "
        f"to {curved.largest_move_mm:.3f} mm); "
        f"{straight} stay straight"
    )
    print(f"smallest Jacobian determinant, relative to the straight element: {curved.least_jacobian:.3f}")
    for what in told:
        print(f"{output}: {what}")
    print(f"{output}: written")
    return 0


def picture(
    file: MeshFile,
    /,
    *,
    output: Annotated[Picture, O],
    plane: Literal["x", "y", "z"] = "y",
    position: Annotated[float, number(0, 1, "SHARE")] = 0.5,
    view: Literal["left", "right", "front", "back", "top", "bottom"] | None = None,
    region: Annotated[bool | None, Parameter(negative="--no-region")] = None,
    _: Writes = Writes(),
) -> int:
    """Draw a mesh cut open, coloured by region or q.

    Parameters
    ----------
    plane
        Axis normal to the cut.
    position
        Position of the cut along that axis; 1 draws the entire mesh.
    view
        Direction of view (default: obliquely onto the cut).
    region
        Colour by region, or with --no-region by q (default: by region if there are several).

    Examples
    --------
    cortet picture lh.vtu -o lh.png --plane x --view right
    """
    from cortet.api.meshing import tetrahedra
    from cortet.report import render

    render.picture(tetrahedra(file), output, axis=plane, position=position, view=view, regions=region)
    print(f"{output}: drawn")
    return 0


def project(
    result: Annotated[Path, Parameter(name="RESULT")],
    /,
    *,
    mesh: InputFile,
    output: Annotated[FieldsFile, O],
    depth: Depth | None = None,
    equidistant: bool = False,
    layer: Annotated[int | None, number(1, MOST_LAYERS, "N", whole=True)] = None,
    field: Annotated[Sequence[str], Parameter(metavar="NAME")] = (),
    surface: InputFile | None = None,
    _: Writes = Writes(),
) -> int:
    """Project the results of a solver back onto the input surface.

    Parameters
    ----------
    result
        VTU, VTK, PVD, XDMF, ...: fields of nodes and elements, at one or several times.
    mesh
        Mesh of the simulation, as cortet wrote it.
    output
        GIfTI with one array for each field and time.
    equidistant
        Measure depths in % by the length of a column of the cortex instead of its volume.
    layer
        Project means over layer N of a mesh that was made with --layers; layer 1 is outermost.
    field
        Project only this field; repeatable (default: all fields).
    surface
        Surface to project onto (default: from the sidecar of the mesh).

    Examples
    --------
    cortet project result.vtu --mesh lh.vtu -o lh.func.gii
    """
    from cortet.api.meshing import tetrahedra
    from cortet.formats.gifti import hemisphere_of, require_same_hemisphere, write_fields
    from cortet.measure.layers import bounds_of
    from cortet.solver_files.laminar import Laminar
    from cortet.solver_files.results import chosen, on_surface, read_result
    from cortet.solver_files.sidecar import read_sidecar
    from cortet.solver_files.surface_map import map_of_file

    if layer is not None and (depth, equidistant) != (None, False):
        raise UsageError("--layer excludes --depth and --equidistant", remedy="leave them out")
    if equidistant and (depth is None or not depth.relative):
        raise UsageError("--equidistant applies only to a depth in %", remedy="give --depth in %")
    content = tetrahedra(mesh)
    found, file, how = map_of_file(mesh, content, surface)
    print(f"{file}: {how}")
    made_from = read_sidecar(mesh).get("made_from") or {}
    if layer is not None:
        bounds = bounds_of(made_from.get("layers") or [1]).tolist()
        if layer >= len(bounds):
            count = len(bounds) - 1 if made_from.get("layers") else 0
            what = f"has no layer {layer}: {count} layers are recorded for it"
            raise InputError(what, file=mesh, remedy="mesh with --layers, or give --depth")
        depth = Below(bounds[layer - 1], bounds[layer], relative=True)
    hemisphere = made_from.get("hemisphere") or hemisphere_of(file)
    require_same_hemisphere(file, hemisphere)
    inner = list(made_from.get("meshed") or {})[1:]
    if depth and depth.relative:
        there = Laminar(found, inner, equivolumetric=not equidistant).weights(depth.first, depth.last)
        print("depths are measured along the columns of the cortex")
    else:
        there = found.weights((depth.first, depth.last) if depth else None)
        if depth:
            print("depths are measured along the surface normal")
    steps = read_result(result)
    fields, told = on_surface(chosen(steps, field, result) if field else steps, there, file=result, mesh_file=mesh)
    for line in told:
        print(f"{result}: {line}")
    write_fields(fields, output, hemisphere=hemisphere)
    print(f"{output}: {counted(len(fields), 'field')} of {len(found.points):,} vertices: {', '.join(fields)}")
    return 0


def print_verdict(certificate: Certificate) -> None:
    """Print whether a mesh is certified, and if not, why; and what else should be known."""
    from cortet.meshes import OUTERMOST

    print(certificate.verdict)
    for region in certificate.regions:
        if region.name == OUTERMOST and (across := region.edges_across):
            print(f"  elements across the {OUTERMOST}: 5th percentile {across.p5:g}, median {across.median:g}")
    for line in (*certificate.reasons, *certificate.remarks):
        print(f"  {line}")
