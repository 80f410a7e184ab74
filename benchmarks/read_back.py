"""What do other programs read in files for solvers, and what do writing, reading and checking cost?

    python benchmarks/read_back.py [--tags tissue]
    python benchmarks/read_back.py formats [--tets 2e6] [--formats abaqus febio ...]

The mesh is a cube with a white matter inside, and a volume whose labels 3 (left) and 7 (right) cross both regions. Each
format is written and verified as an export is, and read by every program that reads it, as `solver_files.others` has
them; a format without one is read by cortet. `worst` is the largest difference of the field 1 + 2 x + 3 y + 4 z from
its value where the program finds the node.

`formats` measures every writer, reader and check on a cube with fields and sets, each in a process of its own: CPU
seconds, MB of its peak above what it had before, and the size of all files of the format.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _frame import Row, Table, alone, command, spent
from cubes import cube_mesh

from cortet.formats import FORMATS
from cortet.formats.tags import region_numbers, regions
from cortet.geometry.topology import boundary_faces
from cortet.meshes import REGION, TetMesh
from cortet.solver_files.export import export, write
from cortet.solver_files.others import READERS, Seen
from cortet.solver_files.sets import named_sets
from cortet.solver_files.verify import problems
from cortet.stages.solver_ready import surface_nodes_first

#: labels of the volume, by their keys
LABELS = {3: "left", 7: "right"}


def model(tags: str | None = None) -> TetMesh:
    """A cube of 8 mm: cortex around white matter, labels, and the linear field."""
    mesh = surface_nodes_first(cube_mesh(4, side=8.0))[0]
    centre = mesh.points[mesh.cells].mean(axis=1)
    region = np.where((np.abs(centre - 4) < 2).all(axis=1), 2, 1).astype(np.int32)
    tissue = np.where(centre[:, 0] < 4, 3, 7).astype(np.int32)
    mesh = replace(mesh, point_data={"linear": linear(mesh.points)}, cell_data={REGION: region, "tissue": tissue})
    return named_sets(mesh, inner=["white"], label_names={"tissue": LABELS}, tissues=["tissue"], tags=tags)


def linear(points: np.ndarray) -> np.ndarray:
    """A field that no other order of nodes gives."""
    return np.asarray(1 + points @ [2.0, 3.0, 4.0])


def seen(mesh: TetMesh, name: str, folder: Path) -> Iterator[tuple[str, Seen]]:
    """What each program finds in the file of a format; cortet, where no other reads it."""
    path = folder / f"m{FORMATS[name].suffix}"
    export(mesh, path, solver=name, certificate={"certified": True, "reasons": []})
    for program, read in READERS.get(name, {}).items():
        yield program, read(path)
    if name not in READERS:
        back = FORMATS[name].read(path)
        names = {number: called for called, number in regions(back).items()} if back.sets.cells else {}
        yield "cortet", Seen(back.points, back.cells, dict(back.point_data), region_numbers(back), names)


def in_words(found: Seen) -> tuple[str, str, str]:
    """Tags and numbers of tetrahedra, names or sets, and the largest error of the field."""
    count = np.unique(found.region, return_counts=True) if found.region is not None else ((), ())
    tags = ", ".join(f"{tag:g}: {times}" for tag, times in zip(*count, strict=True))
    names = ", ".join(f"{tag} {called}" for tag, called in found.names.items())
    names = names or ", ".join(f"{called}: {len(some)}" for called, some in found.sets.items())
    off = "no field"
    if "linear" in found.fields:
        off = f"{np.abs(found.fields['linear'] - linear(found.points)).max():.1e}"
    return tags or "none", names or "none", off


def read_back(*, tags: str | None = None) -> None:
    """A line for each format and program.

    tags : the volume whose labels take the place of the regions
    """
    mesh = model(tags)
    print(f"{'format':<13}{'read by':<9}{'tags and numbers of tetrahedra':<32}{'names, or sets: tetrahedra':<34}worst")
    for name in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            for program, found in seen(mesh, name, Path(folder)):
                numbers, names, off = in_words(found)
                print(f"{name:<13}{program:<9}{numbers:<32}{names:<33} {off}")


def formats(*, tets: float = 2e6, formats: Sequence[str] = tuple(FORMATS)) -> None:
    """Write, read and check a cube in each format."""
    table = Table(
        *("format", "tets", "write_s", "write_Mtets_per_s", "write_MB", "read_s", "read_Mtets_per_s", "read_MB"),
        *("check_s", "size_MB", "why_not"),
    )
    for name in formats:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"cube{FORMATS[name].suffix}"
            row: dict[str, Any] = {"format": name}
            for task in ("write", "read", "check"):
                row |= alone(cost, task, name, path, tets)
            for task in ("write", "read"):
                if f"{task}_s" in row:
                    row[f"{task}_Mtets_per_s"] = row["tets"] / row[f"{task}_s"] / 1e6
            table.add(row, {"size_MB": sum(file.stat().st_size for file in Path(folder).iterdir()) / 1e6})


def cost(task: str, name: str, path: Path, tets: float) -> Row:
    """Do one task in this process: seconds, and MB on top of what it began with."""
    mesh = cube(tets if task == "write" else 1)
    boundary_faces(mesh)  # the mesh has them by then: the named sets need them
    file = FORMATS[name].as_read(path) if task == "check" else None
    with spent() as used:
        if task == "write":
            write(mesh, path, solver=name)
        elif task == "read":
            FORMATS[name].read(path)
        else:
            problems(file)
    row = {f"{task}_s": used["cpu_seconds"], f"{task}_MB": used["peak_MB"]}
    return row | {"tets": len(mesh.cells)} if task == "write" else row


def cube(tets: float, side: float = 60.0) -> TetMesh:
    """A cube [0, side]^3 mm of at least so many tetrahedra, with fields and sets."""
    n = int(np.ceil((tets / 6) ** (1 / 3)))
    mesh, _ = surface_nodes_first(cube_mesh(n, side))
    labels = (mesh.points[:, 2] // (side / 4)).astype(np.int32)
    fields = {"thickness": 1 + np.sin(mesh.points[:, 0]) / 3, "area": labels}
    return named_sets(replace(mesh, point_data=fields), cortex_depth=2.0, medial_wall={"area": [0]})


main = command(__doc__, read_back, formats)

if __name__ == "__main__":
    main()
