"""Valid files of every kind, damaged at random, and what each reader makes of them."""

from __future__ import annotations

import base64
import itertools
import random
import re
import shutil
import traceback
import zlib
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

from cortet.cohort.scan import scan
from cortet.cohort.sheet import Case, read_sheet, write_sheet
from cortet.config import Config, load
from cortet.config.stages import Generate, Repair
from cortet.errors import CortetError
from cortet.formats import FORMATS, read_mesh
from cortet.formats.gifti import read_fields, read_label_names, read_surface, write_surface
from cortet.formats.placement import matrix, placed
from cortet.formats.volumes import read_volume
from cortet.geometry.label_surface import Handles
from cortet.meshes import TetMesh, TriSurface
from cortet.phantoms import phantom
from cortet.solver_files.export import convert, export
from cortet.solver_files.fields import with_fields
from cortet.solver_files.label_surfaces import surfaces_of_labels
from cortet.solver_files.sets import named_sets
from cortet.solver_files.volumes import require_in_place
from cortet.stages.gate import gate
from cortet.stages.generate import generate
from cortet.stages.repair import repair
from cortet.stages.solver_ready import surface_nodes_first
from cortet.stages.transfer import transfer

Damage = Callable[[bytes, random.Random], bytes]
#: kind -> a valid file, and what reads it
Seeds = dict[str, tuple[Path, Callable[[Path], Any]]]

NUMBERS = [
    *(b"0", b"-1", b"1", b"255", b"65536", b"2147483647", b"2147483648", b"4294967297", b"1000000000000"),
    *(b"9223372036854775807", b"-9223372036854775808", b"18446744073709551616", b"9" * 400, b"9" * 5000),
    *(b"nan", b"-inf", b"inf", b"1e308", b"1e-320", b"1e999", b"-0.0", b"1.5", b"0x10", b"1_0", b"", b"\xb2", b"1,5"),
]
WORDS = [
    *(b"", b"../../../tmp/evil", b"/etc/passwd", b"/dev/zero", b"$(reboot)", b"; rm -rf x", b"`id`", b"a\nb", b"a\0b"),
    *(b"{x}", b"*", b"%s%n", b"sub-\xd0\xb0", b"\xef\xbc\x8f", b"\xff\xfe", b"x" * 5000, b"true", b"null", b"None"),
    *(b"n/a", b"NIFTI_INTENT_TRIANGLE", b"NIFTI_TYPE_FLOAT64", b"ASCII", b"GZipBase64Binary", b"ExternalFileBinary"),
    *(b"binary", b"appended", b"raw", b"UInt8", b"Float64", b"UInt64", b"C3D8", b"\xe2\x80\xa8", b"&lol9;", b"&x;"),
]


def _replaced(data: bytes, rng: random.Random, pattern: bytes, by: Callable[[bytes], bytes]) -> bytes:
    """The data with one match of the pattern replaced."""
    found = list(itertools.islice(re.finditer(pattern, data), 5000))
    if not found:
        return data
    # half of the time among the first: heads of files say how long everything is
    match = rng.choice(found[:20] if rng.random() < 0.5 else found)
    return data[: match.start()] + by(match[0]) + data[match.end() :]


def change_bytes(data: bytes, rng: random.Random) -> bytes:
    """A bit turned, the end or a span missing, a span repeated up to a megabyte, or bytes put in."""
    start = rng.randrange(len(data) + 1)
    end = min(len(data), start + rng.randint(1, rng.choice([4, 64, 2000])))
    span, times = data[start:end], rng.choice([2, 3, 50, max(1, 1_000_000 // (end - start + 1))])
    turned = bytes(byte ^ 1 << rng.randrange(8) for byte in span[:1]) + span[1:]
    put_in = span + rng.choice([rng.randbytes(rng.randint(1, 40)), *WORDS, *NUMBERS])
    cut_off = data[:start]
    return rng.choice([cut_off, *(data[:start] + new + data[end:] for new in (turned, b"", span * times, put_in))])


def change_a_number(data: bytes, rng: random.Random) -> bytes:
    """A number replaced by one that is too large, too small or none."""
    return _replaced(data, rng, rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", lambda _: rng.choice(NUMBERS))


def change_a_word(data: bytes, rng: random.Random) -> bytes:
    """A word, a quoted string, a cell or an XML tag replaced by another, by a trap, or by many of it."""
    patterns = [rb'(?<=")[^"\n]{0,80}(?=")', rb"(?<=[\t\n])[^\t\n]{1,80}(?=[\t\n])", rb"[A-Za-z_]{2,40}"]
    pattern = rng.choice([*patterns, rb"<[^<>]{1,300}>"])
    others = [match[0] for match in itertools.islice(re.finditer(pattern, data), 300)]
    return _replaced(data, rng, pattern, lambda word: rng.choice([word * 2, *WORDS, *NUMBERS, *others]))


def change_lines(data: bytes, rng: random.Random) -> bytes:
    """A line deleted, swapped, repeated or longer."""
    lines = data.split(b"\n")
    place, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    longer = lines[place] + rng.choice([b" ", b",", b"\t"]) + rng.choice(NUMBERS)
    lines[place : place + 1] = rng.choice([[], [lines[other]], [lines[place], lines[other]], [longer]])
    return b"\n".join(lines)


def change_an_encoding(data: bytes, rng: random.Random) -> bytes:
    """Another encoding or other ends of lines, declared or real."""
    name = rng.choice([b"utf-16", b"latin-1", b"ascii", b"utf-7", b"shift_jis", b"none", b"idna", b"cp037"])
    declared = re.sub(rb"<\?xml[^>]*\?>", b'<?xml version="1.0" encoding="' + name + b'"?>', data)
    ends = data.replace(b"\n", rng.choice([b"\r\n", b"\r"]))
    return rng.choice([declared, b"\xef\xbb\xbf" + data, data.decode("latin-1").encode("utf-16"), ends])


def change_packed_data(data: bytes, rng: random.Random) -> bytes:
    """Damage what stands there in base64, also what is compressed in it."""

    def damaged(text: bytes) -> bytes:
        try:
            packed = base64.b64decode(text)
        except ValueError:
            return text
        try:
            content = zlib.decompress(packed)
        except zlib.error:
            return base64.b64encode(change_a_binary_number(packed, rng))
        return base64.b64encode(zlib.compress(change_a_binary_number(content, rng)))

    return _replaced(data, rng, rb"[A-Za-z0-9+/]{20,}=*", damaged)


def change_a_binary_number(data: bytes, rng: random.Random) -> bytes:
    """Four or eight bytes replaced by another number."""
    values = (0, 1, 2, -1, 255, 2**31 - 1, -(2**31), 10**12, 2**62)
    kind = rng.choice(["<i4", "<i8", "<f4", "<f8", ">i4"])
    number = rng.choice([*values, np.nan, np.inf, 1e30] if "f" in kind else values)
    if "i4" in kind:
        number = (int(number) + 2**31) % 2**32 - 2**31
    raw = np.array([number], kind).tobytes()
    place = rng.randrange(max(min(len(data), rng.choice([64, 2048, 1 << 30])) // len(raw), 1)) * len(raw)
    return data[:place] + raw + data[place + len(raw) :]


#: bytes, words and packed data are damaged more often
DAMAGES: list[Damage] = [
    *(change_bytes, change_a_number, change_a_word, change_lines, change_an_encoding, change_packed_data),
    *(change_bytes, change_a_number, change_a_word, change_a_binary_number, change_packed_data, change_bytes),
]


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The data with one to three damages, at most 4 MiB of it."""
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        data = rng.choice(DAMAGES)(data, rng)[: 4 << 20]
    return data


#: values that a key of the configuration can be given
VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 10**30, 1.5, float("nan"), float("inf"), "", "x", "../../x", "{case}", "a\nb", "\0"),
    *([], [[]], {}, [1, 2, 3], ["x"], {"x": 1}, {1: 2}, [None], "x" * 100_000, list(range(10_000)), {"output": "x"}),
]
YAMLS = [
    *(b"[" * 20_000, b"{a: " * 5000),
    *(
        b"fold: !!python/object/apply:os.system ['true']\n",
        b"fold: 2026-13-45\n",
        b"fold: !!binary x\n",
        b"? [a]\n: b\n",
    ),
    *(b"output: " + b"9" * 5000 + b"\n", b"output: !!int x\n", b"output: \x07\n", b"%YAML 9.9\n---\n", b"a: b: c\n"),
    *(b"<<: [{a: 1}, {b: 2}]\n", b"output: !!timestamp x\n", b"output: !!set {a}\n", b"--- 1\n--- 2\n", b"&a *a : 1\n"),
]


def damaged_config(data: bytes, rng: random.Random) -> bytes:
    """A configuration with one value replaced by another kind, with YAML that is a trap, or damaged as any text."""
    choice = rng.random()
    if choice < 0.2:
        return rng.choice([data + rng.choice(YAMLS), rng.choice(YAMLS)])
    if choice < 0.5:
        return damaged(data, rng)
    tree = yaml.safe_load(data)
    here = tree
    while True:
        key = rng.choice(list(here))
        if isinstance(here[key], dict) and here[key] and rng.random() < 0.8:
            here = here[key]
            continue
        here[rng.choice([key, key, key, rng.choice(["x", 1, None, "surfaces", "cell_sizes"])])] = rng.choice(VALUES)
        return yaml.safe_dump(tree).encode()


def seeds(folder: Path) -> Seeds:
    """A valid file of every kind in a folder of its own, and what reads it."""
    surface = phantom(24, subdivisions=2)
    count = len(surface.points)
    fields = {"thickness": np.linspace(1, 2, count, dtype="f4"), "area": (np.arange(count) // 60).astype(np.int32)}
    surface = replace(surface, point_data=fields)
    return {
        **meshes(surface, folder),
        **of_other_programs(surface, folder),
        **volumes(surface, folder),
        **of_cohorts(folder),
    }


def placed_in(folder: Path, kind: str, name: str) -> Path:
    """A path in a folder of its own."""
    (folder / kind).mkdir()
    return folder / kind / name


def meshes(surface: TriSurface, folder: Path) -> Seeds:
    """A coarse mesh in every format that is read, and the surface in GIfTI."""
    plain = Generate(backend="cgal", facet_distance=[0.5], odt=False, lloyd=False, perturb=False, exude=False)
    mesh, _ = generate(surface, plain, cell_size=10.0, mesher="cgal")
    mesh = named_sets(surface_nodes_first(transfer(mesh, surface)[0])[0], cortex_depth=5.0, medial_wall={"area": [0]})
    found: Seeds = {}
    for name, form in FORMATS.items():
        path = folder / name / f"m{form.suffix}"
        export(mesh, path, solver=name, certificate={"certified": True})
        if name not in ("braingrowth", "febio"):  # which cortet only writes
            found[name] = (path, read_and_convert)
    for name, packing in (("xdmf_of_meshio", "gzip"), ("plain_xdmf_of_meshio", None)):
        path = placed_in(folder, name, "m.xdmf")
        cells = {"region": [np.arange(len(mesh.cells)) % 2]}
        other = meshio.Mesh(mesh.points, [("tetra", mesh.cells)], {"height": mesh.points[:, 2]}, cells)
        meshio.xdmf.write(path, other, compression=packing)
        found[name] = (path, read_mesh)
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
    mesh = trimesh.Trimesh(surface.points, surface.faces, process=False)
    kinds = {"text_stl": "stl_ascii", "ply": "ply", "text_ply": "ply", "obj": "obj", "off": "off"}
    found: Seeds = {}
    for name, kind in kinds.items():
        content = mesh.export(file_type=kind, **({"encoding": "ascii"} if name == "text_ply" else {}))
        found[name] = (placed_in(folder, name, f"s.{kind}"), read_surface)
        found[name][0].write_bytes(content.encode() if isinstance(content, str) else content)
    thickness = placed_in(folder, "lh_thickness", "lh.thickness")
    annotation = placed_in(folder, "lh_aparc_annot", "lh.aparc.annot")
    table = np.array([[number, 5, 25, 0, 0] for number in range(40)])
    names = [f"label {number}" for number in range(40)]
    freesurfer.write_morph_data(str(thickness), surface.point_data["thickness"])
    freesurfer.write_annot(str(annotation), surface.point_data["area"], table, names, fill_ctab=True)
    for path in (thickness, annotation):
        found[path.parent.name] = (path, lambda path: read_all_fields(path, surface))
    return found


def volumes(surface: TriSurface, folder: Path) -> Seeds:
    """Images around the surface: labels with names, of 8 bits and compressed, numbers, tensors, and an affine."""
    low, shape = surface.points.min(axis=0) - 5, np.ceil((np.ptp(surface.points, axis=0) + 10) / 5).astype(int)
    affine = np.diag([5.0, 5.0, 5.0, 1.0])
    affine[:3, 3] = low
    labels = 1 + (np.indices(shape)[0] > shape[0] // 2).astype(np.int16)
    tensors = np.broadcast_to(np.array([1.0, 0.1, 0.1, 1.1, 0.1, 1.2], np.float32), (*shape, 6))
    images = {
        "dseg.nii": nibabel.Nifti1Image(labels, affine),
        "aseg.mgz": nibabel.MGHImage(labels.astype(np.uint8), affine),
        "fa.nii.gz": nibabel.Nifti1Image(np.random.default_rng(0).random(shape, np.float32), affine),
        "dti.nii": nibabel.Nifti1Image(tensors, affine),
        "affine.nii.gz": nibabel.Nifti1Image(np.ones((3, 3, 3), np.int16), np.diag([0.5, 0.5, 0.8, 1])),
    }
    found: Seeds = {}
    for name, image in images.items():
        path = placed_in(folder, name.partition(".")[0], name)
        nibabel.save(image, path)
        found[path.parent.name] = (path, lambda path: read_and_use_volume(path, surface))
    (folder / "dseg" / "dseg.tsv").write_text("index\tname\n1\tleft\n2\tright\n")
    return {**found, "affine": (found["affine"][0], lambda path: placed(surface, matrix("mm", path)))}


def of_cohorts(folder: Path) -> Seeds:
    """A sheet, a configuration, and a release to scan."""
    sheet, config = placed_in(folder, "sheet", "cohort.tsv"), placed_in(folder, "config", "config.yaml")
    cases = [Case(f"0{n}", "1", "L", 24.5, folder / f"s{n}.surf.gii", extra={"site": "x"}) for n in range(4)]
    cases[2] = replace(cases[2], include=False, exclude_reason="motion", fields={"sulc": folder / "s.gii"})
    write_sheet(cases, sheet)
    patterns = {"thickness": "../{participant_id}/{site}.shape.gii"}
    config.write_text(yaml.safe_dump(Config().model_dump(mode="json")))
    anat = folder / "release" / "sub-A" / "anat"
    anat.mkdir(parents=True)
    (anat / "sub-A_hemi-L_wm.surf.gii").touch()
    release = folder / "release" / "participants.tsv"
    release.write_text("participant_id\tscan_age\nsub-A\t28.5\nsub-B\tn/a\n")
    release.with_suffix(".json").write_text('{"scan_age": {"Units": "weeks", "Description": "at scan"}}')
    return {
        "sheet": (sheet, lambda path: read_sheet(path, patterns)),
        "config": (config, load),
        "release": (release, lambda path: scan(path.parent)),
    }


def read_and_use_volume(path: Path, surface: TriSurface) -> Any:
    """What is made of a volume: it lies around the surface, and labels give surfaces without handles."""
    volume = read_volume(path)
    require_in_place({"v": volume}, surface)
    if volume.kind == "labels":
        largest = int(np.bincount(volume.values[volume.values > 0]).argmax())
        for made in surfaces_of_labels("v", volume, [largest], Handles(0))[0].values():
            check(made)
    elif not np.isfinite(volume.values).any():
        raise ValueError("no value is finite")
    return volume


def repaired(path: Path) -> TriSurface:
    """What the gate lets in of a repaired file."""
    given = read_surface(path, finite=False)
    return gate(repair(given, Repair(max_hole=50.0), source=str(path))[0], source=str(path))[0]


def read_and_convert(path: Path) -> Any:
    """What a reader makes of a file, which `cortet convert` has to do with as well."""
    found = read_surface(path) if path.name.endswith((".stl", ".gii")) else read_mesh(path)
    check(found)
    convert(path, path.with_name("other.stl"))
    return found


def read_all_fields(path: Path, surface: TriSurface) -> Any:
    """What is read of a file that holds fields only."""
    read_label_names(path)
    read_fields(path)
    return with_fields(surface, {"thickness": path})


def check(result: Any) -> None:
    """A result that the rest of cortet can rely on; ValueError otherwise."""
    if isinstance(result, TriSurface):
        _check_indices(result.faces, len(result.points), "faces")
    if isinstance(result, TetMesh):
        _check_indices(result.cells, len(result.points), "cells")
        for name, members in {**result.sets.nodes, **result.sets.faces}.items():
            _check_indices(members, len(result.points), f"set {name}")
        for name, members in result.sets.cells.items():
            _check_indices(members, len(result.cells), f"set {name}")
    if isinstance(result, TriSurface | TetMesh):
        if not np.isfinite(result.points).all():
            raise ValueError("coordinates are not finite")
        for name, values in result.point_data.items():
            if len(values) != len(result.points):
                raise ValueError(f"field of {len(values)} values for {len(result.points)} nodes")
            if not re.fullmatch(r"[^\x00-\x1f/\\]{1,200}", name) or ".." in name:
                raise ValueError("field of a name that no file can be named by")
    if isinstance(result, list):
        for case in result:
            if not re.fullmatch(r"(sub-[A-Za-z0-9]{1,64})(/ses-[A-Za-z0-9]{1,64})?", case.folder):
                raise ValueError("folder outside the output folder")
            for path in [case.surface, *case.fields.values()]:
                Path(path).exists()


def _check_indices(indices: Any, count: int, what: str) -> None:
    if len(indices) and not (indices.min() >= 0 and indices.max() < count):
        raise ValueError(f"indices of {what.partition(' ')[0]} out of range")


def outcome(read: Callable[[Path], Any], path: Path) -> str:
    """`valid`, `refused`, or what went wrong and where."""
    try:
        check(read(path))
    except CortetError as error:
        return "refused" if len(str(error)) < 20_000 else f"a message of {len(str(error)):,} characters"
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if "/cortet/" in frame.filename] or frames
        return f"{type(error).__name__} in {Path(ours[-1].filename).name}:{ours[-1].name}: {str(error)[:70]}"
    return "valid"


def place_damaged(name: str, valid: Path, rng: random.Random, folder: Path) -> Path:
    """A copy of a valid file and of those beside it, one of which is damaged; its path."""
    shutil.copytree(valid.parent, folder)
    files = sorted(path for path in folder.iterdir() if path.is_file())
    target = rng.choice(files) if rng.random() < 0.5 else folder / valid.name
    content = target.read_bytes()
    if name == "config":
        target.write_bytes(damaged_config(content, rng))
    else:  # the search for .h5 in an XDMF file takes minutes for a line of a megabyte
        target.write_bytes(damaged(content, rng))
    return folder / valid.name
