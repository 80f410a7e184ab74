"""Compile the kernels of the GPU for an architecture (8.0) without having one, and say what is in their assembly."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda
from numba.cuda import dispatcher
from shapes import ball_mesh

from cortet.folding import gpu, gpu_kernels
from cortet.folding.body import Material, Scale, body_of
from cortet.folding.contact import contact_of
from cortet.folding.kernels import Motion, workspace
from cortet.geometry.topology import boundary_faces


def own(values: Any) -> Any:
    """A named tuple with arrays as the device has them: contiguous, and not read-only."""
    return type(values)(*(np.array(value) if isinstance(value, np.ndarray) else value for value in values))


architecture = tuple(int(number) for number in sys.argv[1].split("."))
# what functions of the device are compiled for is asked of the device that is there
dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=architecture)

mesh = ball_mesh(1, radius=1.0)
body = body_of(mesh, Scale(np.zeros(3), 1.0))
work, contact = workspace(body), own(contact_of(mesh.points, boundary_faces(mesh), bulk=5.0))
patches, state = own(work.patches), Motion(mesh.points.copy(), mesh.points.copy())
lists = own(gpu.gathered(body, patches, contact))
scratch = gpu_kernels.Scratch(work.slot_volumes, work.slot_forces, work.node_grown, work.ratio, work.external)
sums = (np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros((1, 2)))
tallies = gpu_kernels.Tallies(np.zeros(3, np.int32), np.zeros(2, np.int64), *sums)
arguments = {
    "advance": (
        *(patches, body.held, Material(), state, contact, lists),
        *(np.zeros((1, 1, 3)), np.zeros(1), np.ones(1), 0.1, 6, scratch, tallies),
    ),
    "energies": (patches, Material(), state, lists, np.zeros((1, 3)), 0.1, 6, scratch, tallies),
}
for name, values in arguments.items():
    kernel = getattr(gpu_kernels, name)
    types = tuple(kernel.typeof_pyval(value) for value in values)
    ptx, _ = cuda.compile(kernel.py_func, types, device=False, abi="numba", output="ptx", cc=architecture)
    entry = ptx.split(".entry")[1].split(")")[0]
    sizes = {"64": 8, "32": 4, "16": 2, "8": 1}
    parameters = sum(sizes[bits] for bits in re.findall(r"\.param \.[a-z](\d+)", entry))
    counts = [len(re.findall(pattern, ptx)) for pattern in (r"fma\.rn\.f64", r"\b(?:atom|red)\.", r"\.local\b")]
    sys.stdout.write(f"{name}: {counts[0]} fma {counts[1]} atomic {counts[2]} local {parameters} bytes\n")
    if len(sys.argv) > 2:  # a folder for the assembly, e.g. to see with `ptxas -v -c` what registers it takes
        Path(sys.argv[2], f"{name}.ptx").write_text(ptx)
