"""The `cortet` command. Everything heavy is imported by the subcommand that needs it."""
# ruff: noqa: T201, printing is what this module is for

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet import __version__
from cortet.errors import CortetError, InputError
from cortet.formats import FORMATS, format_of
from cortet.formats.ownership import delete_made, guarded, may_write, record_of

if TYPE_CHECKING:
    from cortet.config import Config
    from cortet.measure.certify import Certificate
    from cortet.mesh import TetMesh, TriSurface
    from cortet.pipeline import Step
    from cortet.stages.gate import GateReport


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0: done and well, 1: refused, not certified or failed, 2: wrong usage."""
    args = parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s %(message)s", level=logging.INFO if args.verbose else logging.WARNING)
    try:
        _refuse_repeated(args)
        with _guarded(args):
            code = int(args.run(args))
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # whoever read our output, `head` perhaps, has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to flush at the end
        return 141  # as of a program that SIGPIPE ends
    except CortetError as error:
        print(f"cortet: {error}", file=sys.stderr)
        return 1
    except OSError as error:  # no space left, no permission
        print(f"cortet: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("cortet: there is not enough memory for this (use a larger machine or cell size)", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("cortet: interrupted", file=sys.stderr)
        return 130


def _refuse_repeated(args: argparse.Namespace) -> None:
    """Raise InputError where one name is given two files: of `--inner`, `--field`."""
    for option in ("inner", "field"):
        names = [name for name, _ in getattr(args, option, [])]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise InputError(f"--{option} names {twice} twice", remedy="give each a name of its own: NAME=FILE")


class OutputFile(type(Path())):  # type: ignore[misc]
    """A file that a command writes; any other path among its arguments is an input."""


class OutputFolder(type(Path())):  # type: ignore[misc]
    """A folder that a command fills."""


class CheckedOutput(type(Path())):  # type: ignore[misc]
    """A file or folder of a command that itself refuses what is not its own: a sheet, the folders of `cortet run`."""


class FolderOfFiles(type(Path())):  # type: ignore[misc]
    """A folder in which a command writes some files, each of them guarded by itself."""


_WRITTEN = (OutputFile, OutputFolder, CheckedOutput, FolderOfFiles)


def _guarded(args: argparse.Namespace) -> contextlib.AbstractContextManager[None]:
    """The guard of a command, from the types of its arguments."""
    values = [one for value in vars(args).values() for one in (value if isinstance(value, list) else [value])]
    paths = [Path(value[1]) if isinstance(value, tuple) else value for value in values]
    return guarded(
        [path for path in paths if isinstance(path, Path) and not isinstance(path, _WRITTEN)],
        files=[path for path in paths if isinstance(path, OutputFile)],
        claimed=[path for path in paths if isinstance(path, OutputFolder)],
        shared=[path for path in paths if isinstance(path, FolderOfFiles)],
        folders=[path for path in paths if isinstance(path, CheckedOutput)],
        force=getattr(args, "force", False),
    )


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    top = argparse.ArgumentParser(prog="cortet", description="Certified tetrahedral meshes of cortical surfaces.")
    top.add_argument("--version", action="version", version=f"cortet {__version__}")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    writes = argparse.ArgumentParser(add_help=False, parents=[common])
    writes.add_argument(
        "--force", action="store_true", help="replace existing files, whoever made them; never an input"
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND")

    within = argparse.ArgumentParser(add_help=False)
    within.add_argument(
        "--inner",
        action="append",
        default=[],
        type=_inner_file,
        metavar="[NAME=]FILE",
        help="closed surface inside SURFACE, whose inside is a region NAME (default: white); repeatable",
    )

    line = argparse.ArgumentParser(add_help=False, parents=[within])
    line.add_argument("surface", type=Path, metavar="SURFACE", help="closed surface, GIfTI, mm")
    line.add_argument("--cell-size", type=float, metavar="MM", help="cell size h (default: 0.6, or what --config says)")
    line.add_argument(
        "--ga", type=_weeks, metavar="WEEKS", help="gestational age, by which the setting published smooths the surface"
    )
    line.add_argument(
        "--setting",
        choices=["default", "cgal", "published"],
        help="our line, the paper's mesher with our boundary, or all choices of the paper",
    )
    line.add_argument("--config", type=Path, metavar="FILE", help="YAML file of parameters; see config.yaml")
    line.add_argument(
        "--field",
        action="append",
        default=[],
        type=_named_file,
        metavar="NAME=FILE",
        help="per-vertex field to carry to the mesh, GIfTI; repeatable",
    )
    line.add_argument(
        "--sphere", type=Path, metavar="FILE", help="sphere of SURFACE, through which it is put onto the common mesh"
    )

    mesh = commands.add_parser("mesh", parents=[writes, line], help="mesh one surface and certify the mesh")
    mesh.add_argument(
        "-o",
        "--output",
        type=OutputFile,
        required=True,
        metavar="OUT",
        help="mesh file; its suffix says for which solver",
    )
    mesh.add_argument("--picture", type=OutputFile, metavar="PNG", help="also draw the mesh cut open, coloured by q")
    mesh.add_argument("--page", type=OutputFile, metavar="HTML", help="also write a page on the mesh for a browser")
    mesh.set_defaults(run=_mesh)

    table = commands.add_parser("stages", parents=[writes, line], help="run the line and tabulate what each stage does")
    table.add_argument("-o", "--output", type=OutputFile, metavar="TSV", help="also write the table there")
    table.set_defaults(run=_stages)

    gate = commands.add_parser("gate", parents=[common], help="say of each surface whether it can be meshed")
    gate.add_argument("surfaces", type=Path, nargs="+", metavar="SURFACE")
    gate.add_argument("--allow-genus", type=int, default=0, metavar="N", help="accept up to N handles")
    gate.set_defaults(run=_gate)

    repair = commands.add_parser("repair", parents=[writes], help="repair a broken surface, within limits")
    repair.add_argument("surface", type=Path, metavar="IN", help="GIfTI or FreeSurfer surface")
    repair.add_argument(
        "-o", "--output", type=OutputFile, required=True, metavar="OUT", help="GIfTI; the report is beside it"
    )
    repair.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section repair holds the limits")
    repair.add_argument("--picture", type=OutputFile, metavar="PNG", help="also draw it before and after")
    repair.add_argument(
        "--field", action="append", default=[], type=_named_file, metavar="NAME=FILE", help="per-vertex field, GIfTI"
    )
    repair.set_defaults(run=_repair)

    resample = commands.add_parser(
        "resample", parents=[writes], help="put a surface onto the common mesh, through its sphere"
    )
    resample.add_argument("surface", type=Path, metavar="IN", help="GIfTI or FreeSurfer surface")
    resample.add_argument("--sphere", type=Path, required=True, metavar="FILE", help="registered sphere of IN")
    resample.add_argument(
        "-o", "--output", type=OutputFile, required=True, metavar="OUT", help="GIfTI; the report is beside it"
    )
    resample.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section resample says onto what")
    resample.add_argument(
        "--field", action="append", default=[], type=_named_file, metavar="NAME=FILE", help="per-vertex field, GIfTI"
    )
    resample.set_defaults(run=_resample)

    quality = commands.add_parser("quality", parents=[common], help="measure the elements of a mesh (JSON)")
    quality.add_argument("mesh", type=Path, metavar="MESH")
    quality.set_defaults(run=_quality)

    limits = argparse.ArgumentParser(add_help=False)
    limits.add_argument("--q-max", type=float, metavar="Q", help="limit of the worst q (default: 0.6)")
    limits.add_argument(
        "--max-boundary-distance",
        type=float,
        metavar="MM",
        help="limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit)",
    )
    limits.add_argument(
        "--cell-size",
        type=float,
        metavar="MM",
        help="cell size h; the surface may be half of it from the boundary, and inner surfaces are moved away from it "
        "first, as for meshing (default: not known, no limit)",
    )

    certify = commands.add_parser(
        "certify", parents=[writes, within, limits], help="judge a mesh against the surface it was made from"
    )
    certify.add_argument("mesh", type=Path, metavar="MESH")
    certify.add_argument(
        "surface", type=Path, nargs="?", metavar="SURFACE", help="default: the surface that was meshed, by the sidecar"
    )
    certify.add_argument("-o", "--output", type=OutputFile, metavar="JSON", help="also write the certificate there")
    certify.set_defaults(run=_certify)

    compare = commands.add_parser(
        "compare", parents=[writes, limits], help="set meshes of one surface side by side, whatever made them"
    )
    compare.add_argument("meshes", type=Path, nargs="+", metavar="MESH")
    compare.add_argument(
        "--surface", type=Path, metavar="SURFACE", help="the surface they fill (default: by the sidecar of the first)"
    )
    compare.add_argument("-o", "--output", type=OutputFile, required=True, metavar="HTML", help="page for a browser")
    compare.add_argument("--table", type=OutputFile, metavar="TSV", help="also write the numbers there")
    compare.set_defaults(run=_compare)

    verify = commands.add_parser(
        "verify", parents=[common], help="check a solver file against its solver's conventions"
    )
    verify.add_argument("file", type=Path, metavar="FILE")
    verify.add_argument("--solver", choices=list(FORMATS), help="solver that will read it (default: by the suffix)")
    verify.set_defaults(run=_verify)

    convert = commands.add_parser("convert", parents=[writes], help="write a mesh file in another solver's format")
    convert.add_argument("source", type=Path, metavar="IN")
    convert.add_argument("target", type=OutputFile, metavar="OUT", help="its suffix says for which solver")
    convert.add_argument("--unit", choices=["mm", "um"], default="um", help="of a CARP file that is written")
    convert.add_argument("--source-unit", choices=["mm", "um"], default="um", help="of a CARP file without a sidecar")
    convert.set_defaults(run=_convert)

    quadratic = commands.add_parser(
        "quadratic", parents=[writes], help="write a mesh as ten-node tetrahedra, midside nodes on the surface"
    )
    quadratic.add_argument("mesh", type=Path, metavar="MESH")
    quadratic.add_argument(
        "surface", type=Path, nargs="?", metavar="SURFACE", help="default: the surface that was meshed, by the sidecar"
    )
    quadratic.add_argument(
        "--max-boundary-distance",
        type=float,
        default=1e-3,
        metavar="MM",
        help="limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit)",
    )
    quadratic.add_argument(
        "-o", "--output", type=OutputFile, required=True, metavar="OUT", help=".inp, .feb, .msh, .vtu or .xdmf"
    )
    quadratic.set_defaults(run=_quadratic)

    job = commands.add_parser("job", parents=[writes], help="write a folder in which a solver lets the cortex grow")
    job.add_argument("mesh", type=Path, metavar="MESH", help="with the sets that cortet exports")
    job.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    job.add_argument("--solver", choices=["calculix", "febio", "fenics"], default="calculix", help="default: calculix")
    job.add_argument("--growth", type=float, default=0.05, metavar="G", help="along the cortex (default: 0.05)")
    job.set_defaults(run=_job)

    picture = commands.add_parser("picture", parents=[writes], help="draw a mesh cut open, coloured by q")
    picture.add_argument("mesh", type=Path, metavar="MESH")
    picture.add_argument("-o", "--output", type=OutputFile, required=True, metavar="PNG")
    picture.set_defaults(run=_picture)

    fold = commands.add_parser("fold", parents=[writes], help="grow the cortex of a mesh until it folds")
    fold.add_argument("mesh", type=Path, metavar="MESH")
    fold.add_argument("-o", "--output", type=OutputFolder, required=True, metavar="DIR")
    fold.add_argument("--ga", type=_weeks, required=True, metavar="WEEKS", help="gestational age of the mesh")
    fold.add_argument("--hemi", choices=["L", "R"], help="half a brain, beside its other half")
    fold.add_argument("--end", type=float, metavar="WEEKS", help="gestational age at the end (default: 40)")
    fold.add_argument("--time-step", type=float, metavar="DT", help="dimensionless (default: from smallest altitude)")
    fold.add_argument("--device", choices=["cpu", "cuda"], help="what takes the steps: cuda is a GPU (default: cpu)")
    fold.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section fold says the rest")
    fold.add_argument("--threads", type=_count, metavar="N", help="default: one per core; the result is the same")
    fold.add_argument("--status", action=_FoldStatus, metavar="DIR", help="say how far the run in a folder is, and end")
    fold.set_defaults(run=_fold)

    phantom = commands.add_parser("phantom", parents=[writes], help="make a synthetic cortex of any gestational age")
    phantom.add_argument("--ga", type=_weeks, required=True, metavar="WEEKS", help="gestational age")
    phantom.add_argument("--hemi", choices=["L", "R"], default="L")
    phantom.add_argument("--subdivisions", type=int, default=5, metavar="N", help="of the icosahedron (default: 5)")
    phantom.add_argument("--seed", type=int, default=0, metavar="N", help="of the individual variation (default: 0)")
    phantom.add_argument("-o", "--output", type=OutputFile, required=True, metavar="GII")
    phantom.add_argument(
        "--pial",
        type=OutputFile,
        metavar="GII",
        help="write the synthetic cortex there, and to -o a white surface within it",
    )
    phantom.add_argument("--sphere", type=OutputFile, metavar="GII", help="also write the sphere that it was made of")
    phantom.add_argument(
        "--thickness", type=float, default=1.5, metavar="MM", help="of the cortex between the two (default: 1.5)"
    )
    phantom.set_defaults(run=_phantom)

    cohort = commands.add_parser("cohort", help="work on cohort sheets").add_subparsers(
        required=True, metavar="COMMAND"
    )
    scan = cohort.add_parser("scan", parents=[common], help="make a cohort sheet of a data release")
    scan.add_argument("folder", type=Path, metavar="DIR")
    scan.add_argument("-o", "--output", type=CheckedOutput, required=True, metavar="TSV")
    scan.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose cohort.scan says where surfaces are")
    existing = scan.add_mutually_exclusive_group()
    existing.add_argument("--update", action="store_true", help="add new cases to an existing sheet, keep its rows")
    existing.add_argument("--force", action="store_true", help="replace an existing sheet")
    scan.set_defaults(run=_scan)

    run = commands.add_parser("run", parents=[common], help="mesh the surfaces of a BIDS dataset (a BIDS App)")
    run.add_argument("bids_dir", type=Path, metavar="BIDS_DIR", help="dataset, or derivatives of one, with surfaces")
    run.add_argument("output_dir", type=CheckedOutput, metavar="OUTPUT_DIR", help="where the derivatives go")
    run.add_argument("level", choices=["participant", "group"], help="single cases, or tables and figures over all")
    for words, name, of in (
        (("--participant-label", "--participant_label"), "participants", "participants"),
        (("--session-label", "--session_label"), "sessions", "sessions"),
    ):
        run.add_argument(*words, dest=name, nargs="+", default=[], metavar="LABEL", help=f"only these {of}")
    run.add_argument("--hemi", choices=["L", "R"], help="only this hemisphere")
    run.add_argument("--cell-size", type=float, metavar="MM", help="cell size h (default: 0.6, or what --config says)")
    run.add_argument("--setting", choices=["default", "cgal", "published"], help="as of `cortet mesh`")
    run.add_argument("--config", type=Path, metavar="FILE", help="YAML file of parameters; see config.yaml")
    run.add_argument("--cores", type=int, metavar="N", help="default: all")
    run.add_argument("--profile", metavar="NAME", help="profile of Snakemake: slurm, or a folder")
    run.add_argument("-n", "--dry-run", action="store_true", help="say what would be done")
    run.add_argument(
        "-w",
        "--work-dir",
        type=CheckedOutput,
        metavar="DIR",
        help="cohort sheet, configuration and what Snakemake remembers",
    )
    run.set_defaults(run=_run)

    doctor = commands.add_parser("doctor", parents=[common], help="prove that everything needed is installed and works")
    doctor.set_defaults(run=_doctor)
    return top


def _mesh(args: argparse.Namespace) -> int:
    from cortet.formats.placement import placed
    from cortet.mesh import OUTERMOST
    from cortet.pipeline import mesh_surface
    from cortet.solver_files.export import export
    from cortet.solver_files.fields import field_sources
    from cortet.solver_files.meshed import made_from, meshed_files, require_own_stem, write_meshed
    from cortet.solver_files.sets import named_sets
    from cortet.solver_files.sidecar import sidecar_path

    # what cannot be written is refused before the work, and before anything of an earlier run is deleted
    solver = format_of(args.output).name
    record = args.output.with_suffix(".certificate.json")
    surfaces = meshed_files([OUTERMOST, *dict(args.inner)], args.output)
    for file in (record, sidecar_path(args.output), *surfaces.values()):
        may_write(file)
    given = {OUTERMOST: args.surface} | dict(args.inner)
    if not args.force:
        require_own_stem(args.output, given)
    config = _config(args)
    surface = _surface(args, config)
    sphere = _sphere(args)
    progress = Progress(config, args.ga, nested=bool(surface.inner), registered=sphere is not None)
    mesh, certificate, meshed = mesh_surface(
        surface,
        config,
        gestational_age=args.ga,
        source=args.surface,
        inner_sources=dict(args.inner),
        sphere=sphere,
        sphere_source=args.sphere,
        case=_stem(args.output),
        progress=progress,
    )
    delete_made(record)  # what an earlier run left must not pass for this run's
    delete_made(sidecar_path(args.output))
    with _recorded(asdict(certificate), record) as place:
        write_meshed(meshed, place(args.output))
    if certificate.certified:
        sources = field_sources(dict(args.field), config.export.field_units)
        labels = {name: field.labels for name, field in sources.items()}
        export(
            named_sets(mesh, **config.export.sets, label_names=labels, inner=list(meshed.inner)),
            args.output,
            solver=solver,
            certificate=asdict(certificate),
            unit=config.export.carp_unit,
            frame=surface.frame,
            sources=sources,
            interior=config.transfer.interior,
            made_from=made_from(surfaces, given, args.output.parent),
        )
    elif args.force:
        args.output.unlink(missing_ok=True)  # one of an earlier run would pass for this one
    with _recorded(asdict(certificate), record, surfaces.values()) as place:
        _mesh_views(args, mesh, meshed, placed(surface, config.placement()), asdict(certificate), config, place)
    print()
    _print_verdict(certificate)
    print(f"{record}: every number beside its limit")
    if certificate.certified:
        print(f"{args.output}: written, with the surface that was meshed: {surfaces[OUTERMOST].name}")
    else:
        print(f"{args.output}: not written")
    return 0 if certificate.certified else 1


def _mesh_views(
    args: argparse.Namespace,
    mesh: TetMesh,
    meshed: TriSurface,
    given: TriSurface,
    certificate: Mapping[str, Any],
    config: Config,
    place: Callable[[Path], Path],
) -> None:
    """The picture and the page of a mesh, where they are asked for; `place` says where they are written for now."""
    if args.picture:
        _draw(mesh, args.picture, place)
    if args.page:
        from cortet.report.case_page import about, write_case_page

        chosen = {"scan_age": args.ga, "cell_size": config.generate.cell_size[0], "mesher": config.generate.meshers[0]}
        write_case_page(mesh, given, certificate, place(args.page), meshed=meshed, facts=about(chosen))
        print(f"{args.page}: written")


@contextlib.contextmanager
def _recorded(
    content: Mapping[str, Any], record: Path, earlier: Iterable[Path] = ()
) -> Iterator[Callable[[Path], Path]]:
    """Write a report that lists the files made with it, so that another run may replace them, also after a kill.

    Yields where to write a file for now: those beside the report get their names after the report has its own.

    Parameters
    ----------
    earlier : further files beside the report that it lists
    """
    from cortet.formats.atomic import atomic_folder, write_json

    with atomic_folder(record) as folder:
        yield lambda file: folder / file.name if file.parent.absolute() == record.parent.absolute() else file
        write_json({**content, **record_of([*earlier, *sorted(folder.iterdir())])}, folder / record.name)


def _stages(args: argparse.Namespace) -> int:
    from cortet.formats.tables import write_table
    from cortet.pipeline import run
    from cortet.report.stage_table import STAGE_COLUMNS, measured_stages

    config = _config(args)
    surface = _surface(args, config)
    rows = []
    widths = [max(len(column.name) + 2, 12) for column in STAGE_COLUMNS]
    print("".join(f"{column.name:>{width}}" for column, width in zip(STAGE_COLUMNS, widths, strict=True)))
    line = run(
        surface,
        config,
        gestational_age=args.ga,
        source=args.surface,
        inner_sources=dict(args.inner),
        sphere=_sphere(args),
        sphere_source=args.sphere,
    )
    for row in measured_stages(line):
        values = (column.text(row) for column in STAGE_COLUMNS)
        print("".join(f"{value:>{width}}" for value, width in zip(values, widths, strict=True)), flush=True)
        rows.append(row)
    if args.output:
        write_table(STAGE_COLUMNS, rows, args.output)
    return 0


def _gate(args: argparse.Namespace) -> int:
    from cortet.formats.gifti import read_surface
    from cortet.stages.gate import gate

    refused = 0
    for path in args.surfaces:
        try:
            _, report = gate(read_surface(path), source=str(path), allow_genus=args.allow_genus)
        except CortetError as error:
            refused += 1
            print(f"refused   {error}{_repairable(path, args.allow_genus)}", flush=True)
        else:
            print(f"accepted  {path}: {_findings(report)}", flush=True)
    return 1 if refused else 0


def _repairable(path: Path, allow_genus: int) -> str:
    """What `cortet mesh` and `cortet repair` would make of a surface that the gate refuses, for the end of a line."""
    from cortet.config import load
    from cortet.formats.gifti import read_surface
    from cortet.stages.gate import gate
    from cortet.stages.repair import repair

    config = load({"gate": {"allow_genus": allow_genus}})
    logging.disable(logging.WARNING)  # nothing is repaired yet
    try:
        mended, _ = repair(read_surface(path, finite=False), **config.arguments("repair", {"source": str(path)}))
        gate(mended, source=str(path), allow_genus=allow_genus)
    except CortetError:
        return ""
    finally:
        logging.disable(logging.NOTSET)
    return f"; repairable: `cortet mesh` repairs it, and so does `cortet repair {path}`"


def _repair(args: argparse.Namespace) -> int:
    from cortet.config import load
    from cortet.formats.gifti import read_surface, write_surface
    from cortet.formats.placement import placed
    from cortet.geometry.mending import measurable
    from cortet.measure.lost import distances_to
    from cortet.solver_files.fields import with_fields
    from cortet.stages.repair import repair

    config = load(args.config or {})
    given = with_fields(read_surface(args.surface, finite=False), dict(args.field))
    given = placed(given, config.placement())
    made, report = repair(given, **config.arguments("repair", {"source": str(args.surface)}))
    record = args.output.with_name(f"{_stem(args.output)}.repair.json")
    with _recorded(asdict(report), record) as place:
        write_surface(made, place(args.output))
        if args.picture:
            from cortet.report.render import before_and_after

            file = measurable(given)
            before_and_after(file, made, distances_to(file, made)[len(made.points) :], place(args.picture))
    for step in report.steps:
        print(f"{step.count} {step.done}")
    if not report.repaired:
        print("nothing to repair")
    else:
        there, back = report.file_to_surface_mm, report.surface_to_file_mm
        print(f"{there.max:.3f} mm from the file to the surface at most, {back.max:.3f} mm back")
        print(f"volume {report.volume_ml:.2f} mL ({report.relative_volume_change:+.3%})")
    if args.picture:
        print(f"{args.picture}: drawn")
    print(f"{args.output}: written, with {record.name}")
    return 0


def _resample(args: argparse.Namespace) -> int:
    from cortet.config import load
    from cortet.formats.gifti import read_surface, write_surface
    from cortet.formats.placement import placed
    from cortet.solver_files.fields import with_fields
    from cortet.stages.resample import resample

    config = load(args.config or {})
    native = placed(with_fields(read_surface(args.surface), dict(args.field)), config.placement())
    facts = {"sphere_file": str(args.sphere), "hemisphere": None}
    made, report = resample(native, read_surface(args.sphere), **config.arguments("resample", facts))
    record = args.output.with_name(f"{_stem(args.output)}.resample.json")
    with _recorded(asdict(report), record) as place:
        write_surface(made, place(args.output))
    there, back = report.native_to_resampled_mm, report.resampled_to_native_mm
    print(f"{report.vertices} vertices instead of {report.vertices_before}")
    print(f"from the native surface {there.mean:.3f} mm on average, {there.max:.3f} mm at most; ", end="")
    print(f"back {back.mean:.3f} mm and {back.max:.3f} mm")
    if report.crossing_faces > report.crossing_faces_before:
        print(f"{report.crossing_faces} triangles cross others, {report.crossing_faces_before} did before")
    print(f"{args.output}: written, with {record.name}")
    return 0


def _quality(args: argparse.Namespace) -> int:
    from cortet.measure.quality import summarise

    print(json.dumps(asdict(summarise(_read_mesh(args.mesh))), indent=2, allow_nan=False))
    return 0


def _certify(args: argparse.Namespace) -> int:
    from cortet.config import Config
    from cortet.formats.atomic import write_json
    from cortet.solver_files.sets import with_regions
    from cortet.stages.separate import separate

    mesh, given = _read_mesh(args.mesh), args.surface
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
    _print_verdict(certificate)
    return 0 if certificate.certified else 1


def _filled_surface(mesh: Path, args: argparse.Namespace) -> TriSurface:
    """The surface that a mesh fills, with its inner ones: as they were meshed rather than as they were given."""
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
    chosen = {key: None if value == math.inf and key != "q_max" else value for key, value in given.items()}
    section = {key: value for key, value in chosen.items() if given[key] is not None}
    limits = load({"certify": section}).arguments("certify", {"cell_size": args.cell_size})
    return certify(mesh, surface, **limits, case=_stem(file), source=args.surface, parameters={"certify": limits})


def _compare(args: argparse.Namespace) -> int:
    from cortet.formats.tsv import write_tsv
    from cortet.report.comparison_page import comparison_rows, write_comparison_page

    names = _names_of(args.meshes)
    surface = _filled_surface(args.meshes[0], args)
    meshes = {name: _read_mesh(file) for name, file in names.items()}
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
    stems = [_stem(file) for file in files]
    names = {stem if stems.count(stem) == 1 else str(file): file for stem, file in zip(stems, files, strict=True)}
    if len(names) < len(files):
        raise InputError("a mesh is given twice", remedy="name each file once")
    return names


def _verify(args: argparse.Namespace) -> int:
    from cortet.solver_files.verify import verify

    solver = args.solver or format_of(args.file).name
    problems = verify(args.file, solver)
    for problem in problems:
        print(f"{args.file}: {problem}")
    if not problems:
        print(f"{args.file}: keeps every convention of {solver}")
    return 1 if problems else 0


def _convert(args: argparse.Namespace) -> int:
    from cortet.solver_files.export import convert

    for change in convert(args.source, args.target, unit=args.unit, source_unit=args.source_unit):
        print(f"{args.target}: {change}")
    print(f"{args.target}: written and verified")
    return 0


def _quadratic(args: argparse.Namespace) -> int:
    from cortet.geometry.quadratic import quadratic
    from cortet.solver_files.ten_nodes import write_ten_nodes

    mesh = _read_mesh(args.mesh)
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


def _job(args: argparse.Namespace) -> int:
    from importlib import import_module

    module, run = {
        "calculix": ("calculix", "ccx job"),
        "febio": ("febio_job", "febio4 -i job.feb"),
        "fenics": ("fenics_job", "python3 job.py"),
    }[args.solver]
    import_module(f"cortet.solver_files.{module}").write_job(_read_mesh(args.mesh), args.output, growth=args.growth)
    print(f"{args.output}: written; run `{run}` in it")
    return 0


def _picture(args: argparse.Namespace) -> int:
    _draw(_read_mesh(args.mesh), args.output)
    return 0


class _FoldStatus(argparse.Action):
    """Says how far a run has come; no mesh is needed then."""

    def __call__(self, parser: argparse.ArgumentParser, _: object, folder: object, *__: object) -> None:
        """Print it and end the program."""
        from cortet.simulation.progress import reached

        try:
            print(reached(Path(str(folder))))
        except CortetError as error:
            parser.error(str(error))
        parser.exit()


def _fold(args: argparse.Namespace) -> int:
    from numba import get_num_threads, set_num_threads

    from cortet.config import load, read
    from cortet.report.fold_figures import draw
    from cortet.simulation.fold import fold
    from cortet.simulation.progress import status
    from cortet.simulation.state import Settings
    from cortet.solver_files.sidecar import read_sidecar

    known = read_sidecar(args.mesh).get("made_from", {}).get("hemisphere")
    if args.hemi and known and args.hemi != known:
        raise InputError(
            f"was made from a surface of hemisphere {known}, as that says, not {args.hemi}",
            file=args.mesh,
            remedy=f"use --hemi {known}",
        )
    if args.threads:
        set_num_threads(min(args.threads, get_num_threads()))
    chosen = {"end": args.end, "time_step": args.time_step, "device": args.device}
    data: dict[str, Any] = {}
    if args.config:
        load(args.config)  # complaints name the file
        data = read(args.config)
    data["fold"] = {**(data.get("fold") or {}), **{key: value for key, value in chosen.items() if value is not None}}
    values = load(data).arguments("fold", {"gestational_age": args.ga, "hemisphere": args.hemi})
    live = sys.stdout.isatty()
    verdict = fold(
        _read_mesh(args.mesh),
        args.output,
        Settings(**values),
        lambda *progress: print(
            f"\r{status(*progress)}" if live else status(*progress), end="" if live else "\n", flush=True
        ),
        print,
    )
    print(f"\n{verdict.reason}")
    for path in draw(args.output, args.hemi):
        print(f"{path}: drawn")
    return 0 if verdict.outcome == "folded" else 1


def _phantom(args: argparse.Namespace) -> int:
    from cortet.formats.gifti import write_surface
    from cortet.phantom import inset, phantom_with_sphere

    surface, sphere = phantom_with_sphere(args.ga, hemisphere=args.hemi, subdivisions=args.subdivisions, seed=args.seed)
    if args.sphere:
        write_surface(sphere, args.sphere)
    if args.pial:
        write_surface(surface, args.pial)
        print(f"{args.pial}: {len(surface.points)} vertices, {len(surface.faces)} faces")
        surface = inset(surface, args.thickness)
    write_surface(surface, args.output)
    print(f"{args.output}: {len(surface.points)} vertices, {len(surface.faces)} faces")
    return 0


def _scan(args: argparse.Namespace) -> int:
    from cortet.cohort.sheet import add_to_sheet, ageless_notice, read_header, scan, write_sheet
    from cortet.config import load

    exists = args.output.exists()
    if exists and not (args.update or args.force):
        raise InputError(
            "exists already, and may have been edited",
            file=args.output,
            remedy="add --update to append new cases to it, --force to replace it, or give another name",
        )
    if exists:
        read_header(args.output)  # no other table is replaced, whatever is forced
    cases = scan(args.folder, load(args.config).cohort.scan if args.config else None, print)
    if exists and args.update:
        found, cases = len(cases), add_to_sheet(cases, args.output)
        print(f"{args.output}: {found} surfaces, {len(cases)} of them new and added")
    else:
        write_sheet(cases, args.output)
        print(f"{args.output}: {len(cases)} surfaces")
    for notice in ageless_notice(cases):
        print(f"  {notice}")
    return 0


def _run(args: argparse.Namespace) -> int:
    import time

    from cortet.cohort import app
    from cortet.cohort.sheet import ageless_notice

    began = time.time()
    settings, selection = _settings(args), app.Selection(args.participants, args.sessions, args.hemi)
    cases = app.find(args.bids_dir, selection, settings, print)
    print(f"{len(cases)} surfaces of {args.bids_dir}", flush=True)
    for notice in ageless_notice(cases):
        print(f"  {notice}", flush=True)
    with app.lock(args.bids_dir, args.output_dir):
        work = args.work_dir or app.work_folder(args.output_dir)
        app.prepare(cases, args.bids_dir, args.output_dir, work, settings)
        code = app.snakemake(
            work, args.level, cores=args.cores or os.cpu_count() or 1, profile=args.profile, dry_run=args.dry_run
        )
    for line in app.failures(args.output_dir, began):
        print(line, file=sys.stderr)
    if not code and not args.dry_run:
        print(f"{args.output_dir}: done")
    return int(code != 0)


def _doctor(_: argparse.Namespace) -> int:
    from cortet import doctor

    return doctor.run()


class Progress:
    """A table on the terminal that grows by a row for every stage, and names the one that is running."""

    HEAD = ("stage", "seconds", "nodes", "tets", "mean q", "q_max", "q > 0.6")

    def __init__(self, config: Config, gestational_age: float | None, *, nested: bool, registered: bool) -> None:
        from cortet.pipeline import stages

        self.live = sys.stdout.isatty()
        self.waiting = stages(config, gestational_age=gestational_age, nested=nested, registered=registered)
        print(self._row(self.HEAD))
        self._announce()

    def __call__(self, step: Step) -> None:
        """Print the row of a stage that has run."""
        row = self._row((step.stage, f"{step.seconds:.1f}", *self._numbers(step.result)))
        print(f"\r{row}" if self.live else row, flush=True)
        self.waiting.remove(step.stage)
        self._announce()

    def _announce(self) -> None:
        if self.live:
            print(f"{self.waiting[0] if self.waiting else 'certify'} ...".ljust(40), end="", flush=True)

    @staticmethod
    def _numbers(result: TriSurface | TetMesh) -> Iterable[str]:
        from cortet.measure.quality import quality
        from cortet.mesh import TetMesh

        if not isinstance(result, TetMesh):
            return str(len(result.points)), "", "", "", ""
        q = quality(result.points, result.cells)
        return str(len(result.points)), str(len(q)), f"{q.mean():.4f}", f"{q.max():.4f}", str(int((q > 0.6).sum()))

    @staticmethod
    def _row(cells: Iterable[str]) -> str:
        name, *numbers = cells
        return f"{name:<16}" + "".join(f"{number:>10}" for number in numbers)


def _findings(report: GateReport) -> str:
    """What the gate found and mended, in one line."""
    mended = (
        (report.unused_vertices_dropped, "unused vertices dropped"),
        (report.faces_reoriented, "faces turned outward"),
        (
            report.crossing_faces_repaired,
            f"crossing faces pulled apart, moving {report.repair_moved_vertices} vertices by up to "
            f"{report.repair_max_displacement_mm:.3f} mm",
        ),
    )
    size = f"{report.vertices} vertices, {report.volume_ml:.1f} mL, {report.area_mm2:.0f} mm2"
    return "; ".join([size, *(f"{count} {what}" for count, what in mended if count)])


def _print_verdict(certificate: Certificate) -> None:
    print("certified" if certificate.certified else "NOT certified:")
    for reason in certificate.reasons:
        print(f"  {reason}")


def _config(args: argparse.Namespace) -> Config:
    """The configuration of a file, with the options of the command on top."""
    from cortet.config import load

    return load(_settings(args))


def _settings(args: argparse.Namespace) -> dict[str, Any]:
    """The sections of a configuration file, with the options of the command on top."""
    from cortet.config import load, read

    data: dict[str, Any] = {}
    if args.config:
        load(args.config)  # complaints name the file
        data = read(args.config)
    if args.setting:
        data["setting"] = args.setting
    if args.cell_size is not None:
        data["generate"] = {**(data.get("generate") or {}), "cell_size": args.cell_size}
    return data


def _surface(args: argparse.Namespace, config: Config) -> TriSurface:
    from cortet.formats.gifti import read_surface
    from cortet.geometry.nesting import nested
    from cortet.solver_files.fields import with_fields

    finite = not config.enabled("repair")
    surface = with_fields(read_surface(args.surface, finite=finite), dict(args.field))
    return nested(surface, _inner_surfaces(dict(args.inner), finite=finite))


def _sphere(args: argparse.Namespace) -> TriSurface | None:
    from cortet.formats.gifti import read_surface

    return read_surface(args.sphere) if args.sphere else None


def _weeks(text: str) -> float:
    """A gestational age; which ages a command takes, it says itself."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is no age in weeks")
    return value


def _count(text: str) -> int:
    if not (text.isdecimal() and int(text)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 on")
    return int(text)


def _named_file(text: str) -> tuple[str, str]:
    name, equals, file = text.partition("=")
    if not (name and equals and file):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FILE")
    return name, file


def _inner_file(text: str) -> tuple[str, str]:
    from cortet.mesh import OUTERMOST

    name, equals, file = text.rpartition("=")
    if not equals:
        return "white", text
    if not (re.fullmatch("[A-Za-z][A-Za-z0-9]*", name) and file) or name == OUTERMOST:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME=FILE, NAME of letters and digits, other than {OUTERMOST}"
        )
    return name, file


def _inner_surfaces(files: Mapping[str, str], *, finite: bool = True) -> dict[str, TriSurface]:
    from cortet.formats.gifti import read_surface

    return {name: read_surface(file, finite=finite) for name, file in files.items()}


def _stem(path: Path) -> str:
    return path.name.removesuffix(path.suffix)


def _read_mesh(path: Path) -> TetMesh:
    form = format_of(path)
    if form.is_surface:
        raise InputError("holds a surface, not a mesh", file=path)
    return form.read(path)


def _draw(mesh: TetMesh, path: Path, place: Callable[[Path], Path] = lambda path: path) -> None:
    from cortet.report.render import picture

    picture(mesh, place(path))
    print(f"{path}: drawn")


if __name__ == "__main__":
    sys.exit(main())
