"""`cortet doctor`: every dependency with its version and purpose, each proved by a small piece of real work.

That a library can be imported says little: Gmsh's wheel loads libraries of the system, pygalmesh is compiled on the
spot, Numba compiles when called. So each proof does what cortet does with the library, in a process of its own: a crash
is a finding like any other, and no library disturbs the next. Nothing is imported up here, so that the doctor answers
however little is installed.
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

from cortet import __version__

if TYPE_CHECKING:
    from cortet.mesh import FloatArray, TetMesh, TriSurface

#: seconds one proof may take; the first compilation of the kernels is the longest by far
TIME_LIMIT = 600
#: either is enough for S1
MESHERS = ("pygalmesh", "cgal")
SET_UP = "rm -f .venv/.stamp && make setup"


@dataclass(frozen=True)
class Library:
    """A Python package that cortet imports."""

    #: name of its distribution
    name: str
    purpose: str
    #: uses it and returns its result in words; raises when the result is wrong
    proof: Callable[[], str]
    #: Debian packages of the system libraries it loads
    system_packages: str = ""


@dataclass(frozen=True)
class Program:
    """A program that some option of cortet calls."""

    name: str
    purpose: str
    #: uses it and returns its result in words; raises when the result is wrong
    proof: Callable[[], str]


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
    """Print the table and what is wrong; 0 when everything required works, else 1."""
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    _say(f"cortet {__version__}, Python {platform.python_version()}, {system}\n")
    findings = []
    with ThreadPoolExecutor(max_workers=2) as pool:
        for finding in pool.map(examine, (*LIBRARIES, *OPTIONAL)):
            _say(_row(finding))
            findings.append(finding)
    for program in PROGRAMS:
        findings.append(find(program))
        _say(_row(findings[-1]))
    wrong = problems(findings)
    _say("", *(wrong or ["Everything cortet needs works."]))
    return 1 if wrong else 0


def problems(findings: list[Finding]) -> list[str]:
    """What failed, and what is missing without a substitute, each with its remedy."""
    has_mesher = any(finding.state == "ok" for finding in findings if finding.name in MESHERS)
    optional = (tool.name for tools in (OPTIONAL, PROGRAMS) for tool in tools)
    dispensable = {*(MESHERS if has_mesher else ()), *optional}
    return [
        f"{finding.name}: {finding.detail}\n  remedy: {finding.remedy}"
        for finding in findings
        if finding.state == "failed" or (finding.state == "missing" and finding.name not in dispensable)
    ]


def examine(library: Library) -> Finding:
    """Prove one library in a process of its own."""
    try:
        installed = version(library.name)
    except PackageNotFoundError:
        return Finding("missing", library.name, "", library.purpose, "not installed", SET_UP)

    def failed(detail: str) -> Finding:
        system = f"apt-get install {library.system_packages}; if that is not it, " if library.system_packages else ""
        return Finding("failed", library.name, installed, library.purpose, detail, system + SET_UP)

    command = [sys.executable, "-m", "cortet.doctor", library.name]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return failed(f"no answer within {TIME_LIMIT} s")
    if done.returncode < 0:
        return failed(f"crashed ({signal.Signals(-done.returncode).name})")
    last_line = ((done.stderr if done.returncode else done.stdout).strip() or "said nothing").splitlines()[-1]
    if done.returncode:
        return failed(last_line)
    return Finding("ok", library.name, installed, library.purpose, last_line)


def find(program: Program) -> Finding:
    """Look for one program on the PATH, and prove it."""
    if shutil.which(program.name) is None:
        return Finding("missing", program.name, "", program.purpose, "optional, not found")
    try:
        return Finding("ok", program.name, "", program.purpose, program.proof())
    except Exception as error:  # whatever is wrong with it is the finding
        remedy = f"install {program.name} again, or take it off the PATH"
        return Finding("failed", program.name, "", program.purpose, str(error), remedy)


def _row(finding: Finding) -> str:
    mark = {"ok": "ok", "missing": "-", "failed": "FAILED"}[finding.state]
    return f"{mark:<7} {finding.name:<13} {finding.version:<9.9} {finding.purpose:<34} {finding.detail}"


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{line}\n" for line in lines)
    sys.stdout.flush()


# --- specimens -------------------------------------------------------------------------------------------------------


def _ball(radius: float = 10.0, count: int = 500) -> TriSurface:
    """A sphere about the origin, mm: points on a spiral and their convex hull."""
    import numpy as np

    height = (np.arange(count) + 0.5) * 2 / count - 1
    angle = np.pi * (1 + 5**0.5) * np.arange(count)
    ring = np.sqrt(1 - height**2)
    return _hull(radius * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1))


def _hull(points: FloatArray) -> TriSurface:
    """The convex hull of points around the origin."""
    import numpy as np
    from scipy.spatial import ConvexHull

    from cortet.mesh import TriSurface

    faces = ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward, ::-1]
    return TriSurface(points, faces)


def _icosahedron() -> tuple[TetMesh, TriSurface]:
    """Twenty tetrahedra around a node, which is displaced from the centre; and their boundary."""
    import numpy as np

    from cortet.mesh import TetMesh

    golden = (1 + 5**0.5) / 2
    corners = np.array([(0, i, j * golden) for i in (-1, 1) for j in (-1, 1)])
    boundary = _hull(np.concatenate([np.roll(corners, shift, axis=1) for shift in range(3)]))
    inside = np.full((len(boundary.faces), 1), len(boundary.points))
    return TetMesh(
        np.vstack([boundary.points, [0.5, 0.3, 0.2]]), np.hstack([boundary.faces[:, ::-1], inside])
    ), boundary


# --- proofs ----------------------------------------------------------------------------------------------------------


def _expect(truth: object, otherwise: str) -> None:
    """Raise unless true; unlike `assert` also under `python -O`."""
    if not truth:
        raise AssertionError(otherwise)


def _prove_numpy() -> str:
    import numpy as np

    from cortet.measure.quality import quality

    corners = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]], dtype=float)
    q = float(quality(corners, np.array([[0, 1, 2, 3]], np.int32))[0])
    _expect(abs(q) < 1e-12, f"a regular tetrahedron has q = {q}")
    return "a regular tetrahedron has q = 0"


def _prove_scipy() -> str:
    from cortet.geometry.topology import surface_topology

    topology = surface_topology(_ball().faces)
    _expect(topology.is_closed_manifold and topology.euler_number == 2, f"a sphere is found to be {topology}")
    return "a sphere has Euler number 2"


def _prove_numba() -> str:
    import numpy as np

    from cortet.stages.clean import clean

    mesh, surface = _icosahedron()
    cleaned, report = clean(mesh, surface)
    _expect(report.q_max < report.q_max_before, f"worst q {report.q_max_before} became {report.q_max}")
    _expect(np.linalg.norm(cleaned.points[-1]) < np.linalg.norm(mesh.points[-1]), "a node moved the wrong way")
    return f"the kernels compile; a worst q of {report.q_max_before:.3f} becomes {report.q_max:.3f}"


def _prove_mesher(backend: str) -> str:
    import numpy as np

    from cortet.measure.quality import signed_volumes
    from cortet.stages.generate import generate

    mesh, report = generate(_ball(), cell_size=5.0, mesher="cgal", backend=backend)
    _expect(report.topology_ok, report.reason)
    share = float(signed_volumes(mesh.points, mesh.cells).sum()) / (4 / 3 * np.pi * 10**3)
    _expect(0.8 < share < 1, f"the mesh of a ball has {100 * share:.0f} % of its volume")
    return f"a ball becomes {len(mesh.cells)} tetrahedra with {100 * share:.0f} % of its volume"


def _prove_cgal() -> str:
    from dataclasses import replace

    from cortet.geometry.topology import enclosed_volume, surface_topology
    from cortet.stages.repair import repair

    filled = _prove_mesher("cgal")
    ball = _ball()
    closed, _ = repair(replace(ball, faces=ball.faces[ball.points[ball.faces, 2].max(axis=1) < 9]), source=None)
    share = enclosed_volume(closed.points, closed.faces) / enclosed_volume(ball.points, ball.faces)
    _expect(surface_topology(closed.faces).is_closed_manifold, "a hole of a ball is not closed")
    _expect(0.99 < share < 1.01, f"a ball whose hole was filled has {100 * share:.0f} % of its volume")
    return f"{filled}; a hole is filled"


def _prove_tetgen() -> str:
    import tetgen

    ball = _ball()
    nodes, cells, *_ = tetgen.TetGen(ball.points.copy(), ball.faces.copy()).tetrahedralize(switches="pYQ")
    _expect(len(cells) > 0 and len(nodes) >= len(ball.points), "a ball is not filled")
    return f"a ball of {len(ball.faces)} triangles becomes {len(cells)} tetrahedra"


def _prove_gpu() -> str:
    """A GPU takes the same steps as the CPU; a machine without one may have the package all the same."""
    import numpy as np

    from cortet.errors import InputError
    from cortet.simulation.device import device_name
    from cortet.simulation.run import advance_to, beginning, prepared
    from cortet.simulation.state import Settings

    try:
        name = device_name()
    except InputError as error:
        return error.what
    ends = []
    for device in ("cpu", "cuda"):
        run = prepared(_icosahedron()[0], Settings(22.0, end=22.05, device=device))
        moment = beginning(run)
        advance_to(run, moment, run.end)
        ends.append(moment.state.x)
    difference = float(np.abs(ends[0] - ends[1]).max())
    _expect(difference < 1e-12, f"{name}: nodes end {difference:g} from where they do on the CPU")
    return f"{name} takes the steps of the CPU, to {difference:.0e}"


def _prove_baseline(mesher: str) -> str:
    from cortet.meshers.baselines import tetrahedra

    _, cells = tetrahedra(_ball(), mesher, cell_size=5.0)
    return f"a ball becomes {len(cells)} tetrahedra"


def _prove_gmsh() -> str:
    from cortet.stages.relocate import relocate

    mesh, _ = _icosahedron()
    _, report = relocate(mesh)
    _expect(report.nodes_moved == 1 and report.q_max_after < report.q_max_before, str(report))
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
    _expect(after < before, f"the roughness of a ball went from {before} to {after} mm")
    return f"the roughness of a ball goes from {before:.3f} to {after:.3f} mm"


def _prove_meshio() -> str:
    import meshio
    import numpy as np

    from cortet.formats import vtu

    mesh, _ = _icosahedron()
    with tempfile.TemporaryDirectory() as folder:
        vtu.write(mesh, Path(folder) / "mesh.vtu")
        again = meshio.read(Path(folder) / "mesh.vtu")
    same = np.array_equal(again.points, mesh.points) and np.array_equal(again.cells_dict["tetra"], mesh.cells)
    _expect(same, "a mesh came back changed")
    return "it reads our VTU file bit for bit"


def _prove_h5py() -> str:
    import numpy as np

    from cortet.formats import fenics

    mesh, _ = _icosahedron()
    with tempfile.TemporaryDirectory() as folder:
        fenics.write(mesh, Path(folder) / "mesh.xdmf")
        again = fenics.read(Path(folder) / "mesh.xdmf")
    same = np.array_equal(again.points, mesh.points) and np.array_equal(again.cells, mesh.cells)
    _expect(same, "a mesh came back changed")
    return "an HDF5 file comes back bit for bit"


def _prove_nibabel() -> str:
    import numpy as np

    from cortet.formats.gifti import read_surface, write_surface

    ball = _ball()
    with tempfile.TemporaryDirectory() as folder:
        write_surface(ball, Path(folder) / "ball.surf.gii")
        again = read_surface(Path(folder) / "ball.surf.gii")
    same = np.array_equal(again.faces, ball.faces) and np.allclose(again.points, ball.points)
    _expect(same, "a surface came back changed")
    return "a GIfTI surface comes back"


def _prove_yaml() -> str:
    import yaml

    values = yaml.safe_load("{thresholds: [0.7, 0.5], surface: '007'}")
    _expect(values == {"thresholds": [0.7, 0.5], "surface": "007"}, f"read as {values}")
    return "numbers and labels are told apart"


def _prove_pydantic() -> str:
    from cortet.config import load
    from cortet.errors import InputError

    load({"setting": "published"})
    named = False
    try:
        load({"generate": {"cel_size": 0.6}})
    except InputError as error:
        named = "cel_size" in str(error)
    _expect(named, "an unknown key is not named")
    return "an unknown key is named"


def _prove_matplotlib() -> str:
    from matplotlib.figure import Figure

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "figure.pdf"
        figure = Figure()
        figure.add_subplot().plot([0, 1])
        figure.savefig(path)
        _expect(path.read_bytes().startswith(b"%PDF"), "no PDF was written")
    return "a figure is drawn"


def _prove_pandas() -> str:
    from cortet.formats.tsv import read_tsv, write_tsv

    rows = [{"case": 'the "left" one', "q": 0.5}, {"case": "b"}]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.tsv"
        write_tsv(rows, ["case", "q"], path)
        table = read_tsv(path)
    _expect(table.to_numpy().tolist() == [['the "left" one', "0.5"], ["b", "n/a"]], "a table is read back changed")
    return "a table is written and read back"


def _prove_tabulate() -> str:
    import pandas as pd

    lines = pd.DataFrame({"q": ["0.50"]}).to_markdown(index=False, tablefmt="github", disable_numparse=True)
    _expect([line.strip("| ") for line in lines.splitlines()][::2] == ["q", "0.50"], "Markdown has other cells")
    return "a table is printed in Markdown"


def _prove_pyvista() -> str:
    from cortet.report.render import picture

    mesh, _ = _icosahedron()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.png"
        picture(mesh, path, position=1.0, size=(200, 200))
        colours = _colours(path)
    _expect(colours > 10, f"the picture of a mesh has {colours} colours")
    return f"a mesh is drawn without a display, in {colours} colours"


def _colours(picture: Path) -> int:
    import matplotlib.image
    import numpy as np

    return len(np.unique(matplotlib.image.imread(picture).reshape(-1, 3), axis=0))


def _prove_jinja2() -> str:
    from cortet.report.case_page import write_failure_page

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        failure = {"stage": "gate", "state": "failed", "reason": "<script>"}
        write_failure_page("a case", failure, path, surface=None)
        _expect("&lt;script&gt;" in path.read_text(encoding="utf-8"), "a page does not escape what it quotes")
    return "a page escapes what it quotes"


def _prove_trimesh() -> str:
    from cortet.report.boundary_view import three_js

    return f"it brings three.js, {len(three_js()) / 1e6:.2f} MB"


def _prove_snakemake() -> str:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "Snakefile").write_text("rule:\n    output: 'made'\n    shell: 'touch {output}'\n")
        command = [sys.executable, "-m", "snakemake", "--cores", "1", "--quiet", "all", "--directory", folder]
        subprocess.run([*command, "--snakefile", f"{folder}/Snakefile"], check=True, cwd=folder)
        _expect((Path(folder) / "made").exists(), "a rule did not run")
    return "a rule makes its file"


def _prove_slurm_executor() -> str:
    from snakemake.cli import get_argument_parser

    arguments = get_argument_parser().parse_args(["--executor", "slurm", "--jobs", "7"])
    _expect(arguments.executor == "slurm" and arguments.jobs == 7, "Snakemake does not know the executor")
    return "Snakemake knows the executor"


def _prove_meshtool() -> str:
    from cortet.measure.quality import quality
    from cortet.stages._meshtool import clean_with_meshtool

    mesh, _ = _icosahedron()
    before = quality(mesh.points, mesh.cells).max()
    cleaned = clean_with_meshtool(mesh, thresholds=[before - 0.05])
    after = quality(cleaned.points, cleaned.cells).max()
    _expect(after < before, f"the worst q of a bad mesh went from {before:.3f} to {after:.3f}")
    return f"brings the worst q of a bad mesh from {before:.3f} to {after:.3f}"


def _version_line(program: str, option: str) -> str:
    """What a program says of its version; some exit with another code than 0 after it."""
    done = subprocess.run([program, option], capture_output=True, text=True, errors="replace", timeout=60, check=False)
    lines = (line.strip() for line in (done.stdout + done.stderr).splitlines())
    said = next((line for line in lines if any(letter.isdigit() for letter in line)), "")
    _expect(said, f"`{program} {option}` says no version (exit code {done.returncode})")
    return said


def _prove_sbatch() -> str:
    """SLURM's commands say nothing, not even their version, where no cluster is configured."""
    done = subprocess.run(["sbatch", "--version"], capture_output=True, text=True, timeout=60, check=False)
    if done.returncode and "configuration source" in done.stderr:
        return "no cluster is configured here"
    return _version_line("sbatch", "--version")


LIBRARIES = (
    Library("numpy", "arrays", _prove_numpy),
    Library("scipy", "topology, distances", _prove_scipy),
    Library("numba", "kernels of S4", _prove_numba),
    Library("pygalmesh", "S1, as published", lambda: _prove_mesher("pygalmesh"), "libgmp10 libmpfr6"),
    Library("cgal", "S1, second backend; caps on holes (repair)", _prove_cgal),
    Library("tetgen", "S1, where CGAL cannot keep the topology", _prove_tetgen),
    Library("gmsh", "S3", _prove_gmsh, "libglu1-mesa libxft2 libxcursor1 libxinerama1 libgl1"),
    Library("h5py", "FEniCS files", _prove_h5py),
    Library("pymeshlab", "smoothing of the input", _prove_pymeshlab, "libgl1 libopengl0 libegl1"),
    Library("meshio", "CGAL's files, ten-node elements", _prove_meshio),
    Library("nibabel", "GIfTI", _prove_nibabel),
    Library("pydantic", "configuration", _prove_pydantic),
    Library("pyyaml", "configuration", _prove_yaml),
    Library("pandas", "tables", _prove_pandas),
    Library("tabulate", "tables in Markdown", _prove_tabulate),
    Library("matplotlib", "figures", _prove_matplotlib),
    Library("pyvista", "pictures of meshes", _prove_pyvista, "libgl1 libegl1 libxrender1"),
    Library("jinja2", "pages for a browser", _prove_jinja2),
    Library("trimesh", "three.js for the view in them", _prove_trimesh),
    Library("snakemake", "the workflow", _prove_snakemake),
)

#: the extras `slurm`, `baselines` (meshers that experiments compare with) and `gpu`
OPTIONAL = (
    Library("snakemake-executor-plugin-slurm", "jobs on SLURM", _prove_slurm_executor),
    Library("pytetwild", "fTetWild, to compare with", lambda: _prove_baseline("ftetwild")),
    Library("netgen-mesher", "Netgen, to compare with", lambda: _prove_baseline("netgen")),
    Library("numba-cuda", "folding on a GPU", _prove_gpu),
)

PROGRAMS = (
    Program("meshtool", "S4, backend meshtool", _prove_meshtool),
    Program("ccx", "CalculiX, which tests run on Abaqus files", lambda: _version_line("ccx", "-v")),
    Program("wb_command", "Connectome Workbench", lambda: _version_line("wb_command", "-version")),
    Program("conda", "environments of the rules", lambda: _version_line("conda", "--version")),
    Program("sbatch", "SLURM, for profiles/slurm", _prove_sbatch),
)


if __name__ == "__main__":
    # one proof, as `examine` asks for it; what it returns is the last line on standard output
    _say({library.name: library for library in (*LIBRARIES, *OPTIONAL)}[sys.argv[1]].proof())
