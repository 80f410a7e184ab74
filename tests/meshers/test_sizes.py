"""Smaller cells where a region or a volume asks for them."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.config import load
from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.geometry.nesting import nested
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, TetMesh
from cortet.stages.generate import generate

H = 2.0


def sizes_at(mesh: TetMesh) -> tuple[FloatArray, FloatArray]:
    """Centres of the tetrahedra, and their cell sizes: the edge of a regular one of that volume."""
    edge = np.cbrt(6 * np.sqrt(2) * signed_volumes(mesh.points, mesh.cells))
    return mesh.points[mesh.cells].mean(axis=1), edge


@pytest.fixture
def spot(tmp_path: Path) -> tuple[str, str]:
    """Volumes of 1 mm voxels around the origin, in which a ball of 3 mm at x = 4 mm is a label, or a size of 0.9 mm."""
    grid = np.stack(np.meshgrid(*[np.arange(-12, 13)] * 3, indexing="ij"), axis=-1)
    inside = np.linalg.norm(grid - [4, 0, 0], axis=-1) < 3
    affine = np.eye(4)
    affine[:3, 3] = -12
    everywhere = np.where(inside, 7, 1).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(everywhere, affine), tmp_path / "dseg.nii.gz")
    nibabel.save(nibabel.Nifti1Image(np.where(inside, 0.9, 0).astype(np.float32), affine), tmp_path / "sizes.nii.gz")
    return str(tmp_path / "dseg.nii.gz"), str(tmp_path / "sizes.nii.gz")


@pytest.mark.parametrize("which", ["labels", "numbers"])
def test_cells_are_small_inside_a_label_and_large_elsewhere(spot, which):
    labels, numbers = spot
    sizes = {f"{labels}:7": 0.9} if which == "labels" else {numbers: None}
    made = cortet.mesh(ball_surface(4, radius=10.0), H, settings={"generate": {"sizes": sizes}}, progress=False)
    assert made.certified
    centre, edge = sizes_at(made.mesh)
    from_spot = np.linalg.norm(centre - [4, 0, 0], axis=1)
    plain = sizes_at(cortet.mesh(ball_surface(4, radius=10.0), H, progress=False).mesh)[1]
    assert np.median(edge[from_spot < 2]) < 0.6 * np.median(plain)
    assert np.median(edge[centre[:, 0] < -3]) == pytest.approx(np.median(plain), rel=0.1)


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


def test_the_seed_turns_the_sources_with_the_surface(spot):
    mesh, _ = generate(ball_surface(4, radius=10.0), Generate(sizes={f"{spot[0]}:7": 0.9}, seed=3), cell_size=H)
    centre, edge = sizes_at(mesh)
    assert np.median(edge[np.linalg.norm(centre - [4, 0, 0], axis=1) < 2]) < 0.65 * np.median(edge[centre[:, 0] < -3])


@pytest.mark.parametrize(
    ("sizes", "word"),
    [
        ({"thalamus": 1.0}, "thalamus"),
        ({"cortex": 0.1}, "0.1 mm"),
        ({"cortex": None}, "no size"),
        ({"LABELS:7": 0.2}, "0.2 mm"),
        ({"LABELS:9": 1.0}, "'9'"),
        ({"LABELS": None}, "labels"),
        ({"gone.nii.gz:1": 1.0}, "gone.nii.gz"),
    ],
)
def test_sizes_that_cannot_be_are_refused_before_any_stage(spot, sizes, word):
    asked = {name.replace("LABELS", spot[0]): size for name, size in sizes.items()}
    with pytest.raises(InputError, match=word):
        cortet.mesh(ball_surface(3, radius=10.0), H, settings={"generate": {"sizes": asked}}, progress=False)


def test_other_meshers_and_cohorts_refuse_them():
    with pytest.raises(InputError, match="mesher cgal"):
        generate(ball_surface(3), Generate(sizes={"cortex": 0.5}), cell_size=1.0, mesher="cgal")
    with pytest.raises(InputError, match="volume"):
        load({"generate": {"sizes": {"dseg.nii.gz:1": 0.5}}}).require_workflow()
    load({"generate": {"sizes": {"white": 0.5}}}).require_workflow()


def test_the_command_takes_sizes(spot, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_surface(ball_surface(4, radius=10.0), tmp_path / "ball.surf.gii")
    command = ["mesh", "ball.surf.gii", "--cell-size", "2", "-o", "ball.vtu"]
    assert main([*command, "--size", "dseg.nii.gz:7=0.9"]) == 0
    first = len(vtu.read(tmp_path / "ball.vtu").cells)
    assert main([*command, "--size", "sizes.nii.gz", "--size", "cortex=1.4"]) == 0
    assert len(vtu.read(tmp_path / "ball.vtu").cells) > first
    assert main([*command, "--size", "thalamus=1"]) == 1
    with pytest.raises(SystemExit):
        main([*command, "--size", "fine"])
