"""Files for solvers as other programs read them: tags, names and a linear field, side by side.

    python benchmarks/read_back.py [--tags tissue]

The mesh is a cube with a white matter inside, and a volume whose labels 3 (left) and 7 (right) cross both regions. Each
format is written and verified as an export is, and read by every program that reads it, as `solver_files.others` has
them; a format without one is read by cortet. `worst` is the largest difference of the field 1 + 2 x + 3 y + 4 z from
its value where the program finds the node.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from cubes import cube_mesh

from cortet.formats import FORMATS
from cortet.formats.tags import region_numbers, regions
from cortet.meshes import REGION, TetMesh
from cortet.solver_files.export import export
from cortet.solver_files.others import READERS, Seen
from cortet.solver_files.sets import named_sets
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


def main() -> None:
    """Print a line for each format and program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tags", help="the volume whose labels take the place of the regions")
    mesh = model(parser.parse_args().tags)
    print(f"{'format':<13}{'read by':<9}{'tags and numbers of tetrahedra':<32}{'names, or sets: tetrahedra':<34}worst")
    for name in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            for program, found in seen(mesh, name, Path(folder)):
                count = (
                    zip(*np.unique(found.region, return_counts=True), strict=True) if found.region is not None else ()
                )
                tags = ", ".join(f"{tag:g}: {times}" for tag, times in count) or "none"
                names = ", ".join(f"{tag} {called}" for tag, called in found.names.items())
                names = names or ", ".join(f"{called}: {len(some)}" for called, some in found.sets.items()) or "none"
                off = "no field"
                if "linear" in found.fields:
                    off = f"{np.abs(found.fields['linear'] - linear(found.points)).max():.1e}"
                print(f"{name:<13}{program:<9}{tags:<32}{names:<33} {off}")


if __name__ == "__main__":
    main()
