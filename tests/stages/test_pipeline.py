"""The line for one surface, from the command down to the files: a ball of 30 mm, coarsely meshed."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapes import ball_surface, real_surface

import cortet
from cortet.config import load
from cortet.formats.gifti import write_surface
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_nodes
from cortet.measure.certify import Certificate
from cortet.measure.fidelity import fidelity
from cortet.meshes import TetMesh, TriSurface
from cortet.pipeline import mesh_surface, run
from cortet.stages import stages_of
from cortet.stages.stage import About, State

FAST = {"generate": {"cell_size": 5.0, "odt": False, "lloyd": False}}


def stages(data: dict[str, Any], *, aged: bool) -> list[str]:
    return [stage.name for stage in stages_of(load(data), aged=aged)]


@pytest.fixture(scope="module")
def ball() -> TriSurface:
    sphere = ball_surface(subdivisions=4, radius=15.0)
    return TriSurface(sphere.points, sphere.faces, {"height": sphere.points[:, 2]})


@pytest.fixture(scope="module")
def file(ball: TriSurface, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("surfaces") / "ball.surf.gii"
    write_surface(ball, path)
    return path


@pytest.fixture(scope="module")
def made(ball: TriSurface, file: Path) -> tuple[TetMesh, Certificate, list[str]]:
    seen: list[str] = []
    mesh, certificate, _ = mesh_surface(
        State(ball), load(FAST), About(source=str(file)), case="ball", progress=lambda step: seen.append(step.stage)
    )
    return mesh, certificate, seen


def test_the_line_has_the_stages_that_the_configuration_enables():
    line = ["repair", "gate", "smooth_surface", "generate", "clean", "reconnect", "solver_ready"]
    assert stages({}, aged=True) == line
    assert stages({"setting": "cgal"}, aged=True) == [*line[:4], "relocate", *line[4:]]
    assert stages({}, aged=False) == line
    by_age = {"smooth_surface": {"method": "published"}}
    assert stages(by_age, aged=False) == [stage for stage in line if stage != "smooth_surface"]
    published = stages({"setting": "published"}, aged=True)
    assert not {"repair", "reconnect"} & set(published)
    snapping = {"clean": {"enabled": False}, "snap": {"enabled": True}}
    assert stages(snapping, aged=False)[4:] == ["reconnect", "snap", "solver_ready"]


def test_the_mesh_is_certified_faithful_and_says_how_it_was_made(made, ball, file):
    mesh, certificate, seen = made
    assert certificate.certified, certificate.reasons
    assert seen == stages(FAST, aged=False)
    assert certificate.quality.q.max < 0.6
    assert fidelity(mesh, ball).nodes_to_surface_mm.max < 1e-3
    nodes = boundary_nodes(mesh)
    assert nodes.tolist() == list(range(len(nodes))), "surface nodes come first"
    assert np.abs(mesh.point_data["height"][nodes] - mesh.points[nodes, 2]).max() < 1e-3, "of the final positions"
    assert list(certificate.reports) == seen and list(certificate.parameters) == [*seen, "certify"]
    assert certificate.parameters["generate"]["cell_size"] == 5.0
    assert certificate.input == {"file": str(file), "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}


def test_a_surface_that_is_not_smoothed_for_want_of_an_age_is_told(ball, caplog):
    next(run(State(ball), load({**FAST, "smooth_surface": {"method": "published"}}), About()))
    assert "not smoothed" in caplog.text


def test_a_surface_with_a_sphere_is_put_onto_the_common_mesh_first(ball):
    inside = ball_surface(subdivisions=4, radius=9.0)
    config = load({**FAST, "resample": {"subdivisions": 5}})
    line = run(State(nested(ball, {"white": inside}), ball), config, About(sphere_file="ball.sphere.gii"))
    first, second = next(line), next(line)
    assert (first.stage, second.stage) == ("resample", "repair") and first.report["inner"]["white"]["resampled"]
    assert first.report["sphere"] == "ball.sphere.gii" and first.parameters["subdivisions"] == 5
    assert len(second.surface.points) == len(second.surface.inner["white"].points) == 10242
    assert np.abs(second.surface.point_data["height"] - second.surface.points[:, 2]).max() < 0.2
    off = load({**FAST, "resample": {"enabled": False}})
    assert next(run(State(ball, ball), off, About())).stage == "repair" == next(run(State(ball), config, About())).stage


def test_inner_surfaces_are_repaired_too(ball):
    inside = TriSurface(0.7 * ball.points, ball.faces[3:])
    outside = TriSurface(ball.points, ball.faces[3:])
    for outer, inner, repaired in ((outside, inside, (True, True)), (ball, inside, (False, True))):
        line = run(State(nested(outer, {"white": inner})), load(FAST), About())
        first, second = next(line), next(line)
        assert (first.report["repaired"], first.report["inner"]["white"]["repaired"]) == repaired
        assert second.stage == "gate"
        assert list(second.surface.inner) == ["white"]


def test_the_native_surface_is_compared_in_mm_whatever_the_unit(ball):
    metres = replace(ball, points=ball.points / 1000)
    made = cortet.mesh((metres.points, metres.faces), settings={**FAST, "gate": {"unit": "m"}}, progress=False)
    assert made.certificate.native is not None
    assert made.certificate.native.native_to_boundary_mm.max < 5.0
    assert abs(made.certificate.native.relative_area_change) < 0.05
    names = [check.id for check in made.certificate.checks if check.limit is not None]
    assert "mean_native_distance" in names


def test_a_real_surface_of_22_weeks_is_certified():
    config = load({"generate": {"cell_size": 2.5}})
    certificate = mesh_surface(State(real_surface("fetal/CRL_STA22_left_white")), config).certificate
    assert certificate.certified, certificate.reasons
