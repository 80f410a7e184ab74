"""Tetrahedra that do not fill one body, once, are counted and found, each fault under its own name."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_mesh
from wrong_meshes import (
    sound,
    with_listed_twice,
    with_swapped_nodes,
    with_unused_node,
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


def test_what_is_no_body_is_refused_with_the_file_and_the_place():
    require_body(CUBE.mesh)
    with pytest.raises(InputError, match="x.vtu: .* twice"):
        require_body(with_listed_twice(CUBE.mesh), "x.vtu")
    with pytest.raises(InputError, match="1 node belongs"):
        require_body(with_unused_node(CUBE.mesh))
