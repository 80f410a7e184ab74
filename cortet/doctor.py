"""`cortet doctor`: every dependency with its version and purpose, and a proof that compiled and linked ones work.

A successful import proves little: Gmsh's wheel loads libraries of the system, pygalmesh is compiled at installation,
and Numba compiles when called. So each proof uses the library as cortet does, in its own process: a crash is a finding
like any other, and no library disturbs the next. The other packages are wheels that work wherever they can be
installed; they are only listed. This module imports no dependency at the top, so that the doctor always answers.
"""

from __future__ import annotations

import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cortet.version import __version__

if TYPE_CHECKING:
    from cortet.meshes import TetMesh, TriSurface

#: seconds that one proof may take; the first compilation of the kernels takes by far the longest
TIME_LIMIT = 600
#: either one is enough for S1
MESHERS = ("pygalmesh", "cgal")
SET_UP = "rm -f .venv/.stamp && make setup"


@dataclass(frozen=True)
class Tool:
    """A Python package that cortet imports, by its distribution's name; or a program that some option calls."""

    name: str
    purpose: str = ""
    #: uses the tool and returns its result in words; raises if the result is wrong; None for a tool that is only listed
    proof: Callable[[], str] | None = None
    #: Debian packages of the system libraries it loads
    system_packages: str = ""


@dataclass(frozen=True)
class Finding:
    """One row of the table."""

    state: Literal["ok", "missing", "failed"]
    name: str
    version: str
    purpose: str
    detail: str
    remedy: str = ""


def run() -> int:
    """Print the table and the problems; return 0 if everything required works, else 1."""
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    _say(f"cortet {__version__}, Python {platform.python_version()}, {system}\n")
    findings = []
    with ThreadPoolExecutor(max_workers=2) as pool:
        for finding in pool.map(examine, (*LIBRARIES, *OPTIONAL, *PROGRAMS)):
            mark = {"ok": "ok", "missing": "-", "failed": "FAILED"}[finding.state]
            _say(f"{mark:<7} {finding.name:<13} {finding.version:<9.9} {finding.purpose:<34} {finding.detail}")
            findings.append(finding)
    wrong = problems(findings)
    _say("", *(wrong or ["Everything cortet needs works."]))
    return 1 if wrong else 0


def problems(findings: list[Finding]) -> list[str]:
    """Tools that failed, and those that are missing without a substitute, each with its remedy."""
    has_mesher = any(finding.state == "ok" for finding in findings if finding.name in MESHERS)
    dispensable = {*(MESHERS if has_mesher else ()), *(tool.name for tool in (*OPTIONAL, *PROGRAMS))}
    return [
        f"{finding.name}: {finding.detail}\n  remedy: {finding.remedy}"
        for finding in findings
        if finding.state == "failed" or (finding.state == "missing" and finding.name not in dispensable)
    ]


def examine(tool: Tool) -> Finding:
    """List one library or program, or prove it in its own process."""
    is_program = tool in PROGRAMS
    try:
        installed = "" if is_program else version(tool.name)
    except PackageNotFoundError:
        return Finding("missing", tool.name, "", tool.purpose, "not installed", SET_UP)
    place = shutil.which(tool.name) if is_program else "installed"
    if place is None:
        return Finding("missing", tool.name, "", tool.purpose, "optional, not found")
    works, detail = _proved(tool) if tool.proof else (True, place)
    if works:
        return Finding("ok", tool.name, installed, tool.purpose, detail)
    system = f"apt-get install {tool.system_packages}; if that is not it, " if tool.system_packages else ""
    remedy = f"install {tool.name} again, or take it off the PATH" if is_program else system + SET_UP
    return Finding("failed", tool.name, installed, tool.purpose, detail, remedy)


def _proved(tool: Tool) -> tuple[bool, str]:
    """Whether a tool works, and the last output of its process."""
    command = [sys.executable, "-m", "cortet.doctor", tool.name]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return False, f"no answer within {TIME_LIMIT} s"
    if done.returncode < 0:
        return False, f"crashed ({signal.Signals(-done.returncode).name})"
    said = (done.stderr if done.returncode else done.stdout).strip() or "said nothing"
    return done.returncode == 0, said.splitlines()[-1]


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{line}\n" for line in lines)
    sys.stdout.flush()


# --- specimens and proofs --------------------------------------------------------------------------------------------


def _ball(radius: float = 10.0, count: int = 500) -> TriSurface:
    """A sphere about the origin, mm: points on a spiral and their convex hull."""
    import numpy as np
    from scipy.spatial import ConvexHull

    from cortet.meshes import TriSurface

    height = (np.arange(count) + 0.5) * 2 / count - 1
    angle = np.pi * (1 + 5**0.5) * np.arange(count)
    ring = np.sqrt(1 - height**2)
    points = radius * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    faces = ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward, ::-1]
    return TriSurface(points, faces)


def star() -> tuple[TetMesh, TriSurface]:
    """Twenty tetrahedra around a node that is displaced from the centre, and their boundary."""
    import numpy as np

    from cortet.meshes import TetMesh

    boundary = _ball(2.0, 12)
    inside = np.full((len(boundary.faces), 1), len(boundary.points))
    points = np.vstack([boundary.points, [0.5, 0.3, 0.2]])
    return TetMesh(points, np.hstack([boundary.faces[:, ::-1], inside])), boundary


def expect(truth: object, otherwise: str) -> None:
    """Raise unless `truth`; unlike `assert`, also under `python -O`."""
    if not truth:
        raise AssertionError(otherwise)


def _prove_numba() -> str:
    from cortet.stages.clean import clean

    _, report = clean(*star())
    expect(report.q_max < report.q_max_before, f"worst q {report.q_max_before} became {report.q_max}")
    return f"the kernels compile; a worst q of {report.q_max_before:.3f} becomes {report.q_max:.3f}"


def _prove_mesher(backend: Literal["cgal", "pygalmesh"]) -> str:
    from cortet.geometry.topology import enclosed_volume
    from cortet.measure.quality import signed_volumes
    from cortet.stages.generate import Generate, generate

    ball = _ball()
    mesh, report = generate(ball, Generate(backend=backend), cell_size=5.0, mesher="cgal")
    expect(report.topology_ok, report.reason)
    share = signed_volumes(mesh.points, mesh.cells).sum() / enclosed_volume(ball.points, ball.faces)
    expect(0.8 < share < 1, f"the mesh of a ball has {100 * share:.0f} % of its volume")
    return f"a ball becomes {len(mesh.cells)} tetrahedra with {100 * share:.0f} % of its volume"


def _prove_cgal() -> str:
    from dataclasses import replace

    from cortet.geometry.topology import enclosed_volume
    from cortet.stages.repair import repair

    ball = _ball()
    closed, _ = repair(replace(ball, faces=ball.faces[ball.points[ball.faces, 2].max(axis=1) < 9]), source=None)
    share = enclosed_volume(closed.points, closed.faces) / enclosed_volume(ball.points, ball.faces)
    expect(0.99 < share < 1.01, f"a ball whose hole was filled has {100 * share:.0f} % of its volume")
    return f"{_prove_mesher('cgal')}; a hole is filled"


def _prove_gmsh() -> str:
    from cortet.stages.relocate import relocate

    _, report = relocate(star()[0])
    expect(report.nodes_moved == 1 and report.q_max_after < report.q_max_before, str(report))
    return f"Relocate3D moves a node by {report.max_displacement_mm:.2f} mm"


def _prove_pymeshlab() -> str:
    import numpy as np
    import pymeshlab

    ball = _ball()
    rough = ball.points * np.random.default_rng(0).normal(1, 0.01, (len(ball.points), 1))
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(rough, ball.faces))
    meshes.apply_coord_laplacian_smoothing_surface_preserving(angledeg=60, iterations=3)
    smooth = meshes.current_mesh().vertex_matrix()
    before, after = (float(np.linalg.norm(points, axis=1).std()) for points in (rough, smooth))
    expect(after < before, f"the roughness of a ball went from {before} to {after} mm")
    return f"the roughness of a ball goes from {before:.3f} to {after:.3f} mm"


def _prove_pyvista() -> str:
    import matplotlib.image
    import numpy as np

    from cortet.report.render import picture

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.png"
        picture(star()[0], path, position=1.0, size=(200, 200))
        colours = len(np.unique(matplotlib.image.imread(path).reshape(-1, 3), axis=0))
    expect(colours > 10, f"the picture of a mesh has {colours} colours")
    return f"a mesh is drawn without a display, in {colours} colours"


def _prove_meshtool() -> str:
    from cortet.measure.quality import quality
    from cortet.stages._meshtool import clean_with_meshtool

    mesh, _ = star()
    before = quality(mesh.points, mesh.cells).max()
    cleaned = clean_with_meshtool(mesh, thresholds=[before - 0.05])
    after = quality(cleaned.points, cleaned.cells).max()
    expect(after < before, f"the worst q of a bad mesh went from {before:.3f} to {after:.3f}")
    return f"brings the worst q of a bad mesh from {before:.3f} to {after:.3f}"


LISTED = (
    "cyclopts h5py jinja2 matplotlib meshio nibabel numpy pandas pydantic pyyaml scipy snakemake tabulate tetgen "
    "threadpoolctl"
)
LIBRARIES = (
    Tool("numba", "kernels of S4", _prove_numba),
    Tool("pygalmesh", "S1, as published", lambda: _prove_mesher("pygalmesh"), "libgmp10 libmpfr6"),
    Tool("cgal", "S1, second backend; caps on holes (repair)", _prove_cgal),
    Tool("gmsh", "S3", _prove_gmsh, "libglu1-mesa libxft2 libxcursor1 libxinerama1 libgl1"),
    Tool("pymeshlab", "smoothing of the input", _prove_pymeshlab, "libgl1 libopengl0 libegl1"),
    Tool("pyvista", "pictures of meshes", _prove_pyvista, "libgl1 libegl1 libxrender1"),
    *map(Tool, LISTED.split()),
)
#: the extras `slurm` and `baselines` (meshers that experiments compare with)
OPTIONAL = (
    Tool("snakemake-executor-plugin-slurm", "jobs on SLURM"),
    Tool("pytetwild", "fTetWild, to compare with"),
    Tool("netgen-mesher", "Netgen, to compare with"),
)
PROGRAMS = (
    Tool("meshtool", "S4, backend meshtool", _prove_meshtool),
    Tool("ccx", "CalculiX, which tests run on Abaqus files"),
    Tool("wb_command", "Connectome Workbench"),
    Tool("sbatch", "SLURM, for profiles/slurm"),
)


if __name__ == "__main__":
    # one proof, for `examine`; its result is the last line on standard output
    _say(*(tool.proof() for tool in (*LIBRARIES, *OPTIONAL, *PROGRAMS) if tool.proof and tool.name == sys.argv[1]))
