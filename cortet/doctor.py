"""`cortet doctor`: the version of every dependency, and a proof that those which are compiled work.

A successful import proves little: Gmsh's wheel loads libraries of the system, pygalmesh is compiled at installation,
and Numba compiles when it is called. So each of them is used, in a process of its own, as a library may crash.
This module imports no dependency at the top, so that the doctor always answers.
"""

from __future__ import annotations

import platform
import shutil
import signal
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

from cortet.version import __version__

#: seconds that one proof may take; the first compilation of the kernels takes by far the longest
TIME_LIMIT = 600
SET_UP = "rm -f .venv/.stamp && make setup"
#: either one is enough for S1
MESHERS = ("pygalmesh", "cgal")
LIBRARIES = (
    *("numba", *MESHERS, "gmsh", "pymeshlab", "pyvista", "cyclopts", "h5py", "jinja2", "matplotlib", "meshio"),
    *("nibabel", "numpy", "pandas", "pydantic", "pyyaml", "scipy", "snakemake", "tetgen", "threadpoolctl"),
)
#: the extras `slurm` and `baselines` (meshers that experiments compare with)
OPTIONAL = ("snakemake-executor-plugin-slurm", "pytetwild", "netgen-mesher")
#: programs that an option calls, or that tests run
PROGRAMS = ("meshtool", "wb_command", "sbatch", "ccx")


#: package -> code that uses it, and the Debian packages of the system libraries that it loads
PROOFS = {
    "numba": ("from cortet.pipeline import warm_up; warm_up()", ""),
    "pygalmesh": ("import pygalmesh", "libgmp10 libmpfr6"),
    "cgal": ("from CGAL import CGAL_Mesh_3", ""),
    "gmsh": ("import gmsh; gmsh.initialize()", "libglu1-mesa libxft2 libxcursor1 libxinerama1 libgl1"),
    "pymeshlab": ("import pymeshlab; pymeshlab.MeshSet()", "libgl1 libopengl0 libegl1"),
    "pyvista": ("import pyvista; pyvista.Sphere().plot(off_screen=True)", "libgl1 libegl1 libxrender1"),
}


def run() -> int:
    """Print every dependency and the problems; return 0 if everything required works, else 1."""
    _say(f"cortet {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}\n")
    versions = {name: _version(name) for name in (*LIBRARIES, *OPTIONAL)}
    wrong = []
    for name, found in versions.items():
        failure = proved(name) if found and name in PROOFS else ""
        state = "FAILED" if failure else "works" if name in PROOFS and found else ""
        _say(f"{name:<34}{found or 'not installed':<26}{state}".rstrip())
        if failure:
            system = f"apt-get install {PROOFS[name][1]}; else " if PROOFS[name][1] else ""
            wrong.append(f"{name}: {failure}\n  remedy: {system}{SET_UP}")
    for name in PROGRAMS:
        _say(f"{name:<34}{shutil.which(name) or 'optional, not found'}")
    wrong += [f"{name}: not installed\n  remedy: {SET_UP}" for name in missing(versions)]
    _say("", *(wrong or ["Everything cortet needs works."]))
    return 1 if wrong else 0


def missing(versions: dict[str, str]) -> list[str]:
    """Required libraries that are not installed; one package that runs CGAL is enough."""
    dispensable = {*OPTIONAL, *(MESHERS if any(versions.get(name) for name in MESHERS) else ())}
    return [name for name, found in versions.items() if not found and name not in dispensable]


def proved(name: str) -> str:
    """Use a library in a process of its own; why that failed, or "" if it works."""
    command = [sys.executable, "-c", PROOFS[name][0]]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {TIME_LIMIT} s"
    if done.returncode < 0:
        return f"crashed ({signal.Signals(-done.returncode).name})"
    return (done.stderr.strip() or "said nothing").splitlines()[-1] if done.returncode else ""


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{line}\n" for line in lines)
    sys.stdout.flush()
