"""Do two checkouts make the same meshes, bit for bit?

    python benchmarks/same_bits.py OTHER_CHECKOUT SURFACE... [--pair PIAL WHITE] [--cell-size 1.6]
                                   [--settings default cgal published]

Each surface is meshed in each setting, the pair in `default`, by this checkout and by the other one, each in a process
of its own. Prints a row per mesh: tetrahedra, and the SHA-256 of its nodes and tetrahedra. Exits with 1 where
they differ. Before a change of the house: `git worktree add ../before HEAD`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

from rows import print_row

HERE = Path(__file__).parents[1]
COLUMNS = ("surface", "setting", "tets", "sha256", "same")

#: what each checkout runs; it uses only what both of them have
MESH = """
import json, sys
from cortet.config import load
from cortet.formats.gifti import read_surface
from cortet.formats.hashing import mesh_sha256
from cortet.geometry.nesting import nested
from cortet.pipeline import mesh_surface
outer, inner, setting, cell_size, age = json.loads(sys.argv[1])
surface = read_surface(outer)
surface = nested(surface, {"white": read_surface(inner)}) if inner else surface
config = load({"setting": setting, "generate": {"cell_size": cell_size}})
mesh, *_ = mesh_surface(surface, config, gestational_age=age)
print(json.dumps([len(mesh.cells), mesh_sha256(mesh)]))
"""


def main() -> None:
    """Mesh everything twice and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, metavar="OTHER_CHECKOUT")
    parser.add_argument("surfaces", nargs="*", metavar="SURFACE")
    parser.add_argument("--pair", nargs=2, metavar=("PIAL", "WHITE"))
    parser.add_argument("--cell-size", type=float, default=1.6, help="mm")
    parser.add_argument("--ga", type=float, default=28.0, help="gestational age, weeks: of the published smoothing")
    parser.add_argument("--settings", nargs="+", default=["default", "cgal", "published"])
    args = parser.parse_args()
    asked = [(surface, None, setting) for surface in args.surfaces for setting in args.settings]
    asked += [(*args.pair, "default")] if args.pair else []
    print(*COLUMNS, sep="\t", flush=True)
    differ = 0
    for outer, inner, setting in asked:
        job = json.dumps([outer, inner, setting, args.cell_size, args.ga])
        (tets, mine), (_, theirs) = (meshed(checkout, job) for checkout in (HERE, args.other))
        differ += mine != theirs
        name = Path(outer).name.split(".")[0] + (" (pair)" if inner else "")
        print_row(COLUMNS, dict(zip(COLUMNS, (name, setting, tets, mine[:16], mine == theirs), strict=True)))
    sys.exit(differ > 0)


def meshed(checkout: Path, job: str) -> tuple[int, str]:
    """Number of tetrahedra and hash of a mesh that the package of a checkout makes."""
    environment = {**os.environ, "PYTHONPATH": str(checkout.resolve())}
    command = [sys.executable, "-c", MESH, job]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr.strip().splitlines()[-1]}")
    tets, digest = json.loads(done.stdout.splitlines()[-1])
    return tets, digest


if __name__ == "__main__":
    main()
