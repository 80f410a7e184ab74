"""The arguments of the command, and their types."""

from __future__ import annotations

import argparse
from pathlib import Path

from cortet import __version__
from cortet.cli.growth import growth_command
from cortet.cli.meshes import (
    certify_command,
    compare_command,
    convert_command,
    job_command,
    picture_command,
    quadratic_command,
    quality_command,
    verify_command,
)
from cortet.cli.meshing import mesh_command, stages_command
from cortet.cli.runs import config_command, doctor_command, fold_command, run_command, scan_command
from cortet.cli.surfaces import (
    envelope_command,
    gate_command,
    head_command,
    labels_command,
    phantom_command,
    repair_command,
    resample_command,
)
from cortet.cli.values import Number, aged_file, inner_file, moduli, named_file, size
from cortet.errors import CortetError
from cortet.formats import FORMATS
from cortet.geometry.limits import (
    CELL_SIZE_MM,
    CLOSING_MM,
    FOLD_AGES,
    PHANTOM_AGES,
    SCAN_AGES,
    SHELL_MM,
    SUBDIVISIONS,
    THICKNESS_MM,
)


class OutputFile(type(Path())):  # type: ignore[misc]
    """A file that a command writes; any other path among its arguments is an input."""


def output_surface(text: str) -> OutputFile:
    """A surface that a command writes: GIfTI."""
    if not text.endswith(".gii"):
        raise argparse.ArgumentTypeError(f"{text!r} is no name of a GIfTI file; end it in .surf.gii")
    return OutputFile(text)


class CheckedOutput(type(Path())):  # type: ignore[misc]
    """A sheet, or a folder of `cortet run`: the command itself refuses one that is not its own."""


class FolderOfFiles(type(Path())):  # type: ignore[misc]
    """A folder in which a command writes some files; each of them is guarded by itself."""


def output_picture(text: str) -> OutputFile:
    """A file to write that ends in .png."""
    if not text.lower().endswith(".png"):
        raise argparse.ArgumentTypeError(f"{text!r} does not end in .png")
    return OutputFile(text)


WRITTEN = (OutputFile, CheckedOutput, FolderOfFiles)


class _FoldStatus(argparse.Action):
    """Says how far a run has come; no mesh is needed then."""

    def __call__(self, parser: argparse.ArgumentParser, _: object, folder: object, *__: object) -> None:
        """Print it and end the program."""
        from cortet.simulation.journal import reached

        try:
            print(reached(Path(str(folder))))
        except CortetError as error:
            parser.error(str(error))
        parser.exit()


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
        type=inner_file,
        metavar="[NAME=]FILE",
        help="closed surface inside SURFACE, whose inside is a region NAME (default: white), or labels of a volume, "
        "VOLUME:5,6; repeatable",
    )

    line = argparse.ArgumentParser(add_help=False, parents=[within])
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

    mesh = commands.add_parser("mesh", parents=[writes, line], help="mesh one surface and certify the mesh")
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

    table = commands.add_parser("stages", parents=[writes, line], help="run the line and tabulate what each stage does")
    table.add_argument("-o", "--output", type=OutputFile, metavar="TSV", help="also write the table there")
    table.set_defaults(run=stages_command)

    gate = commands.add_parser("gate", parents=[common], help="say of each surface whether it can be meshed")
    gate.add_argument("surfaces", type=Path, nargs="+", metavar="SURFACE")
    gate.add_argument(
        "--allow-genus", type=Number(0, 10_000, whole=True), default=0, metavar="N", help="accept up to N handles"
    )
    gate.set_defaults(run=gate_command)

    repair = commands.add_parser("repair", parents=[writes], help="repair a broken surface, within limits")
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
        "resample", parents=[writes], help="put a surface onto the common mesh, through its sphere"
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

    quality = commands.add_parser("quality", parents=[common], help="measure the elements of a mesh")
    quality.add_argument("mesh", type=Path, metavar="MESH")
    quality.add_argument("--json", action="store_true", help="every number, the histogram too, as JSON")
    quality.set_defaults(run=quality_command)

    limits = argparse.ArgumentParser(add_help=False)
    limits.add_argument("--q-max", type=Number(0, 1), metavar="Q", help="limit of the worst q (default: 0.6)")
    limits.add_argument(
        "--max-boundary-distance",
        type=Number(0, 1000, endless=True),
        metavar="MM",
        help="limit of the distance of boundary nodes to the surface (default: 0.001; inf: no limit)",
    )
    limits.add_argument(
        "--cell-size",
        type=Number(*CELL_SIZE_MM),
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
    certify.set_defaults(run=certify_command)

    compare = commands.add_parser(
        "compare", parents=[writes, limits], help="set meshes of one surface side by side, whatever made them"
    )
    compare.add_argument("meshes", type=Path, nargs="+", metavar="MESH")
    compare.add_argument(
        "--surface", type=Path, metavar="SURFACE", help="the surface they fill (default: by the sidecar of the first)"
    )
    compare.add_argument("-o", "--output", type=OutputFile, required=True, metavar="HTML", help="page for a browser")
    compare.add_argument("--table", type=OutputFile, metavar="TSV", help="also write the numbers there")
    compare.set_defaults(run=compare_command)

    verify = commands.add_parser(
        "verify", parents=[common], help="check a solver file against its solver's conventions"
    )
    verify.add_argument("file", type=Path, metavar="FILE")
    verify.add_argument("--solver", choices=list(FORMATS), help="solver that will read it (default: by the suffix)")
    verify.set_defaults(run=verify_command)

    convert = commands.add_parser("convert", parents=[writes], help="write a mesh file in another solver's format")
    convert.add_argument("source", type=Path, metavar="IN")
    convert.add_argument("target", type=OutputFile, metavar="OUT", help="its suffix says for which solver")
    convert.add_argument("--unit", choices=["mm", "um"], default="um", help="of a CARP file that is written")
    convert.add_argument("--source-unit", choices=["mm", "um"], default="um", help="of a CARP file without a sidecar")
    convert.set_defaults(run=convert_command)

    quadratic = commands.add_parser(
        "quadratic", parents=[writes], help="write a mesh as ten-node tetrahedra, midside nodes on the surface"
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

    job = commands.add_parser("job", parents=[writes], help="write a folder in which a solver lets the cortex grow")
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

    picture = commands.add_parser("picture", parents=[writes], help="draw a mesh cut open, coloured by q")
    picture.add_argument("mesh", type=Path, metavar="MESH")
    picture.add_argument("-o", "--output", type=output_picture, required=True, metavar="PNG")
    picture.set_defaults(run=picture_command)

    fold = commands.add_parser("fold", parents=[writes], help="grow the cortex of a mesh until it folds")
    fold.add_argument("mesh", type=Path, metavar="MESH")
    fold.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    fold.add_argument(
        "--ga", type=Number(*FOLD_AGES), required=True, metavar="WEEKS", help="gestational age of the mesh"
    )
    fold.add_argument("--hemi", choices=["L", "R"], help="half a brain, beside its other half")
    fold.add_argument(
        "--end", type=Number(*FOLD_AGES), metavar="WEEKS", help="gestational age at the end (default: 40)"
    )
    fold.add_argument(
        "--time-step", type=Number(0, 1), metavar="DT", help="dimensionless (default: from smallest altitude)"
    )
    fold.add_argument("--device", choices=["cpu", "cuda"], help="what takes the steps: cuda is a GPU (default: cpu)")
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
        "phantom", parents=[writes, made], help="make a synthetic cortex of any gestational age"
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
        parents=[writes, made],
        help="make a synthetic hemisphere with ventricles, a thalamus and volumes of them",
    )
    head.add_argument(
        "--voxel", type=Number(0.1, 5), default=0.5, metavar="MM", help="width of the voxels (default: 0.5)"
    )
    head.add_argument("-o", "--output", type=FolderOfFiles, required=True, metavar="DIR")
    head.set_defaults(run=head_command)

    around = commands.add_parser(
        "envelope", parents=[writes], help="make a smooth closed surface around one or several others"
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
        "labels", parents=[writes], help="make a closed surface around labels of a volume, without the steps of voxels"
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

    growth = commands.add_parser(
        "growth", parents=[writes], help="measure how much each spot of a surface has grown until a later age"
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

    cohort = commands.add_parser("cohort", help="work on cohort sheets").add_subparsers(
        required=True, metavar="COMMAND"
    )
    scan = cohort.add_parser("scan", parents=[common], help="make a cohort sheet of a data release")
    scan.add_argument("folder", type=Path, metavar="DIR")
    scan.add_argument("-o", "--output", type=CheckedOutput, required=True, metavar="TSV")
    scan.add_argument("--config", type=Path, metavar="FILE", help="YAML file whose cohort.scan says where surfaces are")
    scan.add_argument("--pial", action="store_true", help="two regions: the pial surface, and the white one inside")
    existing = scan.add_mutually_exclusive_group()
    existing.add_argument("--update", action="store_true", help="add new cases to an existing sheet, keep its rows")
    existing.add_argument("--force", action="store_true", help="replace an existing sheet")
    scan.set_defaults(run=scan_command)

    run = commands.add_parser("run", parents=[common], help="mesh the surfaces of a BIDS dataset (a BIDS App)")
    run.add_argument("bids_dir", type=Path, metavar="BIDS_DIR", help="dataset, or derivatives of one, with surfaces")
    run.add_argument("output_dir", type=CheckedOutput, metavar="OUTPUT_DIR", help="where the derivatives go")
    run.add_argument(
        "level",
        choices=["participant", "group"],
        metavar="{participant,group}",
        help="single cases, or tables and figures over all",
    )
    for words, name, of in (
        (("--participant-label", "--participant_label"), "participants", "participants"),
        (("--session-label", "--session_label"), "sessions", "sessions"),
    ):
        run.add_argument(*words, dest=name, nargs="+", default=[], metavar="LABEL", help=f"only these {of}")
    run.add_argument("--hemi", choices=["L", "R"], help="only this hemisphere")
    run.add_argument(
        "--cell-size",
        type=Number(*CELL_SIZE_MM),
        metavar="MM",
        help="cell size h (default: 0.6, or what --config says)",
    )
    run.add_argument("--setting", choices=["default", "cgal", "published"], help="as of `cortet mesh`")
    run.add_argument("--config", type=Path, metavar="FILE", help="YAML file of parameters; see `cortet config`")
    run.add_argument("--pial", action="store_true", help="two regions: the pial surface, and the white one inside")
    run.add_argument("--cores", type=Number(1, 10_000, whole=True), metavar="N", help="default: all")
    run.add_argument("--profile", metavar="NAME", help="profile of Snakemake: slurm, or a folder")
    run.add_argument("-n", "--dry-run", action="store_true", help="say what would be done")
    run.add_argument(
        "-w",
        "--work-dir",
        type=CheckedOutput,
        metavar="DIR",
        help="cohort sheet, configuration and what Snakemake remembers",
    )
    run.set_defaults(run=run_command)

    settings = commands.add_parser("config", parents=[common], help="print every parameter, with its unit and meaning")
    settings.add_argument("--setting", choices=["default", "cgal", "published"], default="default", help="as of `run`")
    settings.set_defaults(run=config_command)

    doctor = commands.add_parser("doctor", parents=[common], help="prove that everything needed is installed and works")
    doctor.set_defaults(run=doctor_command)
    return top
