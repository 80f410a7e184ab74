"""Values between a mesh and the surface that it was made from: what comes back, and at what cost.

    python benchmarks/home.py SURFACE... [--cell-size 1.6] [--sphere SPHERE]

Nothing is smoothed. Prints for each surface how many vertices kept their number; the largest error of x, y and z of the
input at the nodes of the boundary, where triangles are those of the input and elsewhere (mm); the error of a smooth
field, a harmonic of degree 8, after the way there and back, over its root mean square; and CPU seconds and bytes of
both matrices per million tetrahedra.

The error is that of linear interpolation on the faces of the boundary: on a sphere of radius r and equilateral faces of
edge a it is about l (l + 1) a^2 / (16 r^2) for degree l.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.special import sph_harm_y

import cortet
from cortet.errors import CortetError
from cortet.geometry.topology import boundary_nodes


def main() -> None:
    """Print a row for each surface."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--cell-size", type=float, default=1.6)
    parser.add_argument("--sphere", type=Path, help="of the surface, through which it is resampled")
    options = parser.parse_args()
    print(f"{'surface':<44}{'kept':>16}{'x, y, z':>10}{'elsewhere':>10}{'harmonic':>10}{'CPU s/M':>9}{'MB/M':>7}")
    for path in options.surfaces:
        settings = {"smooth_surface": {"enabled": False}}
        try:
            made = cortet.mesh(path, options.cell_size, sphere=options.sphere, settings=settings, progress=False)
        except CortetError as error:
            print(f"{path.name:<44}{error}")
            continue
        began = time.process_time()
        found = made.surface_map()
        seconds = time.process_time() - began
        nodes, given = boundary_nodes(made.mesh), found.native.points
        wrong = np.abs(made.from_surface(given)[nodes] - made.points[nodes]).max(axis=1)
        # a node whose corners have all kept their number lies on a triangle of the input
        exact = (abs(found.from_surface[nodes]) @ (~found.kept).astype(float)) == 0
        x, y, z = (given - given.mean(axis=0)).T
        field = sph_harm_y(8, 4, np.arccos(z / np.sqrt(x * x + y * y + z * z)), np.arctan2(y, x)).real
        back = made.to_surface(made.from_surface(field)) - field
        harmonic = np.sqrt(np.nanmean(back**2) / (field**2).mean())
        size = sum(
            one.data.nbytes + one.indices.nbytes + one.indptr.nbytes for one in (found.to_surface, found.from_surface)
        )
        millions = len(made.cells) / 1e6
        print(
            f"{path.name:<44}{f'{found.kept.sum()}/{len(given)}':>16}{wrong[exact].max(initial=0):>10.1e}"
            f"{wrong[~exact].max(initial=0):>10.1e}{harmonic:>10.4f}"
            f"{seconds / millions:>9.1f}{size / 1e6 / millions:>7.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
