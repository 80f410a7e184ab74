"""Image volumes that lie around a surface: labels, numbers or tensors of voxels (NIfTI, and `.mgz`).

nibabel reads them; coordinates are those of the scanner or template (RAS, mm). A volume of labels gets its names from
the lookup table of BIDS beside it: `*_dseg.tsv`, or `dseg.tsv`, with the columns index and name.
"""

from __future__ import annotations

import gzip
import logging
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.tsv import read_tsv
from cortet.formats.untrusted import check_file
from cortet.meshes import CoordinateFrame, FloatArray

if TYPE_CHECKING:
    from nibabel.spatialimages import SpatialImage

logger = logging.getLogger(__name__)

#: labels: whole numbers; numbers: one of any kind per voxel; tensors: xx xy xz yy yz zz along the axes of the voxels,
#: as FSL's dtifit writes them; mrtrix: xx yy zz xy xz yz along x, y and z, as MRtrix's dwi2tensor writes them
Kind = Literal["labels", "numbers", "tensors", "mrtrix"]

_ENDINGS = (".nii", ".nii.gz", ".mgz", ".mgh")
#: names of files that hold labels
_LABELLED = re.compile(r"(^|[_.-])(d?seg|aseg|aparc.*|labels?|parc)\.(nii|nii\.gz|mgz|mgh)$")
#: most by which a label differs from a whole number: files round what their header scales
_ROUNDED = 1e-3
#: most labels of a volume; atlases have a few hundred
_MOST_LABELS = 2000
#: bounds of the voxel widths of brain images, mm
_NARROWEST, _WIDEST = 0.01, 20.0
#: a matrix is singular if its determinant, over the product of its columns' lengths, is at most this
_SINGULAR = 1e-6
#: header of an MGH file up to the flag that says whether its geometry is valid, bytes
_TO_FLAG, _FLAG = 28, 2
#: numbers of a tensor, and where xx, yy, zz, xy, yz, xz stand in each order
_TENSOR = 6
_ORDERS = {"tensors": [0, 3, 5, 1, 4, 2], "mrtrix": [0, 1, 2, 3, 5, 4], "symmetric": [0, 2, 5, 1, 4, 3]}
_SPELLING = re.compile(r"(?P<file>.+\.(?:nii|nii\.gz|mgz|mgh))(?::(?P<what>[^:/]*))?")


@dataclass(frozen=True, eq=False)
class Volume:
    """A volume that was read."""

    #: (i, j, k) whole numbers of labels, or float; (i, j, k, 6) float of tensors: xx, yy, zz, xy, yz, xz in x, y and z
    values: NDArray[Any]
    #: (4, 4), from the numbers of a voxel to the mm of its centre
    affine: FloatArray
    kind: Literal["labels", "numbers", "tensors"]
    #: names of labels
    names: dict[int, str] = field(default_factory=dict)
    #: the file that messages name
    file: str = ""

    @property
    def voxel(self) -> float:
        """The smallest width of a voxel, mm."""
        return float(np.linalg.norm(self.affine[:3, :3], axis=0).min())


def to_scanner(points: FloatArray, frame: CoordinateFrame) -> FloatArray:
    """Points (n, 3), mm, of a surface, in the space of volumes: mapped by the matrix of the frame if it leads there."""
    whole = frame.to_scanner
    return np.asarray(points @ whole[:3, :3].T + whole[:3, 3])


def is_volume(text: str) -> bool:
    """Whether a text names a volume, with or without a kind or labels after it."""
    return _SPELLING.fullmatch(text) is not None


def volume_file(text: str) -> str:
    """The file that `FILE` or `FILE:WHAT` names; other texts stay as they are."""
    match = _SPELLING.fullmatch(text)
    return match["file"] if match else text


def read_named(text: str) -> Volume:
    """The volume that `FILE` or `FILE:KIND` names. Raises InputError as `read_volume`, and for another kind."""
    match = _SPELLING.fullmatch(text)
    if match and match["what"] is not None and match["what"] not in get_args(Kind):
        raise InputError(
            f"{match['what']!r} is not a kind of volume", file=match["file"], remedy=f"use {', '.join(get_args(Kind))}"
        )
    kind: Any = match["what"] if match else None
    return read_volume(volume_file(text), kind)


def read_labels(text: str) -> tuple[Volume, list[int]]:
    """The volume and the labels that `FILE:5` or `FILE:5,6` names; a label may also be given by its name."""
    match = _SPELLING.fullmatch(text)
    if match is None:
        raise InputError("is not a volume", file=text, remedy="give NIfTI or MGZ, and labels: FILE.nii.gz:5,6")
    if not match["what"]:
        raise InputError("is a volume, not a surface", file=text, remedy="say which labels to take: FILE:5 or FILE:5,6")
    volume = read_volume(match["file"], "labels")
    by_name: dict[str, list[int]] = {}
    for number, name in volume.names.items():
        by_name.setdefault(name, []).append(number)
    there = np.unique(volume.values).tolist()
    keys = []
    for word in match["what"].split(","):
        named = by_name.get(word, [])
        if len(named) > 1:
            what = f"gives the labels {', '.join(map(str, named))} the same name {word!r}"
            raise InputError(what, file=label_table(match["file"]), remedy="use their numbers instead")
        key = int(word) if re.fullmatch(r"-?\d{1,18}", word) else next(iter(named), None)
        if key is None or key not in there:
            shown = ", ".join(f"{one} {volume.names.get(one, '')}".strip() for one in there[:20] if one)
            raise InputError(f"has no label {word!r}", file=match["file"], remedy=f"it has {shown or 'none'}")
        keys.append(key)
    return volume, keys


def read_volume(path: str | Path, kind: Kind | None = None) -> Volume:
    """A volume of a file.

    Parameters
    ----------
    kind : None: six numbers per voxel are tensors; whole numbers are labels if the file holds integers or is named
        like a segmentation (`*_dseg.nii.gz`, `aseg.mgz`); all else are numbers

    Raises
    ------
    InputError
        the file cannot be read; it holds more than one volume, or only zeros; it is not in mm; it does not say where
        its voxels are; its content does not fit the kind, or fits several
    """
    import nibabel

    if not str(path).endswith(_ENDINGS):
        raise InputError("is not a volume", file=path, remedy=f"give a file that ends in {', '.join(_ENDINGS)}")
    check_file(path)
    with _readable(path):
        image: Any = nibabel.load(path, mmap=False)  # if a mapped file is truncated later, the program dies
    return _volume(image, path, kind)


def volume_of(image: SpatialImage) -> Volume:
    """The volume of a NiBabel image, with label names if it has a file; raises InputError as `read_volume`."""
    return _volume(image, image.get_filename() or "the image", None)


def label_table(path: str | Path) -> Path | None:
    """The table of the names of a volume's labels; None if there is none."""
    path = Path(path)
    stem = re.sub(r"\.(nii|nii\.gz|mgz|mgh)$", "", path.name)
    tables = [path.with_name(f"{stem}.tsv"), path.with_name("dseg.tsv")]
    return next((one for one in tables if os.path.isfile(one)), None)  # noqa: PTH113, false of names that are too long


def label_names(path: str | Path) -> dict[int, str]:
    """Names of the labels of a volume, from the table beside it: key -> name; empty if there is none.

    The table has the name of the volume, or is `dseg.tsv` for all volumes of the folder.
    """
    file = label_table(path)
    if file is None:
        return {}
    table = read_tsv(file)
    remedy = "a lookup table of BIDS has the columns index (a whole number) and name"
    if not {"index", "name"} <= set(table.columns):
        raise InputError(f"has the columns {', '.join(table.columns)}", file=file, remedy=remedy)
    names: dict[int, str] = {}
    for line, key, name in zip(table.index, table["index"], table["name"], strict=True):
        if not re.fullmatch(r"-?\d{1,9}", key):
            raise InputError(f"line {line}: {key!r} is not an index", file=file, remedy=remedy)
        if int(key) in names:
            raise InputError(f"line {line}: label {key} appears twice", file=file, remedy="keep one of the two")
        names[int(key)] = name
    return names


def _volume(image: SpatialImage, path: str | Path, kind: Kind | None) -> Volume:
    """The volume of an image that NiBabel read from a file."""
    values, affine, order = _content(image, path)
    tensors = values.ndim == 4
    if tensors != (kind in ("tensors", "mrtrix")) and kind is not None:
        there = "six numbers" if tensors else "one number"
        remedy = "name it NAME=FILE:tensors" if tensors else "a tensor has six numbers"
        raise InputError(f"holds {there} per voxel, so it cannot hold {kind}", file=path, remedy=remedy)
    if not np.nan_to_num(values).any():
        what = "every voxel is 0" if not np.isnan(values).any() else "no voxel holds a number but 0"
        raise InputError(f"is empty: {what}", file=path, remedy="export it again")
    if tensors:
        return Volume(_tensors(values, affine, order or kind or "tensors", path), affine, "tensors", file=str(path))
    if kind == "labels" or (kind is None and _are_labels(values, path)):
        known = label_names(path) if os.path.isfile(path) else {}  # noqa: PTH113, as in label_table
        return Volume(_whole(values, path), affine, "labels", known, str(path))
    return Volume(values.astype(np.float32), affine, "numbers", file=str(path))


@contextmanager
def _readable(path: str | Path) -> Iterator[None]:
    """Turn the errors that NiBabel raises for damaged files into InputError."""
    import nibabel
    import nibabel.freesurfer.mghformat

    try:
        yield
    except (
        OSError,
        EOFError,
        ValueError,
        TypeError,
        KeyError,
        ArithmeticError,
        AttributeError,
        MemoryError,
        zlib.error,
    ) as error:
        raise InputError(f"cannot be read as a volume: {error}", file=path, remedy="export it again") from None
    except (
        nibabel.filebasedimages.ImageFileError,
        nibabel.spatialimages.HeaderDataError,
        nibabel.spatialimages.ImageDataError,
        nibabel.wrapstruct.WrapStructError,
        nibabel.freesurfer.mghformat.MGHError,
    ) as error:
        raise InputError(f"cannot be read as a volume: {error}", file=path, remedy="export it again") from None


def _content(image: SpatialImage, path: str | Path) -> tuple[NDArray[Any], FloatArray, str]:
    """Values (i, j, k) or (i, j, k, 6), affine, and the order of tensors if the header states it."""
    with _readable(path):
        shape = tuple(int(count) for count in image.shape)
        order = _shape_is_usable(shape, path)
        affine = np.asarray(image.affine, float)
        require_geometry(image, path)
        _require_mm(image, affine, path)
        _say_disagreement(image, path)
        values = np.asarray(image.dataobj)
    if values.dtype.kind not in "iuf":
        raise InputError(f"holds values of type {values.dtype}", file=path, remedy="export it as numbers")
    return values.reshape(shape[:3] if order is None else (*shape[:3], _TENSOR)), affine, order or ""


def _shape_is_usable(shape: tuple[int, ...], path: str | Path) -> str | None:
    """None for a single volume; for tensors the order of their six numbers, empty if the header does not state it."""
    more = [count for count in shape[3:] if count != 1]
    if len(shape) < 3 or 0 in shape:
        remedy = "give a volume with three axes"
        raise InputError(f"has the shape {shape}, which is not a volume", file=path, remedy=remedy)
    if not more:
        return None
    if more != [_TENSOR]:
        raise InputError(
            f"holds {int(np.prod(more, dtype=object))} volumes (its shape is {shape}), not one, or the six of a tensor",
            file=path,
            remedy="take one out of it, for example with fslroi or mrconvert -coord 3 0",
        )
    return "symmetric" if len(shape) == 5 else ""


def require_geometry(image: Any, path: str | Path) -> None:
    """Raise InputError for a header that does not say where the voxels are; NiBabel then assumes something."""
    from nibabel.openers import ImageOpener

    header = image.header
    why = ""
    if "sform_code" in header and int(header["sform_code"]) <= 0 and int(header["qform_code"]) <= 0:
        why = "its sform and qform codes are 0"
    elif "goodRASFlag" in header and os.path.isfile(path):  # noqa: PTH113, as in label_table
        with ImageOpener(str(path)) as file:  # NiBabel sets the flag of what it read
            why = "" if any(file.read(_TO_FLAG + _FLAG)[_TO_FLAG:]) else "its header calls its geometry invalid"
    if why:
        raise InputError(
            f"does not say where its voxels are: {why}",
            file=path,
            remedy="copy the header of the image that it was made from, for example with fslcpgeom or mri_convert",
        )


def _require_mm(image: Any, affine: FloatArray, path: str | Path) -> None:
    """Raise InputError for an affine that is none, or whose coordinates are not mm."""
    header = image.header
    if not np.isfinite(affine).all():
        raise InputError("its affine is not finite", file=path, remedy="export it again")
    widths = np.linalg.norm(affine[:3, :3], axis=0)
    if abs(np.linalg.det(affine[:3, :3])) <= _SINGULAR * np.prod(widths):
        raise InputError("its affine flattens space", file=path, remedy="export it again")
    unit = header.get_xyzt_units()[0] if hasattr(header, "get_xyzt_units") else "mm"
    size = " x ".join(f"{width:.3g}" for width in widths)
    if unit in ("meter", "micron"):
        what = f"is in {'metres' if unit == 'meter' else 'micrometres'}, as its header says"
    elif widths.min() < _NARROWEST:
        what = f"has voxels of {size} mm: it seems to be in metres"
    elif widths.max() > _WIDEST:
        what = f"has voxels of {size} mm: it seems to be in micrometres"
    else:
        return
    raise InputError(what, file=path, remedy="write it in mm, as the surface is")


def _say_disagreement(image: Any, path: str | Path) -> None:
    """Warn if the header places the voxels in two ways that differ by more than half a voxel."""
    header = image.header
    if "sform_code" not in header or not (int(header["sform_code"]) > 0 and int(header["qform_code"]) > 0):
        return
    sform, qform = header.get_sform(), header.get_qform()
    corners = np.array(np.meshgrid(*([0, n - 1] for n in image.shape[:3]))).reshape(3, -1).T
    apart = float(np.linalg.norm(corners @ (sform - qform)[:3, :3].T + (sform - qform)[:3, 3], axis=1).max())
    if apart > np.linalg.norm(sform[:3, :3], axis=0).min() / 2:
        logger.warning("%s: its sform and its qform differ by up to %.1f mm: the sform is taken", path, apart)


def _are_labels(values: NDArray[Any], path: str | Path) -> bool:
    """Whether voxels hold labels; InputError if the file leaves that open."""
    if _LABELLED.search(Path(path).name):
        return True
    if values.dtype.kind != "f":
        if np.ptp(values) > _MOST_LABELS and len(np.unique(values)) > _MOST_LABELS:
            raise InputError(
                f"holds more than {_MOST_LABELS:,} different whole numbers, too many for labels",
                file=path,
                remedy="if it is an image, name it NAME=FILE:numbers",
            )
        return True
    finite = values[np.isfinite(values)]
    if (np.abs(finite - np.rint(finite)) <= _ROUNDED).all() and np.rint(finite).any():
        raise InputError(
            f"holds whole numbers as {values.dtype}: labels or measured numbers?",
            file=path,
            remedy="say which: NAME=FILE:labels or NAME=FILE:numbers",
        )
    return False


def _whole(values: NDArray[Any], path: str | Path) -> NDArray[np.int32]:
    """Labels as 32-bit integers; those that differ a little from whole numbers are rounded, which is said."""
    if values.dtype.kind == "f":
        whole = np.rint(values)
        away = np.abs(values - whole)
        broken = ~(away <= _ROUNDED)
        if broken.any():
            first = tuple(np.argwhere(broken)[0].tolist())
            raise InputError(
                f"is to hold labels, but {broken.mean():.1%} of its voxels hold no whole numbers, "
                f"the first is {values[first]:.10g} at {first}",
                file=path,
                remedy="save labels as integers, neither interpolated nor scaled; measured numbers are FILE:numbers",
            )
        if away.any():
            logger.warning("%s: its labels are up to %.1g from whole numbers: they are rounded", path, away.max())
        values = whole
    if values.min() < -(2**31) or values.max() >= 2**31:
        raise InputError("holds a label beyond 32 bits", file=path, remedy="number the labels again")
    labels = values.astype(np.int32)
    if (count := len(np.unique(labels))) > _MOST_LABELS:
        what = f"holds {count:,} labels, more than the {_MOST_LABELS:,} that are read"
        raise InputError(what, file=path, remedy="if it is an image, name it NAME=FILE:numbers")
    return labels


def _tensors(values: NDArray[Any], affine: FloatArray, order: str, path: str | Path) -> NDArray[np.float32]:
    """Tensors as xx, yy, zz, xy, yz, xz in x, y and z: (i, j, k, 6); NaN where a voxel holds none.

    FSL's tensors are along the axes of the voxels; the first axis is reversed if these are right-handed
    (https://fsl.fmrib.ox.ac.uk/fsl/docs/#/diffusion/fdt: vectors of a radiological image). MRtrix's, and those whose
    header states the intent of NIfTI, are in x, y and z.
    """
    tensors = values[..., _ORDERS[order]].astype(np.float64)
    full = matrices(tensors[np.isfinite(tensors).all(axis=-1) & tensors.any(axis=-1)])
    bad = float((np.linalg.eigvalsh(full)[:, 0] <= 0).mean()) if len(full) else 1.0
    if bad > 0.5:
        raise InputError(
            f"{bad:.0%} of its tensors have an eigenvalue that is not above 0, read as {order}",
            file=path,
            remedy="name it NAME=FILE:mrtrix if MRtrix wrote it, NAME=FILE:tensors if FSL did",
        )
    held = np.isfinite(tensors).all(axis=-1) & tensors.any(axis=-1)
    result = np.full(tensors.shape, np.nan, np.float32)
    if order == "tensors":
        axes = affine[:3, :3].copy()
        if np.linalg.det(axes) > 0:
            axes[:, 0] *= -1
        left, _, right = np.linalg.svd(axes)
        turn = left @ right  # the rotation nearest to the affine, without its scales and shears
        full = turn @ full @ turn.T
    result[held] = six(full)
    return result


def write_volume(values: NDArray[Any], affine: FloatArray, path: str | Path) -> None:
    """Write a volume (i, j, k) or (i, j, k, c) as NIfTI, complete or not at all; the same values give the same file."""
    import nibabel

    image = nibabel.Nifti1Image(values, affine)  # type: ignore[no-untyped-call]
    image.header.set_xyzt_units("mm")  # type: ignore[no-untyped-call]
    packed = gzip.compress(image.to_bytes(), compresslevel=6, mtime=0)
    with atomic_path(path) as temporary:
        temporary.write_bytes(packed if str(path).endswith(".gz") else image.to_bytes())


def matrices(tensors: NDArray[Any]) -> FloatArray:
    """Tensors (n, 6) xx, yy, zz, xy, yz, xz as matrices (n, 3, 3)."""
    return np.asarray(tensors, float)[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)


def six(full: FloatArray) -> FloatArray:
    """Symmetric matrices (n, 3, 3) as xx, yy, zz, xy, yz, xz: (n, 6)."""
    return full.reshape(-1, 9)[:, [0, 4, 8, 1, 5, 2]]
