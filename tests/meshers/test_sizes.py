"""Smaller cells where a region asks for them."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.geometry.nesting import nested
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, TetMesh
from cortet.stages.generate import generate

H = 2.0


def sizes_at(mesh: TetMesh) -> tuple[FloatArray, FloatArray]:
    """Centres of the tetrahedra, and their cell sizes: the edge of a regular one of that volume."""
    edge = np.cbrt(6 * np.sqrt(2) * signed_volumes(mesh.points, mesh.cells))
    return mesh.points[mesh.cells].mean(axis=1), edge


def test_a_region_asks_at_its_surface_alone():
    pair = nested(ball_surface(4, radius=14.0), {"white": ball_surface(4, radius=9.0)})
    plain, _ = generate(pair, cell_size=H)
    for region, radius, other in (("white", 9.0, 14.0), ("cortex", 14.0, 9.0)):
        fine, _ = generate(pair, Generate(sizes={region: 1.0}), cell_size=H)
        sizes = [
            [np.median(edge[np.abs(np.linalg.norm(centre, axis=1) - r) < 0.7]) for r in (radius, other)]
            for centre, edge in map(sizes_at, (fine, plain))
        ]
        assert sizes[0][0] < 0.75 * sizes[1][0]
        assert sizes[0][1] == pytest.approx(sizes[1][1], rel=0.25)


@pytest.mark.parametrize(
    ("sizes", "word"),
    [({"thalamus": 1.0}, "thalamus"), ({"cortex": 0.1}, "0.1 mm"), ({"dseg.nii.gz:7": 1.0}, "name one of cortex")],
)
def test_sizes_that_cannot_be_are_refused(sizes, word):
    with pytest.raises(InputError, match=word):
        cortet.mesh(ball_surface(3, radius=10.0), H, settings={"generate": {"sizes": sizes}}, progress=False)


def test_other_meshers_refuse_them():
    with pytest.raises(InputError, match="mesher cgal"):
        generate(ball_surface(3), Generate(sizes={"cortex": 0.5}), cell_size=1.0, mesher="cgal")
