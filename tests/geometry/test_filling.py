"""Tetrahedra that do not fill one body, once, are counted and found, each fault under its own name."""

from __future__ import annotations

import time

import numpy as np
import pytest
from shapes import ball_mesh
from wrong_meshes import (
    sound,
    with_body_inside,
    with_hanging_node,
    with_hidden_void,
    with_listed_twice,
    with_parted_nodes,
    with_swapped_nodes,
    with_unused_node,
    with_void,
)

from cortet.errors import InputError
from cortet.geometry.filling import broken_body, flaws, require_body
from cortet.geometry.topology import boundary_surface, enclosed_volume, surface_topology
from cortet.measure.certify import certify
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh

CUBE = sound(4)
TWICE, OVERFULL = "repeated_tetrahedra", "overfull_faces"
FOLDED, VOIDS = "folded_faces", "voids"


def counts(mesh: TetMesh) -> dict[str, int]:
    return {flaw.id: flaw.count for flaw in flaws(mesh) if flaw.count}


def test_sound_meshes_have_no_flaw():
    ball = ball_mesh()
    apart = TetMesh(
        np.concatenate([ball.points, ball.points + 3]), np.concatenate([ball.cells, ball.cells + len(ball.points)])
    )
    for mesh in (CUBE.mesh, ball, apart):
        assert counts(mesh) == {} and broken_body(mesh) == []
    assert counts(with_swapped_nodes(CUBE.mesh)) == {}, "an element listed the wrong way round overlaps nothing"


def test_a_void_that_elements_listed_twice_make_up_for_is_found():
    """All other checks of the certificate are green: this is the mesh that was certified."""
    wrong = with_hidden_void(CUBE.mesh)
    boundary, _ = boundary_surface(wrong)
    assert signed_volumes(wrong.points, wrong.cells).sum() == pytest.approx(CUBE.mesh.points.max() ** 3, rel=1e-12)
    assert enclosed_volume(boundary.points, boundary.faces) == pytest.approx(CUBE.mesh.points.max() ** 3, rel=1e-12)
    assert surface_topology(boundary.faces).problems() == []
    assert counts(wrong)[TWICE] == 48
    certificate = certify(wrong, CUBE.surface, cell_size=CUBE.cell_size)
    failed = {check.id for check in certificate.checks if not check.passed}
    assert failed == set(counts(wrong)) and {TWICE, OVERFULL, FOLDED} <= failed


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (with_void, {"voids": 1}),
        (with_body_inside, {"overlapping_bodies": 1}),
        (with_hanging_node, {"voids": 1}),
        (with_parted_nodes, {"coincident_nodes": 25}),
    ],
)
def test_each_flaw_has_its_name_its_count_and_its_place(fault, expected):
    assert counts(fault(CUBE.mesh)) == expected
    (place,) = (flaw.places[0] for flaw in flaws(with_void(CUBE.mesh)) if flaw.count)
    assert place == pytest.approx([6, 6, 6])


def test_what_is_no_body_is_refused_with_the_file_and_the_place():
    require_body(CUBE.mesh)
    with pytest.raises(InputError, match="x.vtu: .* twice"):
        require_body(with_listed_twice(CUBE.mesh), "x.vtu")
    with pytest.raises(InputError, match="1 nodes"):
        require_body(with_unused_node(CUBE.mesh))


def test_many_bodies_are_looked_at_at_once():
    """Ten thousand loose tetrahedra, a few of which reach into each other: seconds, not hours."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    places = 3.0 * np.stack(np.meshgrid(*[np.arange(22)] * 3), axis=-1).reshape(-1, 1, 3)[:10000]
    places[5] = places[4] + 0.01
    loose = TetMesh((places + corner).reshape(-1, 3), np.arange(40000, dtype=np.int32).reshape(-1, 4))
    began = time.process_time()
    assert counts(loose) == {"overlapping_bodies": 2}
    assert time.process_time() - began < 10
