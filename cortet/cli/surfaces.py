"""Commands on surfaces: `gate`, `repair`, `resample`, `phantom`, `head`, `envelope`, `labels`."""

from __future__ import annotations

import argparse
import logging
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.cli.given import stem_of
from cortet.cli.shared import common, writes
from cortet.cli.values import FolderOfFiles, Number, named_file, output_picture, output_surface
from cortet.errors import CortetError
from cortet.formats.atomic import recorded
from cortet.formats.ownership import may_write
from cortet.geometry.limits import CLOSING_MM, PHANTOM_AGES, SHELL_MM, SUBDIVISIONS, THICKNESS_MM

if TYPE_CHECKING:
    from cortet.cli.shared import Commands
    from cortet.config import Config
    from cortet.stages.gate import GateReport


def add_commands(commands: Commands) -> None:
    """Add the commands on surfaces."""
    gate = commands.add_parser("gate", parents=[common()], help="say of each surface whether it can be meshed")
    gate.add_argument("surfaces", type=Path, nargs="+", metavar="SURFACE")
    gate.add_argument(
        "--allow-genus", type=Number(0, 10_000, whole=True), default=0, metavar="N", help="accept up to N handles"
    )
    gate.set_defaults(run=gate_command)

    repair = commands.add_parser("repair", parents=[writes()], help="repair a broken surface, within limits")
    repair.add_argument("surface", type=Path, metavar="IN", help="GIfTI or FreeSurfer surface")
    repair.add_argument(
        "-o", "--output", type=output_surface, required=True, metavar="OUT", help="GIfTI; the report is beside it"
    )
    repair.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section repair holds the limits")
    repair.add_argument("--picture", type=output_picture, metavar="PNG", help="also draw it before and after")
    repair.add_argument(
        "--field", action="append", default=[], type=named_file, metavar="NAME=FILE", help="per-vertex field, GIfTI"
    )
    repair.set_defaults(run=repair_command)

    resample = commands.add_parser(
        "resample", parents=[writes()], help="put a surface onto the common mesh, through its sphere"
    )
    resample.add_argument("surface", type=Path, metavar="IN", help="GIfTI or FreeSurfer surface")
    resample.add_argument("--sphere", type=Path, required=True, metavar="FILE", help="registered sphere of IN")
    resample.add_argument(
        "-o", "--output", type=output_surface, required=True, metavar="OUT", help="GIfTI; the report is beside it"
    )
    resample.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose section resample says onto what")
    resample.add_argument(
        "--field", action="append", default=[], type=named_file, metavar="NAME=FILE", help="per-vertex field, GIfTI"
    )
    resample.set_defaults(run=resample_command)

    around = commands.add_parser(
        "envelope", parents=[writes()], help="make a smooth closed surface around one or several others"
    )
    around.add_argument("surfaces", type=Path, nargs="+", metavar="SURFACE", help="closed surfaces of one head, mm")
    around.add_argument(
        "--distance",
        type=Number(*SHELL_MM),
        default=2.0,
        metavar="MM",
        help="from the surfaces, at least (default: 2)",
    )
    around.add_argument(
        "--closing",
        type=Number(*SHELL_MM),
        default=CLOSING_MM,
        metavar="MM",
        help=f"half the width of the grooves that lie inside of it (default: {CLOSING_MM:g})",
    )
    around.add_argument("-o", "--output", type=output_surface, required=True, metavar="GII")
    around.set_defaults(run=envelope_command)

    labels = commands.add_parser(
        "labels",
        parents=[writes()],
        help="make a closed surface around labels of a volume, without the steps of voxels",
    )
    labels.add_argument("labels", metavar="VOLUME:LABELS", help="NIfTI or MGZ, and labels: dseg.nii.gz:3,4")
    labels.add_argument(
        "--handles",
        type=Number(0, 10_000, whole=True),
        default=0,
        metavar="N",
        help="so many may stay; where there are more, they are cut or closed on the voxels (default: 0)",
    )
    labels.add_argument(
        "-o",
        "--output",
        type=output_surface,
        required=True,
        metavar="GII",
        help="of several components, NAME1.surf.gii and so on, the largest first",
    )
    labels.set_defaults(run=labels_command)

    made = argparse.ArgumentParser(add_help=False)
    made.add_argument("--ga", type=Number(*PHANTOM_AGES), required=True, metavar="WEEKS", help="gestational age")
    made.add_argument(
        "--subdivisions",
        type=Number(*SUBDIVISIONS, whole=True),
        default=5,
        metavar="N",
        help="of the icosahedron (default: 5)",
    )
    made.add_argument(
        "--seed",
        type=Number(0, 2**32 - 1, whole=True),
        default=0,
        metavar="N",
        help="of the individual variation (default: 0)",
    )
    phantom = commands.add_parser(
        "phantom", parents=[writes(), made], help="make a synthetic cortex of any gestational age"
    )
    phantom.add_argument("--hemi", choices=["L", "R"], default="L")
    phantom.add_argument("-o", "--output", type=output_surface, required=True, metavar="GII")
    phantom.add_argument(
        "--pial",
        type=output_surface,
        metavar="GII",
        help="write the synthetic cortex there, and to -o a white surface within it",
    )
    phantom.add_argument(
        "--sphere", type=output_surface, metavar="GII", help="also write the sphere that it was made of"
    )
    phantom.add_argument(
        "--thickness",
        type=Number(*THICKNESS_MM),
        default=1.5,
        metavar="MM",
        help="of the cortex between the two (default: 1.5)",
    )
    phantom.set_defaults(run=phantom_command)

    head = commands.add_parser(
        "head",
        parents=[writes(), made],
        help="make a synthetic hemisphere with ventricles, a thalamus and volumes of them",
    )
    head.add_argument(
        "--voxel", type=Number(0.1, 5), default=0.5, metavar="MM", help="width of the voxels (default: 0.5)"
    )
    head.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    head.set_defaults(run=head_command)


def gate_command(args: argparse.Namespace) -> int:
    """Print whether a surface can be meshed."""
    from cortet.config import load
    from cortet.formats.gifti import read_surface
    from cortet.stages.gate import gate

    config, refused = load({"gate": {"allow_genus": args.allow_genus}}), 0
    for path in args.surfaces:
        try:
            _, report = gate(read_surface(path), config.gate, source=str(path))
        except CortetError as error:
            refused += 1
            print(f"refused   {error}{_repairable(path, config)}", flush=True)
        else:
            print(f"accepted  {path}: {_findings(report)}", flush=True)
    return 1 if refused else 0


def _repairable(path: Path, config: Config) -> str:
    """How `cortet mesh` and `cortet repair` would repair a surface that the gate refuses, for the end of a line."""
    from cortet.formats.gifti import read_surface
    from cortet.stages import STAGES

    logging.disable(logging.WARNING)  # because nothing is repaired yet
    try:
        surface = read_surface(path, finite=False)
        for stage in ("repair", "gate"):
            surface, _ = STAGES[stage].run(surface, **config.arguments(stage, {"source": str(path)}))
    except CortetError:
        return ""
    finally:
        logging.disable(logging.NOTSET)
    return f"; repairable: `cortet mesh` repairs it, and so does `cortet repair {path}`"


def repair_command(args: argparse.Namespace) -> int:
    """Repair a surface and write it with its report."""
    from cortet.config import load
    from cortet.formats.gifti import read_surface, write_surface
    from cortet.formats.placement import placed
    from cortet.geometry.mending import measurable
    from cortet.measure.lost import distances_to
    from cortet.solver_files.fields import with_fields
    from cortet.stages.repair import repair

    record = args.output.with_name(f"{stem_of(args.output)}.repair.json")
    may_write(record)
    config = load(args.config or {})
    given = with_fields(read_surface(args.surface, finite=False), dict(args.field))
    given = placed(given, config.placement())
    made, report = repair(given, config.repair, source=str(args.surface), allow_genus=config.gate.allow_genus)
    with recorded(asdict(report), record) as place:
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


def resample_command(args: argparse.Namespace) -> int:
    """Resample a surface to the common mesh and write it with its report."""
    from cortet.config import load
    from cortet.formats.gifti import read_surface, write_surface
    from cortet.formats.placement import placed
    from cortet.solver_files.fields import with_fields
    from cortet.stages import STAGES

    record = args.output.with_name(f"{stem_of(args.output)}.resample.json")
    may_write(record)
    config = load(args.config or {})
    native = placed(with_fields(read_surface(args.surface), dict(args.field)), config.placement())
    facts = {"sphere_file": str(args.sphere), "hemisphere": None}
    made, report = STAGES["resample"].run(native, read_surface(args.sphere), **config.arguments("resample", facts))
    with recorded(asdict(report), record) as place:
        write_surface(made, place(args.output))
    there, back = report.native_to_resampled_mm, report.resampled_to_native_mm
    print(f"{report.vertices} vertices instead of {report.vertices_before}")
    print(f"from the native surface {there.mean:.3f} mm on average, {there.max:.3f} mm at most; ", end="")
    print(f"back {back.mean:.3f} mm and {back.max:.3f} mm")
    if report.crossing_faces > report.crossing_faces_before:
        print(f"{report.crossing_faces} triangles cross others, {report.crossing_faces_before} did before")
    print(f"{args.output}: written, with {record.name}")
    return 0


def phantom_command(args: argparse.Namespace) -> int:
    """Write a synthetic cortex."""
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


def head_command(args: argparse.Namespace) -> int:
    """Write a phantom head: surfaces, volumes, and the size of each part."""
    from cortet.formats.gifti import write_surface
    from cortet.formats.tsv import write_tsv
    from cortet.formats.volumes import write_volume
    from cortet.phantom.head import LABELS, head

    files = {name: args.output / f"{'pial' if name == 'cortex' else name}.surf.gii" for name in LABELS}
    files |= {name: args.output / name for name in ("dseg.nii.gz", "dseg.tsv", "tensors.nii.gz", "sizes.tsv")}
    for file in files.values():
        may_write(file)
    made = head(args.ga, subdivisions=args.subdivisions, seed=args.seed, voxel=args.voxel)
    args.output.mkdir(parents=True, exist_ok=True)
    for name, surface in made.surfaces.items():
        write_surface(surface, files[name])
    write_volume(made.labels, made.affine, files["dseg.nii.gz"])
    write_volume(made.tensors, made.affine, files["tensors.nii.gz"])
    write_tsv([{"index": key, "name": name} for name, key in LABELS.items()], ["index", "name"], files["dseg.tsv"])
    sizes = [{"name": name, "volume_ml": round(made.volumes[name] / 1000, 6)} for name in LABELS]
    write_tsv(sizes, ["name", "volume_ml"], files["sizes.tsv"])
    for row in sizes:
        print(f"{row['name']:<12}{row['volume_ml']:>8.3f} mL")
    print(f"{args.output}: written: {', '.join(file.name for file in files.values())}")
    return 0


def envelope_command(args: argparse.Namespace) -> int:
    """Write a smooth closed surface around others."""
    from cortet.formats.gifti import read_surface, write_surface
    from cortet.geometry.envelope import envelope
    from cortet.geometry.topology import enclosed_volume

    given = [read_surface(file) for file in args.surfaces]
    made = envelope(given, args.distance, closing=args.closing)
    write_surface(replace(made, frame=given[0].frame), args.output)
    volume = enclosed_volume(made.points, made.faces) / 1000
    print(f"{args.output}: {len(made.points)} vertices, {volume:.1f} mL, at least {args.distance:g} mm away")
    return 0


def labels_command(args: argparse.Namespace) -> int:
    """Write closed surfaces around labels."""
    from cortet.formats.gifti import write_surface
    from cortet.formats.volumes import read_labels
    from cortet.geometry.label_surface import Handles
    from cortet.solver_files.label_surfaces import surfaces_of_labels

    name = args.output.name.partition(".")[0]
    volume, keys = read_labels(args.labels)
    made, told = surfaces_of_labels(name, volume, keys, Handles(args.handles))
    files = {own: args.output.with_name(args.output.name.replace(name, own, 1)) for own in made}
    for file in files.values():
        may_write(file)
    for own, surface in made.items():
        write_surface(surface, files[own])
    print(*told, sep="\n")
    print(f"{', '.join(map(str, files.values()))}: written")
    ending = args.output.name.removeprefix(name)
    beside = (
        file for file in args.output.parent.iterdir() if file.name.startswith(name) and file.name.endswith(ending)
    )
    earlier = sorted(file.name for file in beside if file.name.removeprefix(name).removesuffix(ending).isdigit())
    if others := [file for file in earlier if file not in {path.name for path in files.values()}]:
        print(f"{', '.join(others)}: not of this run, left as they are")
    return 0


def _findings(report: GateReport) -> str:
    """The findings and repairs of the gate, in one line."""
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
