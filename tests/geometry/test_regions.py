"""Two regions: one surface inside another, from `separate` to the certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_surface, real_surface

from cortet.config import load
from cortet.config.stages import Regions, Transfer
from cortet.errors import InputError
from cortet.folding.body import body_of, scale_of, with_interface
from cortet.geometry.closest_point import closest_points, surface_tree, tree_of
from cortet.geometry.intersection import self_intersections
from cortet.geometry.nesting import depths, joined, nested, parents, region_boundary
from cortet.geometry.topology import enclosed_volume, interfaces, sheet, surface_topology
from cortet.measure.certify import certify
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, MeshSets, TriSurface, single_precision
from cortet.pipeline import Meshed, mesh_surface
from cortet.solver_files.sets import named_sets
from cortet.stages.clean import clean
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect
from cortet.stages.separate import separate
from cortet.stages.stage import About, State
from cortet.stages.transfer import transfer

H = 2.0


def ball(radius: float, centre: tuple[float, float, float] = (0, 0, 0), subdivisions: int = 4) -> TriSurface:
    sphere = ball_surface(subdivisions, radius=radius)
    return single_precision(replace(sphere, points=sphere.points + centre))  # as from a file


def volume(surface: TriSurface) -> float:
    return enclosed_volume(surface.points, surface.faces)


@pytest.fixture(scope="module")
def pair() -> TriSurface:
    return nested(ball(14.0), {"white": ball(10.0)})


@pytest.fixture(scope="module")
def meshed(pair: TriSurface) -> Meshed:
    return mesh_surface(State(pair), load({"generate": {"cell_size": H}}))


def test_order_and_parents_follow_from_what_contains_what():
    one, other, deep = ball(4.0, (5, 0, 0)), ball(3.0, (-5, 0, 0)), ball(1.5, (5, 0, 0))
    surface = nested(ball(14.0), {"deep": deep, "other": other, "one": one})
    assert list(surface.inner) == ["one", "other", "deep"] and parents(surface) == [-1, 0, 0, 1]
    bounds = [region_boundary(surface, number) for number in range(4)]
    around = volume(ball(14.0)) - volume(one) - volume(other)
    expected = [around, volume(one) - volume(deep), volume(other), volume(deep)]
    assert [volume(bound) for bound in bounds] == pytest.approx(expected)


def test_two_balls_are_certified_with_known_volumes(pair, meshed):
    certificate = meshed.certificate
    assert certificate.certified, certificate.reasons
    outer, inner = (4 / 3 * np.pi * radius**3 / 1000 for radius in (14, 10))
    cortex, white = certificate.regions
    assert (cortex.name, white.name) == ("cortex", "white")
    assert cortex.volume_ml == pytest.approx(outer - inner, rel=0.03)
    assert white.volume_ml == pytest.approx(inner, rel=0.03)
    assert cortex.volume_ml + white.volume_ml == pytest.approx(certificate.fidelity.volume_ml)
    (interface,) = certificate.interfaces
    assert interface.topology.problems() == [] and interface.misplaced_faces == 0
    assert interface.nodes_to_surface_mm.max < 1e-9 and interface.surface_to_interface_mm.max < 0.2 * H
    assert certificate.quality.q.max < 0.35
    assert cortex.edges_across is not None and cortex.edges_across.least >= 1 and white.edges_across is None
    mesh = meshed.mesh
    centres = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    assert centres[mesh.cell_data[REGION] == 2].max() < 10.01 and centres[mesh.cell_data[REGION] == 1].min() > 9.5
    faces = interfaces(mesh).faces
    normals = np.cross(*(mesh.points[faces[:, i]] - mesh.points[faces[:, 0]] for i in (1, 2)))
    assert (np.einsum("ij,ij->i", normals, mesh.points[faces[:, 0]]) > 0).all(), "the interface looks outward"


def test_more_elements_across_make_the_cortex_finer():
    found = {}
    for across in (1, 3):
        config = load({"generate": {"cell_size": 1.6}, "regions": {"elements_across": across}})
        certificate = mesh_surface(State(nested(ball(11.0), {"white": ball(9.0)})), config).certificate
        assert certificate.certified, certificate.reasons
        found[across] = certificate.regions[0].edges_across
    assert found[1].p5 < 2 <= found[3].p5 and found[3].median >= 3


def test_nested_and_disjoint_regions_are_one_body_each():
    inner = {"white": ball(10.0), "ventricle": ball(4.0, (3, 0, 0)), "deep": ball(3.0, (-5, 0, 0))}
    result = mesh_surface(State(nested(ball(13.0), inner)), load({"generate": {"cell_size": 1.0}}))
    assert result.certificate.certified, result.certificate.reasons
    volumes = {region.name: 1000 * region.volume_ml for region in result.certificate.regions}
    white = volume(ball(10.0)) - volume(ball(4.0)) - volume(ball(3.0))
    assert volumes["white"] == pytest.approx(white, rel=0.03)
    assert volumes["deep"] == pytest.approx(volume(ball(3.0)), rel=0.08)
    around = {one.name: one.around for one in result.certificate.interfaces}
    assert around == {"white": "cortex", "ventricle": "white", "deep": "white"}


def test_the_inner_surface_gives_way_where_the_two_touch():
    inner = ball(10.0, (4.1, 0, 0), subdivisions=5)  # pokes out by 0.1 mm at one end
    surface, report = separate(nested(ball(14.0, subdivisions=5), {"white": inner}), Regions(min_gap=0.5), cell_size=H)
    (did,) = report.surfaces
    moved = np.linalg.norm(surface.inner["white"].points - inner.points, axis=1)
    assert did.crossing_faces_before > 0 and did.moved_max_mm == pytest.approx(1.1, abs=0.1)
    assert depths(tree_of(surface), surface, surface.inner["white"].points)[0].min() > 0.95
    assert did.vertices_moved == (moved > 0).sum() and did.moved_mean_mm == pytest.approx(moved.mean())
    assert moved[inner.points[:, 0] < 5].max() == 0  # nothing moves where there is room
    assert len(self_intersections(joined([surface, surface.inner["white"]]))) == 0
    assert 0 < did.volume_before_ml - did.volume_ml == pytest.approx(did.around_ml - did.around_before_ml)


#: outer and inner surface that do not belong together, and a word of why
STRANGERS: dict[str, tuple[Callable[[], tuple[TriSurface, TriSurface]], str]] = {
    "swapped": (lambda: (ball(10.0), ball(14.0)), "11.5 mL"),
    "shifted": (lambda: (ball(14.0), ball(11.0, (8, 0, 0))), "5.00 mm"),
    "a hole": (lambda: (ball(15.0), replace(ball(12.0), faces=ball(12.0).faces[1:])), "white.*3 open edges"),
    "two species": (
        lambda: (real_surface("pairs/neonatal_dhcp_w28_lh_pial"), real_surface("pairs/adult_fsaverage5_lh_white")),
        "encloses",
    ),
    "two subjects": (
        lambda: (real_surface("pairs/neonatal_dhcp_w28_lh_pial"), real_surface("pairs/neonatal_dhcp_w30_rh_white")),
        "same subject",
    ),
}


@pytest.mark.parametrize("case", STRANGERS)
def test_surfaces_that_do_not_belong_together_are_refused(case):
    make, word = STRANGERS[case]
    outer, inner = make()
    config = load({"generate": {"cell_size": 1.0}, "repair": {"enabled": False}})
    with pytest.raises(InputError, match=word):
        mesh_surface(State(nested(outer, {"white": inner})), config, About(inner={"white": "white.gii"}))


@pytest.mark.parametrize("data", [{"relocate": {"enabled": True}}, {"generate": {"meshers": ["cgal"]}}])
def test_stages_that_know_no_interface_are_refused_beforehand(pair, data):
    with pytest.raises(InputError, match="inner surfaces"):
        mesh_surface(State(pair), load(data))


def test_the_certificate_sees_a_vertex_off_the_interface_and_a_tetrahedron_on_the_wrong_side(meshed):
    mesh, _, surface = meshed
    node = interfaces(mesh).faces[0, 0]
    points = mesh.points.copy()
    points[node] *= 1 + 0.01 / np.linalg.norm(points[node])
    checked = certify(replace(mesh, points=points), surface)
    assert [c.name for c in checked.checks if not c.passed] == [
        "largest distance from a node of the interface white to its surface"
    ]
    region = mesh.cell_data[REGION].copy()
    region[interfaces(mesh).behind[0]] = 2  # a face of it may still be flat on the surface
    region[np.flatnonzero(region == 1)[np.argmax(mesh.points[mesh.cells[region == 1]].mean(axis=1)[:, 0])]] = 2
    checked = certify(replace(mesh, cell_data={REGION: region}), surface)
    assert not checked.certified
    assert "topology problems of the interface white" in [c.name for c in checked.checks if not c.passed]


def test_interface_vertices_slide_on_their_surface_and_edges_are_flipped(pair):
    mesh, _ = generate(pair, cell_size=H)
    rng = np.random.default_rng(0)
    # spoil it: push nodes of the interface along the sphere
    _, nodes = sheet(mesh, 1)
    points = mesh.points.copy()
    points[nodes] += rng.normal(0, 0.15, (len(nodes), 3))
    found = closest_points(surface_tree(pair.inner["white"].points, pair.inner["white"].faces), points[nodes])
    points[nodes] = found.points
    spoilt = replace(mesh, points=points)
    assert (signed_volumes(points, mesh.cells) > 0).all()
    for stage in (clean, reconnect):
        better, _ = stage(spoilt, pair)
        assert quality(better.points, better.cells).max() < quality(points, mesh.cells).max()
        faces, _ = sheet(better, 1)
        assert surface_topology(faces.faces).problems() == []
        white = pair.inner["white"]
        assert closest_points(surface_tree(white.points, white.faces), faces.points).distances.max() < 1e-9
        assert signed_volumes(better.points, better.cells).sum() == pytest.approx(
            signed_volumes(points, mesh.cells).sum(), rel=0.01
        )


def test_the_outer_region_is_what_grows_in_the_direction_across_it(meshed):
    mesh = with_interface(meshed.mesh)
    scale = scale_of(mesh, None)
    body = body_of(mesh, scale)
    cortex = mesh.cell_data[REGION] == 1
    assert body.depth[cortex].max() == 0 and (body.depth[~cortex] >= 9 * body.thickness[~cortex]).all()
    assert body.thickness[cortex] * scale.length == pytest.approx(np.full(cortex.sum(), 4.0), rel=0.06)
    radial = mesh.points[mesh.cells].mean(axis=1)
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", body.normals, radial)[cortex].min() > 0.98
    by_depth = body_of(replace(mesh, cell_data={}, sets=MeshSets()), scale)
    assert by_depth.depth[~cortex].max() > 0 and len(np.unique(by_depth.depth)) > 100
    # an exported mesh, whose regions are sets, has the same body
    exported = named_sets(meshed.mesh, inner=["white"])
    assert (body_of(with_interface(exported), scale).depth == body.depth).all()


@pytest.mark.parametrize("interior", ["nearest", "harmonic"])
def test_fields_of_both_surfaces_are_carried(meshed, interior):
    outer, inner = ball(14.0), ball(10.0)
    ones = {"one": np.ones(len(outer.points))}
    surface = nested(
        replace(outer, point_data={**ones, "area": np.full(len(outer.points), 7, np.int32)}),
        {"white": replace(inner, point_data={"one": np.zeros(len(inner.points)), "deep": inner.points[:, 0]})},
    )
    mesh, report = transfer(replace(meshed.mesh, point_data={}), surface, Transfer(interior=interior))
    outside, within = sheet(mesh, 0)[1], sheet(mesh, 1)[1]
    assert report.fields == {
        "one": "interpolated",
        "area": "label",
        "thickness": "interpolated",
        "deep": "interpolated",
    }
    assert mesh.point_data["one"][outside].min() > 0.999 and mesh.point_data["one"][within].max() < 0.001
    assert (mesh.point_data["area"] == 7).all() and mesh.point_data["thickness"] == pytest.approx(4.0, abs=0.02)
    assert mesh.point_data["deep"][within] == pytest.approx(mesh.points[within, 0], abs=0.02)
    if interior == "harmonic":  # between two concentric spheres: (1 / 10 - 1 / r) / (1 / 10 - 1 / 14)
        radius = np.linalg.norm(mesh.points, axis=1)
        between = np.setdiff1d(np.flatnonzero((radius > 10) & (radius < 13.9)), [*outside, *within])
        exact = (1 / 10 - 1 / radius[between]) / (1 / 10 - 1 / 14)
        assert np.abs(mesh.point_data["one"][between] - exact).max() < 0.05
