"""Commands on meshes: `quality`, `certify`, `compare`, `verify`, `convert`, `quadratic`, `job`, `picture`."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cli.given import draw, read_mesh, stem_of
from cortet.errors import InputError
from cortet.formats import format_of

if TYPE_CHECKING:
    from cortet.measure.certify import Certificate
    from cortet.meshes import TetMesh, TriSurface


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
    """Judge a mesh against its surface and write the certificate."""
    from cortet.config import Config
    from cortet.formats.atomic import write_json
    from cortet.solver_files.sets import with_regions
    from cortet.stages.separate import separate

    mesh, given = read_mesh(args.mesh, whole=True), args.surface
    surface = _filled_surface(args.mesh, args)
    if surface.inner:
        mesh = with_regions(mesh, list(surface.inner))
        if args.cell_size is not None and args.surface == given:  # not those that were meshed: separate them as then
            surface, _ = separate(surface, **Config().arguments("separate", {"cell_size": args.cell_size}))
    certificate = _judged(mesh, surface, args.mesh, args)
    if args.output:
        write_json(asdict(certificate), args.output)
    for check in certificate.checks:
        print(f"{'pass' if check.passed else 'FAIL'}  {check.finding}")
    print_verdict(certificate)
    return 0 if certificate.certified else 1


def _filled_surface(mesh: Path, args: argparse.Namespace) -> TriSurface:
    """The surface that a mesh fills, with its inner ones: as meshed where that was kept, else as given."""
    from cortet.solver_files.meshed import meshed_surface

    inner = {name: Path(file) for name, file in getattr(args, "inner", [])}
    surface, args.surface = meshed_surface(mesh, given := args.surface, inner)
    if args.surface != given:
        print(f"{args.surface}: the surface that was meshed, by the sidecar of {mesh.name}")
    return surface


def _judged(mesh: TetMesh, surface: TriSurface, file: Path, args: argparse.Namespace) -> Certificate:
    """The certificate of the mesh of a file, by the limits of the command."""
    from cortet.config import load
    from cortet.measure.certify import certify

    given = {"q_max": args.q_max, "max_boundary_distance": args.max_boundary_distance}
    chosen = {key: None if value == math.inf else value for key, value in given.items()}
    section = {key: value for key, value in chosen.items() if given[key] is not None}
    limits = load({"certify": section}).arguments("certify", {"cell_size": args.cell_size})
    return certify(mesh, surface, **limits, case=stem_of(file), source=args.surface, parameters={"certify": limits})


def compare_command(args: argparse.Namespace) -> int:
    """Print and write what differs between meshes."""
    from cortet.formats.tsv import write_tsv
    from cortet.report.comparison_page import comparison_rows, write_comparison_page

    names = _names_of(args.meshes)
    surface = _filled_surface(args.meshes[0], args)
    meshes = {name: read_mesh(file) for name, file in names.items()}
    certificates = {name: asdict(_judged(mesh, surface, names[name], args)) for name, mesh in meshes.items()}
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
    """What to call each file: its stem, or the file itself where two have the same stem."""
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

    for change in convert(args.source, args.target, unit=args.unit, source_unit=args.source_unit):
        print(f"{args.target}: {change}")
    print(f"{args.target}: written and verified")
    return 0


def quadratic_command(args: argparse.Namespace) -> int:
    """Write a mesh of ten-node tetrahedra."""
    from cortet.geometry.quadratic import quadratic
    from cortet.solver_files.ten_nodes import write_ten_nodes

    mesh = read_mesh(args.mesh, whole=True)
    limit = args.max_boundary_distance
    surface = _filled_surface(args.mesh, args)
    curved = quadratic(mesh, surface, max_boundary_distance=None if limit == math.inf else limit)
    write_ten_nodes(mesh, curved, args.output)
    straight = curved.straightened_for_elements + curved.straightened_for_crossings
    print(
        f"{curved.curved} edges follow the surface, their middles moved by up to {curved.largest_move_mm:.3f} mm; "
        f"{straight} were left straight"
    )
    print(f"least Jacobian determinant, of that of the straight element: {curved.least_jacobian:.3f}")
    print(f"{args.output}: written")
    return 0


def job_command(args: argparse.Namespace) -> int:
    """Write a job for a solver."""
    from importlib import import_module

    from cortet.geometry.quadratic import quadratic

    module, run = {
        "calculix": ("calculix", "ccx job"),
        "febio": ("febio_job", "febio4 -i job.feb"),
        "fenics": ("fenics_job", "python3 job.py"),
    }[args.solver]
    mesh, more = read_mesh(args.mesh, whole=args.surface is not None), dict[str, object]()
    if args.surface is not None:
        if args.solver != "calculix":
            raise InputError(
                f"--ten-nodes is not for {args.solver}", remedy="use it with --solver calculix, or leave it"
            )
        more["curved"] = quadratic(mesh, _filled_surface(args.mesh, args))
    if args.material:
        if args.solver == "febio":
            raise InputError("--material is not for febio", remedy="use another solver, or edit <Material> in job.feb")
        more["moduli"] = dict(args.material)
    import_module(f"cortet.solver_files.{module}").write_job(mesh, args.output, growth=args.growth, **more)
    print(f"{args.output}: written; run `{run}` in it")
    return 0


def picture_command(args: argparse.Namespace) -> int:
    """Draw a mesh."""
    draw(read_mesh(args.mesh), args.output)
    return 0


def print_verdict(certificate: Certificate) -> None:
    """Print whether a mesh is certified, and if not, why."""
    print("certified" if certificate.certified else "NOT certified:")
    for reason in certificate.reasons:
        print(f"  {reason}")
