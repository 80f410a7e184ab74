"""The commands `fold`, `growth` and `job`: a mesh folds, a surface has grown, a solver lets the cortex grow."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.cli.given import read_mesh, stem_of
from cortet.cli.shared import writes
from cortet.cli.values import FolderOfFiles, Number, OutputFile, output_picture
from cortet.errors import CortetError, InputError
from cortet.folding import AGES
from cortet.formats.atomic import recorded
from cortet.formats.ownership import may_write


def add_commands(commands: Commands) -> None:
    """Add `fold`, `growth` and `job`."""
    fold = commands.add_parser("fold", parents=[writes()], help="grow the cortex of a mesh until it folds")
    fold.add_argument("mesh", type=Path, metavar="MESH")
    fold.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    fold.add_argument(
        "--ga",
        type=Number(*AGES),
        metavar="WEEKS",
        help="gestational age of the mesh (default: the one it was made for)",
    )
    fold.add_argument(
        "--hemi", choices=["L", "R"], help="half a brain, beside its other half (default: as its surface said)"
    )
    fold.add_argument("--end", type=Number(*AGES), metavar="WEEKS", help="gestational age at the end (default: 40)")
    fold.add_argument(
        "--time-step", type=Number(0, 1), metavar="DT", help="dimensionless (default: from smallest altitude)"
    )
    fold.add_argument(
        "--real",
        action="append",
        default=[],
        type=aged_file,
        metavar="WEEKS=FILE",
        help="surface of a real brain of this age, shown beside the simulated one; repeatable",
    )
    fold.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section fold says the rest")
    fold.add_argument(
        "--threads",
        type=Number(1, 10_000, whole=True),
        metavar="N",
        help="default: one per core; the result is the same",
    )
    fold.add_argument("--status", action=_FoldStatus, metavar="DIR", help="say how far the run in a folder is, and end")
    fold.set_defaults(run=fold_command)

    growth = commands.add_parser(
        "growth", parents=[writes()], help="measure how much each spot of a surface has grown until a later age"
    )
    growth.add_argument("early", type=Path, metavar="EARLY", help="surface, GIfTI")
    growth.add_argument("later", type=Path, metavar="LATER", help="surface whose vertices correspond to those of EARLY")
    growth.add_argument(
        "--ages", type=Number(*AGES), nargs=2, required=True, metavar="WEEKS", help="gestational ages of the two"
    )
    growth.add_argument(
        "--spheres",
        type=Path,
        nargs=2,
        metavar="GII",
        help="registered spheres of EARLY and LATER, through which their vertices correspond",
    )
    growth.add_argument(
        "--smooth",
        type=Number(0, 50),
        metavar="MM",
        help="full width at half maximum of the smoothing along the surface (default: as much as noise asks for)",
    )
    growth.add_argument("--picture", type=output_picture, metavar="PNG", help="also draw the ratio of the areas")
    growth.add_argument(
        "-o",
        "--output",
        type=OutputFile,
        required=True,
        metavar="GII",
        help="growth, six numbers per vertex: .func.gii",
    )
    growth.set_defaults(run=growth_command)

    job = commands.add_parser("job", parents=[writes()], help="write a folder in which a solver lets the cortex grow")
    job.add_argument("mesh", type=Path, metavar="MESH", help="with the sets that cortet exports")
    job.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    job.add_argument("--solver", choices=["calculix", "febio", "fenics"], default="calculix", help="default: calculix")
    job.add_argument("--growth", type=Number(0, 1), default=0.05, metavar="G", help="along the cortex (default: 0.05)")
    job.add_argument(
        "--material",
        action="append",
        default=[],
        type=moduli,
        metavar="SET=SHEAR[,BULK]",
        help="moduli of a set of tetrahedra, in units of the cortex's shear modulus; repeatable, and the last one "
        "counts where sets overlap; CalculiX and FEniCS",
    )
    job.add_argument(
        "--ten-nodes",
        type=Path,
        metavar="SURFACE",
        dest="surface",
        help="elements of ten nodes that follow this surface, from which the mesh was made (CalculiX only)",
    )
    job.set_defaults(run=job_command, inner=[])


if TYPE_CHECKING:
    from cortet.cli.shared import Commands


def fold_command(args: argparse.Namespace) -> int:
    """Fold a mesh."""
    from numba import get_num_threads, set_num_threads

    from cortet.config import load, read
    from cortet.folding.fold import fold
    from cortet.folding.fold_figures import FILM, NUMBERS, PICTURE, draw
    from cortet.folding.journal import FILES, status
    from cortet.folding.plausible import brain_of
    from cortet.folding.section import Settings
    from cortet.formats.gifti import hemisphere_of, read_surface

    mesh = read_mesh(args.mesh, whole=True)
    age, hemi = brain_of(args.mesh, args.ga, args.hemi)
    if age is None:
        raise InputError("does not say for which gestational age it was made", file=args.mesh, remedy="add --ga WEEKS")
    for name in (*FILES, NUMBERS, PICTURE, FILM):  # before the work
        may_write(args.output / name)
    if args.threads:
        set_num_threads(min(args.threads, get_num_threads()))
    chosen = {"end": args.end, "time_step": args.time_step}
    data: dict[str, Any] = {}
    if args.config:
        load(args.config)  # its errors name the file
        data = read(args.config)
    data["fold"] = {**(data.get("fold") or {}), **{key: value for key, value in chosen.items() if value is not None}}
    if args.real:
        data["fold"]["real_surfaces"] = (data["fold"].get("real_surfaces") or {}) | dict(args.real)
    config = load(data)
    values = config.arguments("fold", {"gestational_age": age, "hemisphere": hemi})
    real = config.fold.real_surfaces_of(hemi)
    for path in real.values():  # before the work
        read_surface(path)
        if hemi and (named := hemisphere_of(path)) not in (None, hemi):
            raise InputError(
                f"is of hemisphere {named}, as it says, not {hemi}",
                file=path,
                remedy="name the surface of the same hemisphere",
            )
    live = sys.stdout.isatty()
    verdict = fold(
        mesh,
        args.output,
        Settings(**values),
        lambda *progress: print(
            f"\r{status(*progress)}" if live else status(*progress), end="" if live else "\n", flush=True
        ),
        print,
    )
    print(f"\n{verdict.reason}")
    for path in draw(args.output, hemi, real):
        print(f"{path}: drawn")
    return 0 if verdict.outcome == "folded" else 1


class _FoldStatus(argparse.Action):
    """Prints how far a run has come, which needs no mesh."""

    def __call__(self, parser: argparse.ArgumentParser, _: object, folder: object, *__: object) -> None:
        """Print the status and end the program."""
        from cortet.folding.journal import reached

        try:
            print(reached(Path(str(folder))))
        except CortetError as error:
            parser.error(str(error))
        parser.exit()


def growth_command(args: argparse.Namespace) -> int:
    """Measure growth between two surfaces and write it as fields of the early one."""
    from cortet.folding.fields import growth_field
    from cortet.folding.surface_growth import measured, through_spheres
    from cortet.formats.gifti import read_surface, write_fields

    start, end = args.ages
    if not start < end:
        raise InputError(f"the later age, {end:g} weeks, is not after the early one, {start:g}", remedy="give both")
    if args.output.suffix != ".gii":
        raise InputError("is not the name of a GIfTI file", file=args.output, remedy="end it in .func.gii")
    stem = stem_of(args.output).removesuffix(".func").removesuffix(".shape")
    metrics, record = (args.output.with_name(f"{stem}{ending}") for ending in (".shape.gii", ".growth.json"))
    for path in (metrics, record):
        may_write(path)
    early, later = read_surface(args.early), read_surface(args.later)
    if args.spheres:
        own, other = (read_surface(sphere) for sphere in args.spheres)
        later = through_spheres(later, other, own)
    found = measured(early, later, args.smooth)
    report = {
        "early": {"file": str(args.early), "gestational_age_weeks": start},
        "later": {"file": str(args.later), "gestational_age_weeks": end},
        "correspondence": "registered spheres" if args.spheres else "numbers of the vertices",
        "smoothing_mm": found.width_mm,
        "area_ratio": found.area_ratio,
        "volume_ratio": found.volume_ratio,
        "area_ratio_percentiles": found.percentiles,
        "fields": {
            growth_field(end): "logarithm of the stretch along the surface: xx, yy, zz, xy, xz, yz",
            "area_ratio": "later over early area",
            "stretch_largest, stretch_smallest": "principal stretches along the surface",
            "beyond_the_whole": "stretch of the square root of the area over that of the cube root of the volume",
        },
    }
    with recorded(report, record) as place:
        write_fields({growth_field(end): found.tensors}, place(args.output))
        write_fields(found.metrics, place(metrics))
        if args.picture:
            from cortet.report.cohort_maps import maps_figure
            from cortet.report.figures import save

            shown = {"area ratio": found.metrics["area_ratio"]}
            save(maps_figure(replace(early, point_data=shown)), place(args.picture))
    low, middle, high = (found.percentiles[key] for key in ("5", "50", "95"))
    print(f"from {start:g} to {end:g} weeks the area grows by {found.area_ratio:.3f}, the volume by ", end="")
    print(f"{found.volume_ratio:.3f}; a spot by {middle:.2f}, of nine in ten by {low:.2f} to {high:.2f}")
    print(f"smoothed along the surface over {found.width_mm:.1f} mm (full width at half maximum)")
    print(f"{args.output}: written, with {metrics.name} and {record.name}; a mesh takes it with ", end="")
    print(f"--field {growth_field(end)}={args.output}")
    return 0


def job_command(args: argparse.Namespace) -> int:
    """Write a job for a solver."""
    from importlib import import_module

    from cortet.cli.meshes import filled_surface
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
        more["curved"] = quadratic(mesh, filled_surface(args.mesh, args))
    if args.material:
        if args.solver == "febio":
            raise InputError("--material is not for febio", remedy="use another solver, or edit <Material> in job.feb")
        more["moduli"] = dict(args.material)
    import_module(f"cortet.folding.{module}").write_job(mesh, args.output, growth=args.growth, **more)
    print(f"{args.output}: written; run `{run}` in it")
    return 0


def aged_file(text: str) -> tuple[float, str]:
    """WEEKS=FILE."""
    age, equals, file = text.partition("=")
    if not (equals and file):
        raise argparse.ArgumentTypeError(f"{text!r} is not WEEKS=FILE")
    return Number(*AGES)(age), file


def moduli(text: str) -> tuple[str, tuple[float, float | None]]:
    """SET=SHEAR[,BULK]."""
    name, equals, values = text.rpartition("=")
    shear, comma, bulk = values.partition(",")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not SET=SHEAR or SET=SHEAR,BULK")
    number = Number(1e-9, 1e9)
    return name, (number(shear), number(bulk) if comma else None)
