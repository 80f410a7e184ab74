"""How fast is the line from surface to certificate, where does its time go, and what became slower?

    python benchmarks/speed.py SURFACE... [--cell-sizes 1.0 0.8] [--chains published cgal default default:tetgen]
                               [--threads 1 2] [--inside WHITE] [--turned 1 2] [--profile]
    python benchmarks/speed.py slower [COMMIT] [--runs 3] [--cell-size 1.2] [--limit 1.2]

A chain is a setting, and after colons what differs from it: another mesher, or keys, as in
`default:reconnect.threshold=0.28` or `default:generate.core_ratio=2`. Each runs in a process of its own with kernels
compiled, on surfaces that are not smoothed. CPU seconds are those of all threads; other work on the machine changes
them least. Prints a row per stage, then one per mesh, with a hash of its nodes and tetrahedra, and where a chain ran on
several meshes, how its time grows with their size. With a surface `--inside` the given one, the mean q of the region
between them has a column of its own. A surface is turned at random and stretched by each of the seeds `--turned`, which
tells what depends on how it lies. A profile lists the slowest functions of a chain.

`slower` measures this checkout and a copy of COMMIT by turns, in CPU seconds: every stage of the line on a phantom, a
week of folding on its mesh, writing and reading it in each format, and a case of the workflow from the sheet to its
page. The least of all runs counts, since other work on the machine only adds. Exits with 1 if something takes more
than `--limit` times as long as before.
"""

from __future__ import annotations

import cProfile
import hashlib
import json
import os
import pstats
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numba
import numpy as np
from _frame import ROOT, Row, Table, alone, command, config_of, mesh, name_of, print_power

from cortet.errors import CortetError
from cortet.formats.gifti import read_surface
from cortet.geometry.nesting import nested
from cortet.measure.quality import circumradii, edge_lengths, quality
from cortet.meshes import REGION, TetMesh, TriSurface
from cortet.pipeline import Step

OF_CHAIN = ("surface", "h_mm", "chain", "threads", "turned")
STAGE_COLUMNS = (*OF_CHAIN, "stage", "cpu_seconds", "wall_seconds", "tets", "q_mean", "q_max", "above_0.3", "above_0.6")
MESH_COLUMNS = (
    *(*OF_CHAIN, "tets", "q_mean", "q_mean_outermost", "q_max", "above_0.3", "above_0.3005", "valence_bound"),
    *("circumradius_mean_h", "circumradius_max_h", "edge_mean_h", "cpu_seconds", "wall_seconds"),
    *("cpu_seconds_per_million_tets", "tets_per_cpu_second"),
    *("MB_per_million_tets", "dihedral_min_deg", "dihedral_max_deg", "nodes_to_surface_max_mm"),
    *("surface_to_boundary_mean_mm", "surface_to_boundary_max_mm"),
    *("volume_change", "euler", "certified", "sha256", "why_not"),
)


def chains(
    surfaces: Sequence[Path],
    *,
    cell_sizes: Sequence[float] = (1.0,),
    chains: Sequence[str] = ("published", "cgal", "default"),
    threads: Sequence[int] = (1,),
    inside: Path | None = None,
    turned: Sequence[int] = (),
    profile: bool = False,
) -> None:
    """Run every chain on every surface at every cell size."""
    rows = []
    table = Table(*STAGE_COLUMNS)
    for file, h, chain, count, seed in product(surfaces, cell_sizes, chains, threads, turned or (None,)):
        of_chain = {"surface": name_of(file), "h_mm": h, "chain": chain, "threads": count, "turned": seed}
        rows.append({**of_chain, **alone(run_chain, file, h, chain, count, inside, seed, profile)})
        for stage in rows[-1].get("stages", ()):
            table.add(of_chain, stage)
    print()
    table = Table(*MESH_COLUMNS)
    for row in rows:
        table.add(row)
    for chain in chains:
        print_power(chain, (row for row in rows if row["chain"] == chain))


def run_chain(
    file: Path, cell_size: float, chain: str, threads: int, inside: Path | None, seed: int | None, profile: bool
) -> Row:
    """Run one chain in this process; the row of its mesh, and those of its stages."""
    numba.set_num_threads(threads)
    stages: list[Row] = []
    setting, *changes = chain.split(":")
    profiler = cProfile.Profile(time.process_time)

    def say(step: Step, seconds: float) -> None:
        stages.append(of_stage(step) | {"cpu_seconds": seconds})
        if profile:  # what came before compiled, and what follows certifies
            profiler.enable() if step.stage != "solver_ready" else profiler.disable()

    surface = read_surface(file)
    if inside:
        surface = nested(surface, {"inside": read_surface(inside)})
    if seed is not None:
        surface = distorted(surface, seed)
    try:
        done = mesh(surface, config_of(cell_size, *changes, setting=setting), say)
    except CortetError as error:
        return {"stages": stages, "certified": False, "why_not": str(error)}
    if profile:
        pstats.Stats(profiler).sort_stats("tottime").print_stats(16)
    return {"stages": stages, **of_mesh(done.made.mesh, done.made.certificate, done.used, cell_size)}


def distorted(surface: TriSurface, seed: int) -> TriSurface:
    """A surface, with its inner ones, after a random rotation and stretches along three axes, 6 % (one sigma) each."""
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    matrix = turn * np.sign(np.linalg.det(turn)) * np.exp(random.normal(0, 0.06, 3))
    inner = {name: replace(one, points=one.points @ matrix) for name, one in surface.inner.items()}
    return replace(surface, points=surface.points @ matrix, inner=inner)


def of_stage(step: Step) -> dict[str, Any]:
    """What a stage took, and the quality of its mesh."""
    row: dict[str, Any] = {"stage": step.stage, "wall_seconds": step.seconds}
    if not isinstance(step.result, TetMesh):
        return row
    q = quality(step.result.points, step.result.cells)
    above = {f"above_{limit}": int((q > limit).sum()) for limit in (0.3, 0.6)}
    return row | {"tets": len(q), "q_mean": q.mean(), "q_max": q.max()} | above


def of_mesh(mesh: TetMesh, verdict: Any, used: Row, cell_size: float) -> dict[str, Any]:
    """What a chain took, and what its certificate says."""
    cells, radii = len(mesh.cells), circumradii(mesh.points, mesh.cells) / cell_size
    q = quality(mesh.points, mesh.cells)
    outermost = np.asarray(mesh.cell_data.get(REGION, np.ones(cells))) == 1
    fidelity = verdict.fidelity
    return {
        "cpu_seconds": used["cpu_seconds"],
        "wall_seconds": used["wall_seconds"],
        "tets": cells,
        "q_mean": verdict.quality.q.mean,
        "q_mean_outermost": q[outermost].mean(),
        "q_max": verdict.quality.q.max,
        "above_0.3": verdict.quality.count_above["0.3"],
        "above_0.3005": int((q > 0.3005).sum()),
        "valence_bound": verdict.valence_bound.q,
        "circumradius_mean_h": radii.mean(),
        "circumradius_max_h": radii.max(),
        "edge_mean_h": edge_lengths(mesh.points, mesh.cells).mean() / cell_size,
        "cpu_seconds_per_million_tets": used["cpu_seconds"] / cells * 1e6,
        "tets_per_cpu_second": cells / used["cpu_seconds"],
        "MB_per_million_tets": used["peak_MB"] / cells * 1e6,
        "dihedral_min_deg": verdict.quality.dihedral_min_deg,
        "dihedral_max_deg": verdict.quality.dihedral_max_deg,
        "nodes_to_surface_max_mm": fidelity.nodes_to_surface_mm.max,
        "surface_to_boundary_mean_mm": fidelity.surface_to_boundary_mm.mean,
        "surface_to_boundary_max_mm": fidelity.surface_to_boundary_mm.max,
        "volume_change": fidelity.relative_volume_change,
        "euler": verdict.topology.euler_number,
        "certified": verdict.certified,
        "why_not": "; ".join(verdict.reasons),
        "sha256": hashlib.sha256(mesh.points.tobytes() + mesh.cells.tobytes()).hexdigest()[:16],
    }


# --- what became slower ----------------------------------------------------------------------------------------------

#: shorter times than this are mostly chance, s
_LEAST = 0.05
#: what each checkout runs in a folder of its own; it uses only what both of them have
MEASURE = """
import json, resource, subprocess, sys, time
from pathlib import Path
from cortet.cohort.sheet import Case, write_sheet
from cortet.config import load
from cortet.formats import FORMATS
from cortet.phantoms import phantom
from cortet.pipeline import run
from cortet.stages.stage import About, State
from cortet.solver_files.sets import named_sets

cell_size, folder = float(sys.argv[1]), Path(sys.argv[2])
surface = phantom(30.0, subdivisions=5)
for size in (4.0, cell_size):  # the first compiles
    config, seconds, last = load({"generate": {"cell_size": size}}), {}, time.process_time()
    for step in run(State(surface), config, About()):
        now = time.process_time()
        seconds["stage " + step.stage], last, mesh = now - last, now, step.result
mesh = named_sets(mesh)
for name, form in FORMATS.items():
    if not form.is_surface:
        last = time.process_time()
        form.write(mesh, folder / f"m{form.suffix}")
        seconds["format " + name] = time.process_time() - last

def of_children(command, **more):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

cortet = [sys.executable, "-m", "cortet.cli"]
fold = [*cortet, "fold", str(folder / "m.vtu"), "--ga", "30", "-o", str(folder / "folded"), "--force", "--end"]
of_children([*fold, "30.05"])  # compiles
seconds["fold a week"] = of_children([*fold, "31"])
write_sheet([Case("phantom", None, "L", 30.0, "phantom")], folder / "cohort.tsv")
(folder / "config.yaml").write_text(json.dumps({"cohort": {"sheet": "cohort.tsv"}, "generate": {"cell_size": [4.0]}}))
snakemake = [sys.executable, "-m", "snakemake", "--snakefile", sys.argv[3] + "/Snakefile", "--cores", "1"]
seconds["workflow, a case"] = of_children(snakemake, cwd=folder)
print(json.dumps(seconds))
"""


def slower(commit: str = "HEAD", *, runs: int = 3, cell_size: float = 1.2, limit: float = 1.2) -> None:
    """Measure this checkout and a copy of a commit, and compare."""
    before, now = dict[str, float](), dict[str, float]()
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "before"
        subprocess.run(["git", "-C", ROOT, "worktree", "add", "--quiet", "--detach", other, commit], check=True)
        try:
            for _ in range(runs):
                for checkout, least in ((other, before), (ROOT, now)):
                    for name, seconds in seconds_of(checkout, cell_size).items():
                        least[name] = min(seconds, least.get(name, seconds))
        finally:
            subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", other], check=True)
    table = Table("what", "before_cpu_s", "now_cpu_s", "ratio")
    for name, seconds in now.items():
        table.values(name, before.get(name, ""), seconds, seconds / before[name] if before.get(name) else "")
    ratios = {name: now[name] / old for name, old in before.items() if name in now and old >= _LEAST}
    worse = sorted((name for name in ratios if ratios[name] > limit), key=lambda name: -ratios[name])
    if worse:
        sys.exit(f"more than {limit:g} times as slow as {commit}: {', '.join(worse)}")


def seconds_of(checkout: Path, cell_size: float) -> dict[str, float]:
    """CPU seconds of all that a checkout does, by name."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", MEASURE, str(cell_size), folder, str(checkout)],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr.strip()[-2000:]}")
    seconds: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return seconds


main = command(__doc__, chains, slower)

if __name__ == "__main__":
    main()
