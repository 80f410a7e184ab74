"""A certificate says yes only when everything is right, and otherwise what, where, why, and what to change."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import horseshoe
from wrong_meshes import touching

from cortet.config.sections import Certify
from cortet.errors import InputError
from cortet.geometry.banks import banks, slits
from cortet.geometry.closest_point import tree_of
from cortet.geometry.thickness import gaps
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import SCHEMA, Certificate, certify
from cortet.measure.checks import KINDS, Check, Number, checked, remedies
from cortet.measure.quality import quality
from cortet.meshes import TetMesh, TriSurface
from cortet.report.numbers import of_check


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return cube_mesh(4, side=8.0)


@pytest.fixture(scope="module")
def surface(mesh: TetMesh) -> TriSurface:
    return boundary_surface(mesh)[0]


#: of another size than its surface, and anywhere
ANY_SIZE = Certify(max_boundary_distance=None, max_area_change=None, max_volume_change=None)


def failed(certificate: Certificate) -> set[str]:
    return {check.id for check in certificate.checks if not check.passed}


def test_a_good_mesh_is_certified_with_every_number_beside_its_limit(mesh, surface):
    certificate = certify(mesh, surface, case="sub-01_hemi-L")
    assert certificate.certified
    assert certificate.reasons == ()
    checks = {check.id: check for check in certificate.checks}
    assert checks["worst_q"].value == certificate.quality.q.max
    assert (checks["worst_q"].comparison, checks["worst_q"].limit) == ("<", 0.6)
    assert checks["boundary_euler_number"].value == 2
    assert all(check.passed for check in certificate.checks)
    names = {check.id: check.name for check in certify(mesh, surface, native=surface).checks}
    assert names.items() <= {key: kind.name for key, kind in KINDS.items()}.items() and certificate.schema == SCHEMA
    q_max = certificate.quality.q.max  # the limit of q is strict
    assert failed(certify(mesh, surface, Certify(q_max=q_max))) == {"worst_q"}
    assert certify(mesh, surface, Certify(q_max=np.nextafter(q_max, 1))).certified


def test_a_missed_limit_comes_with_number_place_reason_and_remedy(surface):
    jittered = cube_mesh(4, side=8.0, jitter=0.3)
    certificate = certify(jittered, surface)
    (reason,), worst = certificate.reasons, certificate.worst_elements[0]
    bad = (quality(jittered.points, jittered.cells) >= 0.6).sum()
    for said in (
        f"{bad} elements",
        f"{worst.q:.4g}",
        "({:.2f}, {:.2f}, {:.2f}) mm".format(*worst.centre_mm),
        worst.reason,
        "`clean`",
    ):
        assert said in reason


@pytest.mark.parametrize(
    ("value", "comparison", "limit", "said"),
    [
        (0.0561234, "<=", 0.05, "0.05612 (must not exceed 0.05)"),
        (0.60004, "<", 0.6, "0.60004 (must be below 0.6)"),
        (0.1 + 0.2, "<=", 0.3, "0.30000000000000004 (must not exceed 0.3)"),
        (0.1234568, "<=", 0.12345674, "0.1235 (must not exceed 0.123457)"),
        (1234567, "==", 0, "1,234,567 (must be 0)"),
        (0.0561234, None, None, "0.05612 (no limit)"),
    ],
)
def test_a_number_has_few_digits_but_tells_on_which_side_of_its_limit_it_is(value, comparison, limit, said):
    check = Check("worst_q", "worst q", value, "", comparison, limit, False, "")
    assert check.finding == f"worst q: {said}"
    assert of_check(asdict(check))["value"] == said.partition(" ")[0]


def with_tunnel(mesh: TetMesh) -> TetMesh:
    """A square tunnel from bottom to top; every element is good."""
    hole = (np.abs(mesh.points[mesh.cells].mean(axis=1)[:, :2] - 3) < 1).all(axis=1)
    nodes = np.unique(mesh.cells[~hole])
    return TetMesh(mesh.points[nodes], np.searchsorted(nodes, mesh.cells[~hole]))


def test_a_tunnel_through_good_elements_is_refused(mesh, surface):
    assert failed(certify(with_tunnel(mesh), surface, ANY_SIZE)) == {"boundary_euler_number"}


def test_two_cubes_are_refused_with_the_place_where_they_touch(mesh, surface):
    certificate = certify(touching(mesh, 8, 8, 0), surface, ANY_SIZE)
    assert "nonmanifold_edges" in failed(certificate)
    assert (8.0, 8.0) in {place[:2] for place in certificate.defects_mm}
    assert "(8.00, 8.00, " in " ".join(certificate.reasons)
    assert "boundary_components" in failed(certify(touching(mesh, 20, 0, 0), surface, ANY_SIZE))


def test_a_boundary_that_passes_through_itself_is_refused_with_the_place(surface):
    # two towers on one slab, of which the left is bent through the right
    block = cube_mesh(6, side=6.0)
    centre = block.points[block.cells].mean(axis=1)
    slit = (np.abs(centre[:, 0] - 3) < 1) & (centre[:, 2] > 2)
    nodes = np.unique(block.cells[~slit])
    points = block.points[nodes].copy()
    left = (points[:, 0] < 3) & (points[:, 2] > 2)
    points[left, 0] += 0.9 * (points[left, 2] - 2)  # a shear keeps all volumes
    towers = TetMesh(points, np.searchsorted(nodes, block.cells[~slit]))
    certificate = certify(towers, surface, ANY_SIZE.model_copy(update={"q_max": 0.9999}))
    assert failed(certificate) == {"crossing_faces"}
    assert 0 < len(certificate.crossings_mm) <= 10


def test_a_boundary_off_the_surface_is_refused_unless_there_is_no_limit(mesh, surface):
    away = replace(mesh, points=mesh.points * 1.01)
    certificate = certify(away, surface, Certify(max_boundary_distance=1e-3))
    assert failed(certificate) == {"node_distance"} and "0.1386 mm" in certificate.reasons[0]
    assert certify(away, surface, ANY_SIZE).certified


def test_what_s1_found_wrong_cannot_be_hidden_by_later_stages(mesh, surface):
    certificate = certify(mesh, surface, reports={"generate": {"topology_ok": False, "reason": "two banks fused"}})
    assert not certificate.certified
    assert "two banks fused" in certificate.reasons[0]


@pytest.mark.parametrize(
    ("mesher", "says", "not_says"),
    [
        ("lattice", "use a smaller cell size", "mesher `lattice`"),
        ("cgal", "the mesher `lattice`", "another surface"),
        (None, "the mesh was made from another surface", "mesher `lattice`"),
    ],
)
def test_a_remedy_fits_what_filled_the_surface_and_names_a_cell_size(mesher, says, not_says):
    failed, passed = (Number("surface_distance", value, 1.0, remedies(mesher).loss) for value in (2.0, 0.5))
    remedy = checked(failed).remedy
    assert says in remedy and not_says not in remedy
    assert ("1.1 mm" in checked(failed, 1.5).remedy) == ("smaller cell size" in remedy)
    assert checked(passed, 1.5) == checked(passed)


def test_the_record_is_plain_json_and_the_same_every_time(mesh, surface, tmp_path):
    source = tmp_path / "x.surf.gii"
    source.write_bytes(b"surface")
    records = [
        json.dumps(asdict(certify(mesh, surface, source=source, parameters={"clean": {"version": 1}})), allow_nan=False)
        for _ in range(2)
    ]
    assert records[0] == records[1]
    record = json.loads(records[0])
    assert record["input"]["sha256"] == hashlib.sha256(b"surface").hexdigest()
    assert record["parameters"] == {"clean": {"version": 1}}
    with pytest.raises(InputError, match="gone.surf.gii"):
        certify(mesh, surface, source="gone.surf.gii")
    assert {"cortet", "python", "numpy", "numba", "gmsh"} <= set(record["versions"])


def test_a_gap_that_the_surface_has_is_no_slit():
    """The ends of a horseshoe face each other, nearer than an edge: the surface has that gap, too."""
    narrow = horseshoe(0.3)
    found = banks(narrow, narrow)
    assert found.least_share == pytest.approx(1)
    end = 0.3 / 5 / 2  # radians
    place, normal = np.array([[np.cos(end), np.sin(end), 0]]) * 5, np.array([[np.sin(end), -np.cos(end), 0]])
    assert gaps(tree_of(narrow), place, normal, 2.0) == pytest.approx([0.3], rel=1e-3)
    closed = horseshoe(0.006)
    assert banks(closed, narrow).least_share < 0.03
    faces = slits(closed, narrow, 0.03)
    assert len(faces) and np.abs(closed.points[closed.faces[faces]].mean(axis=1)[:, 1]).max() < 0.01  # of both ends
    assert not len(slits(narrow, narrow, 0.03)) and not len(slits(closed, narrow, 0.01))
    hub = int(np.abs(narrow.points - np.array([5 * np.cos(0.03), 5 * np.sin(0.03), 0])).sum(axis=1).argmin())
    for left in (1e-6, 1e-3):  # one node of an end is put onto the other end, but for this
        points = narrow.points.copy()
        points[hub, 1] = left - points[hub, 1]
        spiked = TriSurface(points, narrow.faces)
        found = banks(spiked, narrow)
        assert found.gap_mm == pytest.approx(left, rel=0.05) and found.least_share < 0.03
        assert hub in narrow.faces[slits(spiked, narrow, 0.03)]


def test_centres_of_faces_far_from_the_surface_are_refused(mesh, surface):
    moved = TriSurface(surface.points + np.array([0, 0, 0.5]), surface.faces)
    certificate = certify(mesh, moved, Certify(max_boundary_distance=None, max_surface_distance=None), cell_size=0.6)
    assert "face_centre_distance" in failed(certificate)
    assert "0.45 mm" in " ".join(certificate.reasons)
    assert certify(mesh, moved, Certify(max_boundary_distance=None)).certified, "the cell size is not known"


def test_the_native_surface_is_compared_both_ways_and_checked(mesh, surface):
    native = TriSurface(surface.points * 1.05, surface.faces)
    limits = {"max_native_distance": 0.5, "max_mean_native_distance": 0.1, "max_native_area_change": 0.06}
    certificate = certify(mesh, surface, Certify(**limits), native=native, cell_size=1.0)
    assert certificate.native is not None
    assert certificate.native.relative_area_change == pytest.approx(1 / 1.05**2 - 1)
    assert certificate.native.native_to_boundary_mm.max == pytest.approx(0.4 * np.sqrt(3))
    assert certificate.native.boundary_to_native_mm.max == pytest.approx(0.4)
    assert failed(certificate) == {"native_distance", "mean_native_distance", "native_area_change"}
    unlimited = Certify(**dict.fromkeys(limits))
    assert certify(mesh, surface, unlimited, native=native, cell_size=1.0).certified, "without limits"


def test_a_broken_native_surface_is_no_obstacle(mesh, surface):
    points, faces = surface.points.copy(), surface.faces[5:].copy()
    points[7] = np.nan
    faces[3] = faces[4]
    native = certify(mesh, surface, native=TriSurface(points, faces)).native
    assert native is not None and native.native_to_boundary_mm.max < 1e-9 < native.boundary_to_native_mm.max
    nothing = TriSurface(np.full((3, 3), np.nan), np.array([[0, 1, 2]], np.int32))
    assert certify(mesh, surface, native=nothing).native is None


@pytest.mark.parametrize("size", [1e308, 0.0, np.nan])
def test_a_cell_size_beyond_its_bounds_or_of_another_unit_is_refused(mesh, surface, size):
    with pytest.raises(InputError, match="0.05 to 20"):
        certify(mesh, surface, cell_size=size)
    assert certify(mesh, surface, cell_size=2.0).certified
    small = replace(mesh, points=mesh.points / 1000)
    with pytest.raises(InputError, match="metres"):
        certify(small, boundary_surface(small)[0], cell_size=2.0)
