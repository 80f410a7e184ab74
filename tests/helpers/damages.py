"""Valid files of every kind, damaged at random, and what each reader makes of them."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import nibabel
import nibabel.freesurfer.io as freesurfer
import numpy as np
import trimesh
import yaml
from exported import full_mesh
from shapes import ball_surface

from cortet.cohort.scan import scan
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.config import Config, load
from cortet.config.stages import Repair
from cortet.errors import CortetError
from cortet.formats import FORMATS, read_mesh
from cortet.formats.gifti import read_label_names, read_surface, write_surface
from cortet.formats.volumes import read_volume
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.export import convert, export
from cortet.solver_files.fields import with_fields
from cortet.solver_files.volumes import backgrounds
from cortet.stages.gate import gate
from cortet.stages.repair import repair

#: kind -> a valid file, and what reads it
Seeds = dict[str, tuple[Path, Callable[[Path], Any]]]


#: what takes the place of a number or a word
WRONG = (b"", b"-1", b"0", b"1.5", b"2147483648", b"1000000000000", b"nan", b"inf", b"1e999", b"x", b"\xff\xfe")
NUMBER, WORD = rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", rb"[A-Za-z_]{2,40}"


def cut_or_turned(data: bytes, rng: random.Random) -> bytes:
    """The end missing, a bit turned, a span missing, or a span twice."""
    start = rng.randrange(len(data) + 1)
    span = data[start : start + rng.choice([1, 8, 500])]
    rest = data[start + len(span) :]
    turned = bytes(byte ^ 1 << rng.randrange(8) for byte in span[:1]) + span[1:]
    return rng.choice([data[:start], *(data[:start] + new + rest for new in (turned, b"", span * 2))])


def with_another(pattern: bytes) -> Callable[[bytes, random.Random], bytes]:
    """A number or a word that is another one; half of the time near the head, which says how long everything is."""

    def changed(data: bytes, rng: random.Random) -> bytes:
        found = [match.span() for match, _ in zip(re.finditer(pattern, data), range(3000), strict=False)]
        if not found:
            return data
        start, end = rng.choice(found[:20] if rng.random() < 0.5 else found)
        return data[:start] + rng.choice(WRONG) + data[end:]

    return changed


def with_lines_changed(data: bytes, rng: random.Random) -> bytes:
    """A line deleted, repeated or longer."""
    lines = data.split(b"\n")
    place = rng.randrange(len(lines))
    lines[place : place + 1] = rng.choice([[], [lines[place]] * 2, [lines[place] + b"\t1"]])
    return b"\n".join(lines)


def with_binary_number_changed(data: bytes, rng: random.Random) -> bytes:
    """Four bytes replaced by another number, half of the time in the head."""
    raw = np.array([rng.choice([0, 1, -1, 255, 2**31 - 1, -(2**31)])], rng.choice(["<i4", ">i4", "<f4"])).tobytes()
    place = rng.randrange(max(min(len(data), rng.choice([400, 1 << 30])) // 4, 1)) * 4
    return data[:place] + raw + data[place + 4 :]


DAMAGES = (cut_or_turned, with_another(NUMBER), with_another(WORD), with_lines_changed, with_binary_number_changed)


def seeds(folder: Path) -> Seeds:
    """A valid file of every kind in a folder of its own, and what reads it."""
    surface = ball_surface(2, 30.0)
    count = len(surface.points)
    fields = {"thickness": np.linspace(1, 2, count, dtype="f4"), "area": (np.arange(count) // 60).astype(np.int32)}
    surface = replace(surface, point_data=fields)
    return {
        **meshes(surface, folder),
        **of_other_programs(surface, folder),
        **volumes(surface, folder),
        **texts(folder),
    }


def placed_in(folder: Path, kind: str, name: str) -> Path:
    """A path in a folder of its own."""
    (folder / kind).mkdir()
    return folder / kind / name


def meshes(surface: TriSurface, folder: Path) -> Seeds:
    """A mesh in every format that is read, and the surface in GIfTI."""
    mesh, found = full_mesh(2, side=60.0), Seeds()
    for name, form in FORMATS.items():
        path = folder / name / f"m{form.suffix}"
        export(mesh, path, solver=name)
        if name not in ("braingrowth", "febio"):  # which cortet only writes
            found[name] = (path, read_and_convert)
    found["xdmf_of_meshio"] = (path := placed_in(folder, "xdmf_of_meshio", "m.xdmf"), read_mesh)
    meshio.xdmf.write(path, meshio.Mesh(mesh.points, [("tetra", mesh.cells)], {"height": mesh.points[:, 2]}))
    readers = {
        "gate": lambda path: gate(read_surface(path), source=str(path))[0],
        "repair": repaired,
        "fields": lambda path: read_all_fields(path, surface),
    }
    for name, read in readers.items():
        found[name] = (placed_in(folder, name, "s.surf.gii"), read)
        write_surface(surface, found[name][0])
    return found


def of_other_programs(surface: TriSurface, folder: Path) -> Seeds:
    """The surface and its fields as other programs write them."""
    mesh, found = trimesh.Trimesh(surface.points, surface.faces, process=False), Seeds()
    for name, kind in {"text_stl": "stl_ascii", "ply": "ply", "text_ply": "ply", "obj": "obj", "off": "off"}.items():
        content = mesh.export(file_type=kind, **({"encoding": "ascii"} if name == "text_ply" else {}))
        found[name] = (placed_in(folder, name, f"s.{kind}"), read_surface)
        found[name][0].write_bytes(content.encode() if isinstance(content, str) else content)
    paths = [placed_in(folder, name, f"lh.{name}") for name in ("white", "thickness", "annot")]
    freesurfer.write_geometry(str(paths[0]), surface.points, surface.faces)
    freesurfer.write_morph_data(str(paths[1]), surface.point_data["thickness"])
    table = np.array([[number, 5, 25, 0, 0] for number in range(40)])
    names = [f"label {number}" for number in range(40)]
    freesurfer.write_annot(str(paths[2]), surface.point_data["area"], table, names, fill_ctab=True)
    readers = [read_surface, *[lambda path: read_all_fields(path, surface)] * 2]
    return found | {path.parent.name: (path, read) for path, read in zip(paths, readers, strict=True)}


def volumes(surface: TriSurface, folder: Path) -> Seeds:
    """Images around the surface: labels with names, of 8 bits and compressed, numbers and tensors."""
    shape, affine = (14, 14, 14), np.diag([5.0, 5.0, 5.0, 1.0])
    affine[:3, 3] = -33
    labels = 1 + (np.indices(shape)[0] > 7).astype(np.int16)
    tensors = np.broadcast_to(np.array([1.0, 0.1, 0.1, 1.1, 0.1, 1.2], np.float32), (*shape, 6))
    images = {
        "dseg.nii": nibabel.Nifti1Image(labels, affine),
        "aseg.mgz": nibabel.MGHImage(labels.astype(np.uint8), affine),
        "fa.nii.gz": nibabel.Nifti1Image(np.random.default_rng(0).random(shape, np.float32), affine),
        "dti.nii": nibabel.Nifti1Image(tensors, affine),
    }
    found: Seeds = {}
    for name, image in images.items():
        path = placed_in(folder, name.partition(".")[0], name)
        nibabel.save(image, path)
        found[path.parent.name] = (path, lambda path: read_and_use_volume(path, surface))
    (folder / "dseg" / "dseg.tsv").write_text("index\tname\n1\tleft\n2\tright\n")
    return found


def texts(folder: Path) -> Seeds:
    """A sheet, a configuration, and a release to scan."""
    sheet, config = placed_in(folder, "sheet", "cohort.tsv"), placed_in(folder, "config", "config.yaml")
    write_sheet([Case(f"0{n}", "1", "L", 24.5, folder / "s.surf.gii", extra={"site": "x"}) for n in range(4)], sheet)
    config.write_text(yaml.safe_dump(Config().model_dump(mode="json")))
    anat = folder / "release" / "sub-A" / "anat"
    anat.mkdir(parents=True)
    (anat / "sub-A_hemi-L_wm.surf.gii").touch()
    release = folder / "release" / "participants.tsv"
    release.write_text("participant_id\tscan_age\nsub-A\t28.5\nsub-B\tn/a\n")
    release.with_suffix(".json").write_text('{"scan_age": {"Units": "weeks", "Description": "at scan"}}')
    return {
        "sheet": (sheet, read_sheet),
        "config": (config, load),
        "release": (release, lambda path: scan(path.parent)),
    }


def read_and_use_volume(path: Path, surface: TriSurface) -> Any:
    """What is made of a volume that lies around the surface."""
    volume = read_volume(path)
    backgrounds({"v": volume}, surface)
    return volume


def repaired(path: Path) -> TriSurface:
    """What the gate lets in of a repaired file."""
    given = read_surface(path, finite=False)
    return gate(repair(given, Repair(max_hole=50.0), source=str(path))[0], source=str(path))[0]


def read_and_convert(path: Path) -> Any:
    """What a reader makes of a file, which `cortet convert` has to do with as well, unless it is a surface."""
    if path.name.endswith((".stl", ".gii")):
        return read_surface(path)
    found = read_mesh(path)
    convert(path, path.with_name("other.stl"))
    return found


def read_all_fields(path: Path, surface: TriSurface) -> Any:
    """What is read of a file that holds fields only."""
    read_label_names(path)
    return with_fields(surface, {"thickness": path})


def outcome(read: Callable[[Path], Any], path: Path) -> str:
    """`sound` or `refused`, or what is wrong with the one or the other; any other error than ours ends the test."""
    try:
        result = read(path)
    except CortetError as error:
        return "refused" if len(str(error)) < 20_000 else f"a message of {len(str(error)):,} characters"
    # meshes and surfaces check their indices and fields as they are made
    finite = not isinstance(result, TriSurface | TetMesh) or np.isfinite(result.points).all()
    return "sound" if finite else "coordinates that are not finite"


def place_damaged(valid: Path, rng: random.Random, folder: Path) -> Path:
    """A copy of a valid file and of those beside it, one of which is damaged; its path."""
    shutil.copytree(valid.parent, folder)
    files = sorted(path for path in folder.iterdir() if path.is_file())
    target = rng.choice(files) if rng.random() < 0.5 else folder / valid.name
    data = target.read_bytes()
    for _ in range(rng.choice([1, 1, 2])):
        data = rng.choice(DAMAGES)(data, rng)
    target.write_bytes(data)
    return folder / valid.name
