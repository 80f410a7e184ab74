"""The command `growth`: how much each spot of a surface has grown by a later age."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cli.given import stem_of
from cortet.cli.shared import writes
from cortet.cli.values import Number, OutputFile, output_picture
from cortet.errors import InputError
from cortet.formats.atomic import recorded
from cortet.formats.ownership import may_write
from cortet.geometry.limits import FOLD_AGES


def add_commands(commands: Commands) -> None:
    """Add `growth`."""
    growth = commands.add_parser(
        "growth", parents=[writes()], help="measure how much each spot of a surface has grown until a later age"
    )
    growth.add_argument("early", type=Path, metavar="EARLY", help="surface, GIfTI")
    growth.add_argument("later", type=Path, metavar="LATER", help="surface whose vertices correspond to those of EARLY")
    growth.add_argument(
        "--ages", type=Number(*FOLD_AGES), nargs=2, required=True, metavar="WEEKS", help="gestational ages of the two"
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


if TYPE_CHECKING:
    from cortet.cli.shared import Commands


def growth_command(args: argparse.Namespace) -> int:
    """Measure growth between two surfaces and write it as fields of the early one."""
    from cortet.formats.gifti import read_surface, write_fields
    from cortet.measure.surface_growth import measured, through_spheres
    from cortet.simulation.fields import growth_field

    start, end = args.ages
    if not start < end:
        raise InputError(f"the later age, {end:g} weeks, is not after the early one, {start:g}", remedy="give both")
    if args.output.suffix != ".gii":
        raise InputError("is no name of a GIfTI file", file=args.output, remedy="end it in .func.gii")
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
