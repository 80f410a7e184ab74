"""Do two checkouts make the same meshes, bit for bit?

    python benchmarks/same_bits.py OTHER_CHECKOUT SURFACE... [--pair PIAL WHITE] [--cell-size 1.6]
                                   [--settings default cgal published]

Each surface is meshed in each setting, the pair in `default`, by this checkout and by the other one, each in a process
of its own. Prints a row per mesh: tetrahedra, and the SHA-256 of its nodes and tetrahedra. Exits with 1 where
they differ. Before a change of the house: `git worktree add ../before HEAD`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from _frame import ROOT, Table, command

#: what each checkout runs; it uses only what both of them have
MESH = """
import json, sys
import cortet
from cortet.formats.hashing import mesh_sha256
outer, inner, setting, cell_size, age = json.loads(sys.argv[1])
inner = {"white": inner} if inner else None
made = cortet.mesh(outer, cell_size, ga=age, inner=inner, settings={"setting": setting}, progress=False)
print(json.dumps([len(made.cells), mesh_sha256(made.mesh)]))
"""


def same_bits(
    other: Path,
    surfaces: Sequence[str] = (),
    *,
    pair: tuple[str, str] | None = None,
    cell_size: float = 1.6,
    ga: float = 28.0,
    settings: Sequence[str] = ("default", "cgal", "published"),
) -> int:
    """Mesh everything twice and compare.

    Parameters
    ----------
    ga
        Gestational age, weeks: of the published smoothing.
    """
    jobs = [(surface, None, setting) for surface in surfaces for setting in settings]
    jobs += [(*pair, "default")] if pair else []
    table, differ = Table("surface", "setting", "tets", "sha256", "same"), 0
    for outer, inner, setting in jobs:
        job = json.dumps([outer, inner, setting, cell_size, ga])
        (tets, mine), (_, theirs) = (meshed(checkout, job) for checkout in (ROOT, other))
        differ += mine != theirs
        name = Path(outer).name.split(".")[0] + (" (pair)" if inner else "")
        table.values(name, setting, tets, mine[:16], mine == theirs)
    return int(differ > 0)


def meshed(checkout: Path, job: str) -> tuple[int, str]:
    """Number of tetrahedra and hash of a mesh that the package of a checkout makes."""
    environment = {**os.environ, "PYTHONPATH": str(checkout.resolve())}
    program = [sys.executable, "-P", "-c", MESH, job]  # -P: not the package of the working folder
    done = subprocess.run(program, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr.strip().splitlines()[-1]}")
    tets, digest = json.loads(done.stdout.splitlines()[-1])
    return tets, digest


main = command(__doc__, same_bits)

if __name__ == "__main__":
    main()
