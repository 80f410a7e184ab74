"""What a mesh leaves behind: filled sulci and cut-off blades are found, placed and named; nothing else is."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config.sections import Certify
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.measure.lost import distances_to, lost_places
from cortet.meshes import TriSurface

BALL = ball_surface(4, radius=10.0)
TOP, BOTTOM = np.array([0, 0, 1.0]), np.array([0, 0, -1.0])


def pulled(surface: TriSurface, direction: np.ndarray, depth: float, width: float = 2.0) -> TriSurface:
    """The surface with a bump of so many mm, inward where it is negative, around a direction."""
    away = np.linalg.norm(surface.points - 10.0 * direction, axis=1)
    return replace(surface, points=surface.points + depth * np.exp(-((away / width) ** 2))[:, None] * direction)


def test_a_filled_pit_and_a_missing_tip_are_told_apart_and_placed():
    assert distances_to(BALL, BALL).max() < 1e-12 and lost_places(BALL, BALL, limit=1e-6) == []
    surface = pulled(pulled(BALL, TOP, -4.0), BOTTOM, 3.0)
    pit, tip = lost_places(BALL, surface, limit=1.0)
    assert (pit.kind, tip.kind) == ("filled", "cut off")
    assert pit.distance_mm == pytest.approx(4.0, rel=0.05) and pit.place_mm == pytest.approx((0, 0, 6.0), abs=0.3)
    assert tip.distance_mm == pytest.approx(3.0, rel=0.05) and tip.place_mm == pytest.approx((0, 0, -13.0), abs=0.3)
    assert 0 < tip.vertices <= pit.vertices < len(surface.points) / 10


def test_the_certificate_refuses_a_filled_sulcus_though_every_node_is_on_the_surface():
    mesh = ball_mesh(4, radius=10.0)
    boundary, _ = boundary_surface(mesh)
    surface = pulled(boundary, TOP, -4.0)
    limits = Certify(q_max=0.9999, max_boundary_distance=None)
    checked = certify(mesh, surface, limits, cell_size=2.0)
    assert not checked.certified
    assert len(checked.reasons) == 2, "centres of the faces across the mouth are far from the surface, too"
    (reason,) = (one for one in checked.reasons if one.startswith("largest distance from the surface"))
    assert "1 mm" in reason and "filled, at (0.00, 0.00, 6.00) mm" in reason
    unlimited = {check.id: check for check in certify(mesh, surface, limits).checks}["surface_distance"]
    assert unlimited.limit is None and unlimited.passed and unlimited.value > 3, "no cell size, no limit"
    assert checked.lost_places[0].kind == "filled"
    assert certify(mesh, boundary, limits, cell_size=2.0).certified


def test_a_shrunken_mesh_is_refused_for_its_area_and_volume():
    mesh = ball_mesh(3, radius=9.0)
    checked = certify(mesh, ball_surface(3, radius=10.0), Certify(q_max=0.9999, max_boundary_distance=None))
    area, volume = checked.reasons
    assert "area" in area and "volume: 0.271" in volume
