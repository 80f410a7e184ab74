"""Commands on meshes: `quality`, `certify`, `compare`, `verify`, `convert`, `quadratic`, `picture`."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cli.given import draw, read_mesh, stem_of
from cortet.cli.shared import common, inner, limits, writes
from cortet.cli.values import Number, OutputFile, output_picture
from cortet.errors import InputError
from cortet.formats import FORMATS, format_of

if TYPE_CHECKING:
    from cortet.cli.shared import Commands
    from cortet.measure.certify import Certificate
    from cortet.meshes import TetMesh, TriSurface


def add_commands(commands: Commands) -> None:
    """Add the commands on meshes."""
    quality = commands.add_parser("quality", parents=[common()], help="measure the elements of a mesh")
    quality.add_argument("mesh", type=Path, metavar="MESH")
    quality.add_argument("--json", action="store_true", help="every number, the histogram too, as JSON")
    quality.set_defaults(run=quality_command)

    certify = commands.add_parser(
        "certify", parents=[writes(), inner(), limits()], help="check a mesh against the surface it was made from"
    )
    certify.add_argument("mesh", type=Path, metavar="MESH")
    certify.add_argument(
        "surface", type=Path, nargs="?", metavar="SURFACE", help="default: the surface that was meshed, by the sidecar"
    )
    certify.add_argument("-o", "--output", type=OutputFile, metavar="JSON", help="also write the certificate there")
    certify.set_defaults(run=certify_command)

    compare = commands.add_parser(
        "compare", parents=[writes(), limits()], help="set meshes of one surface side by side, whatever made them"
    )
    compare.add_argument("meshes", type=Path, nargs="+", metavar="MESH")
    compare.add_argument(
        "--surface", type=Path, metavar="SURFACE", help="the surface they fill (default: by the sidecar of the first)"
    )
    compare.add_argument("-o", "--output", type=OutputFile, required=True, metavar="HTML", help="page for a browser")
    compare.add_argument("--table", type=OutputFile, metavar="TSV", help="also write the numbers there")
    compare.set_defaults(run=compare_command)

    verify = commands.add_parser(
        "verify", parents=[common()], help="check a solver file against its solver's conventions"
    )
    verify.add_argument("file", type=Path, metavar="FILE")
    verify.add_argument("--solver", choices=list(FORMATS), help="solver that will read it (default: by the suffix)")
    verify.set_defaults(run=verify_command)

    convert = commands.add_parser("convert", parents=[writes()], help="write a mesh file in another solver's format")
    convert.add_argument("source", type=Path, metavar="IN")
    convert.add_argument("target", type=OutputFile, metavar="OUT", help="its suffix says for which solver")
    convert.add_argument("--unit", choices=["mm", "um"], default="um", help="of a CARP file that is written")
    convert.add_argument("--source-unit", choices=["mm", "um"], default="um", help="of a CARP file without a sidecar")
    convert.add_argument(
        "--tags", metavar="VOLUME", help="number the tetrahedra by the labels of this volume, not by their regions"
    )
    convert.set_defaults(run=convert_command)

    quadratic = commands.add_parser(
        "quadratic", parents=[writes()], help="write a mesh as ten-node tetrahedra, midside nodes on the surface"
    )
    quadratic.add_argument("mesh", type=Path, metavar="MESH")
    quadratic.add_argument(
        "surface", type=Path, nargs="?", metavar="SURFACE", help="default: the surface that was meshed, by the sidecar"
    )
    quadratic.add_argument(
        "--max-boundary-distance",
        type=Number(0, 1000, endless=True),
        default=1e-3,
        metavar="MM",
        help="limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit)",
    )
    quadratic.add_argument(
        "-o", "--output", type=OutputFile, required=True, metavar="OUT", help=".inp, .feb, .msh, .vtu or .xdmf"
    )
    quadratic.set_defaults(run=quadratic_command)

    picture = commands.add_parser("picture", parents=[writes()], help="draw a mesh cut open, coloured by q")
    picture.add_argument("mesh", type=Path, metavar="MESH")
    picture.add_argument("-o", "--output", type=output_picture, required=True, metavar="PNG")
    picture.set_defaults(run=picture_command)


def quality_command(args: argparse.Namespace) -> int:
    """Print the element quality of a mesh."""
    from cortet.measure.quality import summarise

    found = summarise(read_mesh(args.mesh))
    if args.json:
        print(json.dumps(asdict(found), indent=2, allow_nan=False))
        return 0
    other = {"1 - mean ratio": found.one_minus_mean_ratio, "1 - radius ratio": found.one_minus_radius_ratio}
    rows = {
        "nodes": f"{found.nodes:,}",
        "tetrahedra": f"{found.tets:,}",
        "q": f"worst {found.q.max:.4f}, mean {found.q.mean:.4f}, standard deviation {found.q.sd:.4f}",
        "tetrahedra by q": ", ".join(f"{count:,} above {limit}" for limit, count in found.count_above.items()),
        **{name: f"worst {measure.max:.4f}, mean {measure.mean:.4f}" for name, measure in other.items()},
        "dihedral angles": f"{found.dihedral_min_deg:.1f} to {found.dihedral_max_deg:.1f} degrees",
        "edges": f"{found.shortest_edge_mm:.3f} to {found.longest_edge_mm:.3f} mm",
        "smallest volume": f"{found.volume_min_mm3:.3g} mm3",
        "stable time step": f"{found.stable_time_step:.4g}, in mm / sqrt(mu / density)",
    }
    for name, value in rows.items():
        print(f"{name:<18}{value}")
    return 0


def certify_command(args: argparse.Namespace) -> int:
    """Check a mesh against its surface and write the certificate."""
    from cortet.formats.atomic import write_json
    from cortet.solver_files.sets import with_regions
    from cortet.stages.separate import separate

    mesh, given = read_mesh(args.mesh, whole=True), args.surface
    surface = filled_surface(args.mesh, args)
    if surface.inner:
        mesh = with_regions(mesh, list(surface.inner))
        if args.cell_size is not None and args.surface == given:  # not as meshed: separate them as then
            surface, _ = separate(surface, cell_size=args.cell_size)
    certificate = _checked(mesh, surface, args.mesh, args)
    if args.output:
        write_json(asdict(certificate), args.output)
    for check in certificate.checks:
        print(f"{'pass' if check.passed else 'FAIL'}  {check.finding}")
    print_verdict(certificate)
    return 0 if certificate.certified else 1


def filled_surface(mesh: Path, args: argparse.Namespace) -> TriSurface:
    """The surface that a mesh fills, with its inner ones: as meshed if that was kept, else as given."""
    from cortet.solver_files.meshed import meshed_surface

    inner = {name: Path(file) for name, file in getattr(args, "inner", [])}
    surface, args.surface = meshed_surface(mesh, given := args.surface, inner)
    if args.surface != given:
        print(f"{args.surface}: the surface that was meshed, by the sidecar of {mesh.name}")
    return surface


def _checked(mesh: TetMesh, surface: TriSurface, file: Path, args: argparse.Namespace) -> Certificate:
    """The certificate of the mesh of a file, by the limits given to the command and the cell size if that is known."""
    from cortet.config import load
    from cortet.measure.certify import certify
    from cortet.solver_files.meshed import cell_size_of

    given = {"q_max": args.q_max, "max_boundary_distance": args.max_boundary_distance}
    chosen = {key: None if value == math.inf else value for key, value in given.items()}
    section = {key: value for key, value in chosen.items() if given[key] is not None}
    config, cell_size = load({"certify": section}), args.cell_size or cell_size_of(file)
    return certify(
        mesh,
        surface,
        config.certify,
        cell_size=cell_size,
        case=stem_of(file),
        source=args.surface,
        parameters={"certify": config.arguments("certify", {"cell_size": cell_size})},
    )


def compare_command(args: argparse.Namespace) -> int:
    """Print and write the differences between meshes."""
    from cortet.formats.tsv import write_tsv
    from cortet.report.comparison_page import comparison_rows, write_comparison_page

    names = _names_of(args.meshes)
    surface = filled_surface(args.meshes[0], args)
    meshes = {name: read_mesh(file) for name, file in names.items()}
    certificates = {name: asdict(_checked(mesh, surface, names[name], args)) for name, mesh in meshes.items()}
    write_comparison_page(meshes, certificates, surface, args.output, source=args.surface.name)
    if args.table:
        rows = comparison_rows(certificates)
        columns = {"number": "name", "limit": "limit"}
        write_tsv(
            [
                {column: row[key] for column, key in columns.items()}
                | {name: value for name, (value, _) in zip(meshes, row["values"], strict=True)}
                for row in rows
            ],
            [*columns, *meshes],
            args.table,
        )
    for name, certificate in certificates.items():
        verdict = "certified" if certificate["certified"] else "NOT certified: " + "; ".join(certificate["reasons"])
        print(f"{name}: {verdict}")
    print(f"{args.output}: written")
    return 0


def _names_of(files: Sequence[Path]) -> dict[str, Path]:
    """The label of each file: its stem, or the file itself if two have the same stem."""
    stems = [stem_of(file) for file in files]
    names = {stem if stems.count(stem) == 1 else str(file): file for stem, file in zip(stems, files, strict=True)}
    if len(names) < len(files):
        raise InputError("a mesh is given twice", remedy="name each file once")
    return names


def verify_command(args: argparse.Namespace) -> int:
    """Check a solver's file as it was written."""
    from cortet.solver_files.verify import verify

    solver = args.solver or format_of(args.file).name
    problems = verify(args.file, solver)
    for problem in problems:
        print(f"{args.file}: {problem}")
    if not problems:
        print(f"{args.file}: keeps every convention of {solver}")
    return 1 if problems else 0


def convert_command(args: argparse.Namespace) -> int:
    """Write a mesh in another format, verified."""
    from cortet.solver_files.export import convert

    for change in convert(args.source, args.target, unit=args.unit, source_unit=args.source_unit, tags=args.tags):
        print(f"{args.target}: {change}")
    print(f"{args.target}: written and verified")
    return 0


def quadratic_command(args: argparse.Namespace) -> int:
    """Write a mesh of ten-node tetrahedra."""
    from cortet.geometry.quadratic import quadratic
    from cortet.solver_files.ten_nodes import write_ten_nodes

    mesh = read_mesh(args.mesh, whole=True)
    limit = args.max_boundary_distance
    surface = filled_surface(args.mesh, args)
    curved = quadratic(mesh, surface, max_boundary_distance=None if limit == math.inf else limit)
    told = write_ten_nodes(mesh, curved, args.output)
    straight = curved.straightened_for_elements + curved.straightened_for_crossings
    print(
        f"{curved.curved} edges follow the surface, their middles moved by up to {curved.largest_move_mm:.3f} mm; "
        f"{straight} were left straight"
    )
    print(f"least Jacobian determinant, of that of the straight element: {curved.least_jacobian:.3f}")
    for what in told:
        print(f"{args.output}: {what}")
    print(f"{args.output}: written")
    return 0


def picture_command(args: argparse.Namespace) -> int:
    """Draw a mesh."""
    draw(read_mesh(args.mesh), args.output)
    return 0


def print_verdict(certificate: Certificate) -> None:
    """Print whether a mesh is certified, and if not, why; and what else should be known."""
    print("certified" if certificate.certified else "NOT certified:")
    for line in (*certificate.reasons, *certificate.remarks):
        print(f"  {line}")
