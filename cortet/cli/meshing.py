"""Commands that make a mesh: `mesh`, `stages`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.cli.given import config_of, draw, stem_of
from cortet.cli.meshes import print_verdict
from cortet.cli.shared import inner, writes
from cortet.cli.values import Number, OutputFile, named_file, output_picture, size
from cortet.errors import InputError
from cortet.formats import format_of, require_holes
from cortet.formats.ownership import may_write, refuse_companion
from cortet.geometry.limits import CELL_SIZE_MM, SCAN_AGES, SHELL_MM

#: said of a mesh of a white surface without others
WHITE_ALONE = "the surface is a white one: the mesh is what it encloses, white matter, without the cortex around it"

if TYPE_CHECKING:
    from cortet.api.meshing import Inputs
    from cortet.cli.shared import Commands
    from cortet.config import Config
    from cortet.meshes import TetMesh, TriSurface
    from cortet.pipeline import Step


def add_commands(commands: Commands) -> None:
    """Add `mesh` and `stages`."""
    line = argparse.ArgumentParser(add_help=False, parents=[inner()])
    line.add_argument(
        "--size",
        action="append",
        default=[],
        type=size,
        metavar="WHERE=MM",
        help="smaller cells at the surface of a region (white=0.5), inside labels of a volume (dseg.nii.gz:5=0.5), or "
        "as the voxels of a volume say (sizes.nii.gz); repeatable",
    )
    line.add_argument(
        "--shell",
        type=Number(*SHELL_MM),
        metavar="MM",
        help="also mesh the space around the brain, a region csf, up to a smooth surface at least so far away",
    )
    line.add_argument("surface", type=Path, metavar="SURFACE", help="closed surface, GIfTI, mm")
    line.add_argument(
        "--cell-size",
        type=Number(*CELL_SIZE_MM),
        metavar="MM",
        help="cell size h (default: 0.6, or what --config says)",
    )
    line.add_argument(
        "--ga",
        type=Number(*SCAN_AGES),
        metavar="WEEKS",
        help="gestational age, by which the setting published smooths the surface",
    )
    line.add_argument(
        "--setting",
        choices=["default", "cgal", "published"],
        help="our line, the paper's mesher with our boundary, or all choices of the paper",
    )
    line.add_argument("--config", type=Path, metavar="FILE", help="YAML file of parameters; see `cortet config`")
    line.add_argument(
        "--field",
        action="append",
        default=[],
        type=named_file,
        metavar="NAME=FILE",
        help="per-vertex field to carry to the mesh, GIfTI; repeatable",
    )
    line.add_argument(
        "--sphere", type=Path, metavar="FILE", help="sphere of SURFACE, through which it is put onto the common mesh"
    )

    mesh = commands.add_parser("mesh", parents=[writes(), line], help="mesh one surface and certify the mesh")
    mesh.add_argument(
        "-o",
        "--output",
        type=OutputFile,
        required=True,
        metavar="OUT",
        help="mesh file; its suffix says for which solver",
    )
    mesh.add_argument(
        "--volume",
        action="append",
        default=[],
        type=named_file,
        metavar="NAME=FILE",
        help="NIfTI or MGZ whose labels, numbers or tensors the tetrahedra get; FILE:KIND says which; repeatable",
    )
    mesh.add_argument(
        "--hole",
        action="append",
        metavar="NAME",
        help="write no tetrahedra inside the inner surface NAME, a ventricle for example; repeatable",
    )
    mesh.add_argument(
        "--picture", type=output_picture, metavar="PNG", help="also draw the mesh cut open, coloured by q"
    )
    mesh.add_argument(
        "--slices",
        type=output_picture,
        metavar="PNG",
        help="also draw slices of the first volume with the mesh in them",
    )
    mesh.add_argument("--page", type=OutputFile, metavar="HTML", help="also write a page on the mesh for a browser")
    mesh.set_defaults(run=mesh_command)

    table = commands.add_parser(
        "stages", parents=[writes(), line], help="run the line and tabulate what each stage does"
    )
    table.add_argument("-o", "--output", type=OutputFile, metavar="TSV", help="also write the table there")
    table.set_defaults(run=stages_command)


def mesh_command(args: argparse.Namespace) -> int:
    """Mesh a surface, certify the mesh and write it with its companions."""
    from cortet.formats.tables import printed
    from cortet.pipeline import Meshed, companions, save
    from cortet.solver_files.holes import require_regions
    from cortet.solver_files.meshed import require_own_stem
    from cortet.solver_files.sidecar import sidecar_path
    from cortet.solver_files.volumes import TISSUE_COLUMNS

    if args.slices and not args.volume:
        raise InputError("--slices needs a volume", remedy="give one: --volume NAME=FILE")
    # a file that cannot be written is refused before the work, and before files of an earlier run are deleted
    config = config_of(args)
    require_holes(config.export.holes, format_of(args.output).name)
    given = _inputs(args, config)
    surface = given.surface
    beside = companions(args.output, surface.inner, volumes=bool(args.volume))
    every = [*beside.files, sidecar_path(args.output)]
    for file in every:
        may_write(file)
    for file in (args.page, args.picture, args.slices):
        if file and file.absolute() in [one.absolute() for one in every]:
            refuse_companion(file)
    if not args.force:
        require_own_stem(args.output, given.region_files, cell_size=config.generate.cell_size[0])
    require_regions(config.export.holes, surface.inner)
    for line in given.said:
        print(line)
    progress = Progress(config, args.ga, nested=bool(surface.inner), registered=given.sphere is not None)
    made = given.mesh(progress, case=stem_of(args.output))
    certificate = made.certificate

    def views(place: Callable[[Path], Path]) -> None:
        if args.slices:
            from cortet.report.slices import slices

            slices(made.mesh, *next(iter(given.volumes.items())), place(args.slices), given.in_mm.frame)
            print(f"{args.slices}: drawn")
        _mesh_views(args, made.mesh, made.surface, given.in_mm, asdict(certificate), config, place)

    told = save(
        Meshed(made.mesh, certificate, made.surface),
        args.output,
        config,
        made.origin,
        kind=made.kind,
        labels=made.label_names,
        rows=made.tissue_rows,
        force=args.force,
        views=views,
    )
    print()
    if made.tissue_rows:
        print(printed(TISSUE_COLUMNS, made.tissue_rows) + "\n")
    print_verdict(certificate)
    print(f"{beside.certificate}: every number beside its limit")
    if certificate.certified:
        for what in told:
            print(f"{args.output}: {what}")
        meshed = next(iter(beside.surfaces.values())).name
        print(f"{args.output}: written, with the surface that was meshed: {meshed}")
        if made.kind == "white" and not surface.inner:
            print(WHITE_ALONE)
    else:
        print(f"{args.output}: not written")
    return 0 if certificate.certified else 1


def _inputs(args: argparse.Namespace, config: Config) -> Inputs:
    """What a command is to mesh."""
    from cortet.api.meshing import inputs

    return inputs(
        args.surface,
        config,
        ga=args.ga,
        inner=dict(args.inner),
        shell=args.shell,
        fields=dict(args.field),
        volumes=dict(getattr(args, "volume", ())),
        sphere=args.sphere,
    )


def _mesh_views(
    args: argparse.Namespace,
    mesh: TetMesh,
    meshed: TriSurface,
    given: TriSurface,
    certificate: Mapping[str, Any],
    config: Config,
    place: Callable[[Path], Path],
) -> None:
    """Write the picture and the page of a mesh if asked for; `place` gives the temporary file of each."""
    if args.picture:
        draw(mesh, args.picture, place)
    if args.page:
        from cortet.formats.gifti import kind_of
        from cortet.report.case_page import about, write_case_page

        chosen = {
            "surface": kind_of(args.surface),
            "scan_age": args.ga,
            "cell_size": config.generate.cell_size[0],
            "mesher": config.generate.meshers[0],
        }
        write_case_page(mesh, given, certificate, place(args.page), meshed=meshed, facts=about(chosen))
        print(f"{args.page}: written")


def stages_command(args: argparse.Namespace) -> int:
    """Print the effect of each stage of the line on a surface."""
    from cortet.formats.tables import write_table
    from cortet.pipeline import run
    from cortet.report.stage_table import STAGE_COLUMNS, measured_stages

    config = config_of(args)
    given = _inputs(args, config)
    for said in given.said:
        print(said)
    rows = []
    widths = [max(len(column.name) + 2, 12) for column in STAGE_COLUMNS]
    print("".join(f"{column.name:>{width}}" for column, width in zip(STAGE_COLUMNS, widths, strict=True)))
    for row in measured_stages(run(given.surface, config, **given.facts)):
        values = (column.text(row) for column in STAGE_COLUMNS)
        print("".join(f"{value:>{width}}" for value, width in zip(values, widths, strict=True)), flush=True)
        rows.append(row)
    if args.output:
        write_table(STAGE_COLUMNS, rows, args.output)
    return 0


class Progress:
    """A table on the terminal that gets a row for each stage, and names the stage that is running."""

    HEAD = ("stage", "seconds", "nodes", "tets", "mean q", "q_max", "q > 0.6")

    def __init__(self, config: Config, gestational_age: float | None, *, nested: bool, registered: bool) -> None:
        from cortet.pipeline import stages

        self.live = sys.stdout.isatty()
        self.waiting = stages(config, gestational_age=gestational_age, nested=nested, registered=registered)
        print(self._row(self.HEAD))
        self._announce()

    def __call__(self, step: Step) -> None:
        """Print the row of a completed stage."""
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
        from cortet.meshes import TetMesh

        if not isinstance(result, TetMesh):
            return str(len(result.points)), "", "", "", ""
        q = quality(result.points, result.cells)
        return str(len(result.points)), str(len(q)), f"{q.mean():.4f}", f"{q.max():.4f}", str(int((q > 0.6).sum()))

    @staticmethod
    def _row(cells: Iterable[str]) -> str:
        name, *numbers = cells
        return f"{name:<16}" + "".join(f"{number:>10}" for number in numbers)
