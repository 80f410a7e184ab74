"""Speed, memory and size of every writer, reader and check of exported files.

    python benchmarks/formats.py [--tets 2e6] [--formats abaqus febio ...] [-o TSV]

The mesh is a cube of equal hexahedra, six tetrahedra each, surface nodes first, with one field, one label field and its
sets. Each measurement runs in a process of its own, on one thread; seconds are those of its CPU, so that other work on
the machine hardly counts, and memory is its peak less what it had before. The last columns are the check of conventions
on what was read, and the size of all files of the format.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from cubes import cube_mesh

from cortet.formats import FORMATS
from cortet.formats.atomic import atomic_path
from cortet.geometry.topology import boundary_faces
from cortet.meshes import TetMesh
from cortet.solver_files.export import write
from cortet.solver_files.sets import named_sets
from cortet.solver_files.verify import problems
from cortet.stages.solver_ready import surface_nodes_first

COLUMNS = (
    "format",
    "tets",
    "write_s",
    "write_Mtets_per_s",
    "write_MB",
    "read_s",
    "read_Mtets_per_s",
    "read_MB",
    "check_s",
    "size_MB",
)


def cube(tets: float, side: float = 60.0) -> TetMesh:
    """A cube [0, side]^3 mm of at least so many tetrahedra, with fields and sets."""
    n = int(np.ceil((tets / 6) ** (1 / 3)))
    mesh, _ = surface_nodes_first(cube_mesh(n, side))
    fields = {
        "thickness": 1 + np.sin(mesh.points[:, 0]) / 3,
        "area": (mesh.points[:, 2] // (side / 4)).astype(np.int32),
    }
    return named_sets(replace(mesh, point_data=fields), cortex_depth=2.0, medial_wall={"area": [0]})


def measure(task: str, name: str, path: Path, mesh_file: Path, answer) -> None:  # type: ignore[no-untyped-def]
    """Do one task in this process and send back seconds, and MB on top of what it began with."""
    mesh = load(mesh_file) if task == "write" else None
    if mesh is not None:
        boundary_faces(mesh)  # the mesh has them by then: the named sets need them
    file = FORMATS[name].as_read(path) if task == "check" else None
    tasks: dict[str, Callable[[], object]] = {
        "write": lambda: write(mesh, path, solver=name),
        "read": lambda: FORMATS[name].read(path),
        "check": lambda: problems(file),
    }
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before, start = _memory("VmRSS"), time.process_time()
    tasks[task]()
    answer.send((time.process_time() - start, _memory("VmHWM") - before))


def save(mesh: TetMesh, path: Path) -> None:
    """Keep a mesh for the processes that write it."""
    sets = {f"{kind}/{name}": members for kind, sets in vars(mesh.sets).items() for name, members in sets.items()}
    with atomic_path(path) as temporary:
        np.savez(temporary, points=mesh.points, cells=mesh.cells, **mesh.point_data, **sets)


def load(path: Path) -> TetMesh:
    """The mesh that `save` kept."""
    with np.load(path) as data:
        mesh = TetMesh(data["points"], data["cells"], {name: data[name] for name in ("thickness", "area")})
        for key in data:
            kind, slash, name = key.partition("/")
            if slash:
                getattr(mesh.sets, kind)[name] = data[key]
    return mesh


def _memory(kind: str) -> float:
    """Resident size of this process, MB: now (VmRSS), or its peak (VmHWM); Linux."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(kind))
    return int(line.split()[1]) / 1024


def in_own_process(*arguments: object) -> tuple[float, float]:
    """Run `measure` in a fresh process."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=measure, args=(*arguments, send))
    process.start()
    send.close()
    result: tuple[float, float] = receive.recv()
    process.join()
    return result


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tets", type=float, default=2e6)
    parser.add_argument("--formats", nargs="+", choices=FORMATS, default=list(FORMATS))
    parser.add_argument("-o", "--output", type=Path, metavar="TSV", help="also write the table there")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        mesh = cube(options.tets)
        count = len(mesh.cells)
        save(mesh, Path(folder) / "mesh.npz")
        del mesh
        print(*(f"{name:>18}" for name in COLUMNS), sep="", flush=True)
        for name in options.formats:
            path = Path(folder) / name / f"cube{FORMATS[name].suffix}"
            write_s, write_mb = in_own_process("write", name, path, Path(folder) / "mesh.npz")
            read_s, read_mb = in_own_process("read", name, path, path)
            check_s, _ = in_own_process("check", name, path, path)
            size = sum(file.stat().st_size for file in path.parent.iterdir()) / 1e6
            row = [
                name,
                count,
                write_s,
                count / write_s / 1e6,
                write_mb,
                read_s,
                count / read_s / 1e6,
                read_mb,
                check_s,
                size,
            ]
            rows.append([f"{value:.3g}" if isinstance(value, float) else str(value) for value in row])
            print(*(f"{value:>18}" for value in rows[-1]), sep="", flush=True)
            for file in path.parent.iterdir():
                file.unlink()
    if options.output:
        table = ["\t".join(row) for row in (COLUMNS, *rows)]
        options.output.write_text("\n".join(table) + "\n")


if __name__ == "__main__":
    main()
