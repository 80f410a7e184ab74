"""Tetrahedra that do not fill one body, once, are counted and found, each fault under its own name."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_mesh
from wrong_meshes import (
    sound,
    with_body_inside,
    with_hanging_node,
    with_listed_twice,
    with_parted_nodes,
    with_swapped_nodes,
    with_unused_node,
    with_void,
)

from cortet.errors import InputError
from cortet.geometry.filling import broken_body, flaws, require_body
from cortet.meshes import TetMesh

CUBE = sound(4)


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
