"""Image volumes that lie around a surface: labels, numbers or tensors of voxels (NIfTI, and `.mgz`).

nibabel reads them; coordinates are those of the scanner or template (RAS, mm). A volume of labels gets its names from
the lookup table of BIDS beside it: `*_dseg.tsv`, or `dseg.tsv`, with the columns index and name.
"""

from __future__ import annotations

import gzip
import logging
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.tables import Column
from cortet.formats.tsv import read_tsv
from cortet.formats.untrusted import by_library, check_file, content
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
_SPELLING = re.compile(r"(?P<file>.+\.(?:nii|nii\.gz|mgz|mgh))(?::(?P<kind>[^:/]*))?")

#: columns of the table beside a mesh with volumes
TISSUE_COLUMNS = (
    Column("volume", "Name of the volume", heading="volume"),
    Column("kind", "What its voxels hold: labels, numbers or tensors"),
    Column("label", "Label; n/a for numbers and tensors, whose row is about all tetrahedra", heading="label"),
    Column("name", "Name of the label in the lookup table of the volume", heading="name"),
    Column("tetrahedra", "Number of tetrahedra with this label", heading="tetrahedra", form=",.0f"),
    Column("volume_ml", "Their volume", units="mL", heading="volume, mL", form=".3f"),
    Column("q_max", "Largest q among them", heading="worst q", form=".3f"),
    Column("share", "Mean share of the label inside them, weighted by volume", heading="share inside", form=".3f"),
    Column("without_value", "Tetrahedra where the volume has no value; they get the value of the nearest voxel"),
    Column(
        "background",
        "Fraction of the brain where the volume is 0 or has no value",
        heading="background",
        form=".1%",
    ),
)


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


def volume_file(text: str) -> str:
    """The file that `FILE` or `FILE:KIND` names; other texts stay as they are."""
    match = _SPELLING.fullmatch(text)
    return match["file"] if match else text


def read_named(text: str) -> Volume:
    """The volume that `FILE` or `FILE:KIND` names. Raises InputError as `read_volume`, and for another kind."""
    kind: Any = (match := _SPELLING.fullmatch(text)) and match["kind"]
    if kind is not None and kind not in get_args(Kind):
        remedy = f"use {', '.join(get_args(Kind))}"
        raise InputError(f"{kind!r} is not a kind of volume", file=volume_file(text), remedy=remedy)
    return read_volume(volume_file(text), kind)


def read_volume(path: str | Path, kind: Kind | None = None) -> Volume:
    """A volume of a file.

    Parameters
    ----------
    kind : None: six numbers per voxel are tensors; whole numbers are labels if the file holds integers or is named
        like a segmentation (`*_dseg.nii.gz`, `aseg.mgz`); all else are numbers
    """
    import nibabel

    if not str(path).endswith(_ENDINGS):
        raise InputError("is not a volume", file=path, remedy=f"give a file that ends in {', '.join(_ENDINGS)}")
    check_file(path)
    with by_library("a volume", path):
        image: Any = nibabel.load(path, mmap=False)  # if a mapped file is truncated later, the program dies
    if isinstance(image, nibabel.Cifti2Image):
        remedy = "extract its volume: wb_command -cifti-separate FILE COLUMN -volume-all OUT.nii.gz"
        raise InputError("is a CIFTI file, of which cortet reads no volume", file=path, remedy=remedy)
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
    names: dict[int, str] = {}
    with by_library("a lookup table of BIDS with the columns index (a whole number, each once) and name", file):
        for key, name in zip(map(int, table["index"]), table["name"], strict=True):
            if key in names:
                raise ValueError(f"label {key} appears twice")
            names[key] = name
    return names


def _volume(image: SpatialImage, path: str | Path, kind: Kind | None) -> Volume:
    """The volume of an image that NiBabel read from a file."""
    values, affine, order = _content(image, path)
    tensors = values.ndim == 4
    if tensors != (kind in ("tensors", "mrtrix")) and kind is not None:
        there = "six numbers" if tensors else "one number"
        remedy = (
            "name it NAME=FILE:tensors"
            if tensors
            else "name a volume with six numbers per voxel, or leave out the kind"
        )
        raise InputError(f"holds {there} per voxel, which cannot be {kind}", file=path, remedy=remedy)
    if not np.nan_to_num(values).any():
        raise InputError("is empty: every voxel is 0", file=path, remedy="export it again")
    if tensors:
        return Volume(_tensors(values, affine, order or kind or "tensors", path), affine, "tensors", file=str(path))
    if kind == "labels" or (kind is None and _are_labels(values, path)):
        known = label_names(path) if os.path.isfile(path) else {}  # noqa: PTH113, as in label_table
        return Volume(_whole(values, path), affine, "labels", known, str(path))
    return Volume(values.astype(np.float32), affine, "numbers", file=str(path))


def _content(image: SpatialImage, path: str | Path) -> tuple[NDArray[Any], FloatArray, str]:
    """Values (i, j, k) or (i, j, k, 6), affine, and the order of tensors if the header states it."""
    with by_library("a volume", path):
        shape = tuple(int(count) for count in image.shape)
        more = [count for count in shape[3:] if count != 1]
        if len(shape) < 3 or 0 in shape or more not in ([], [_TENSOR]):
            what = f"has the shape {shape}, which is neither one volume nor the six components of a tensor"
            remedy = "extract one volume, for example with fslroi or mrconvert -coord 3 0"
            raise InputError(what, file=path, remedy=remedy)
        affine = np.asarray(image.affine, float)
        _require_geometry(image, path)
        _require_mm(image, affine, path)
        _say_disagreement(image, path)
        values = np.asarray(image.dataobj)
        if values.dtype.kind not in "iuf":
            raise ValueError(f"it holds values of type {values.dtype}")
    return values.reshape((*shape[:3], *more)), affine, "symmetric" if more and len(shape) == 5 else ""


def _require_geometry(image: Any, path: str | Path) -> None:
    """Raise InputError for a header that does not say where the voxels are; NiBabel then assumes something."""
    header, why = image.header, ""
    if "sform_code" in header and int(header["sform_code"]) <= 0 and int(header["qform_code"]) <= 0:
        why = "its sform and qform codes are 0"
    elif "goodRASFlag" in header and Path(path).is_file():
        flag = content(path)[_TO_FLAG : _TO_FLAG + _FLAG]  # NiBabel sets the flag of what it read
        why = "" if any(flag) else "its header marks its geometry as invalid"
    if why:
        raise InputError(
            f"does not state the location of its voxels: {why}",
            file=path,
            remedy="copy the header of the image that it was made from, for example with fslcpgeom or mri_convert",
        )


def _is_singular(affine: FloatArray) -> bool:
    """Whether an affine (4, 4) flattens space, or is not finite there."""
    linear = affine[:3, :3]
    return not abs(np.linalg.det(linear)) > _SINGULAR * np.prod(np.linalg.norm(linear, axis=0))


def _require_mm(image: Any, affine: FloatArray, path: str | Path) -> None:
    """Raise InputError for an affine that is none, or whose coordinates are not mm."""
    if _is_singular(affine):
        raise InputError("its affine is singular or not finite", file=path, remedy="export it again")
    widths = np.linalg.norm(affine[:3, :3], axis=0)
    unit = image.header.get_xyzt_units()[0] if hasattr(image.header, "get_xyzt_units") else "mm"
    if unit in ("meter", "micron") or widths.min() < _NARROWEST or widths.max() > _WIDEST:
        size = " x ".join(f"{width:.3g}" for width in widths)
        what = f"may not be in mm: its voxels are {size} wide, and its header says {unit}"
        raise InputError(what, file=path, remedy="write it in mm, like the surface")


def _say_disagreement(image: Any, path: str | Path) -> None:
    """Warn if the header places the voxels in two ways that differ by more than half a voxel."""
    header = image.header
    if "sform_code" not in header or not (int(header["sform_code"]) > 0 and int(header["qform_code"]) > 0):
        return
    sform, qform = header.get_sform(), header.get_qform()
    corners = np.array(np.meshgrid(*([0, n - 1] for n in image.shape[:3]))).reshape(3, -1).T
    apart = float(np.linalg.norm(corners @ (sform - qform)[:3, :3].T + (sform - qform)[:3, 3], axis=1).max())
    if apart > np.linalg.norm(sform[:3, :3], axis=0).min() / 2:
        logger.warning("%s: its sform and its qform differ by up to %.1f mm; cortet uses the sform", path, apart)


def _are_labels(values: NDArray[Any], path: str | Path) -> bool:
    """Whether voxels hold labels; InputError if the file leaves that open."""
    if values.dtype.kind != "f" or _LABELLED.search(Path(path).name):
        return True
    finite = values[np.isfinite(values)]
    if (np.abs(finite - np.rint(finite)) <= _ROUNDED).all() and np.rint(finite).any():
        raise InputError(
            f"contains only integers, stored as {values.dtype}: cortet cannot tell labels from measured numbers",
            file=path,
            remedy="specify which: NAME=FILE:labels or NAME=FILE:numbers",
        )
    return False


def _whole(values: NDArray[Any], path: str | Path) -> NDArray[np.int32]:
    """Labels as 32-bit integers; those that differ a little from whole numbers are rounded, with a warning."""
    remedy = "save labels as integers, without interpolation or scaling; for measured numbers use NAME=FILE:numbers"
    if values.dtype.kind == "f":
        whole = np.rint(values)
        broken = ~(np.abs(values - whole) <= _ROUNDED)
        if broken.any():
            first = f"{values[broken][0]:.10g}"
            what = f"should hold labels, but {broken.mean():.1%} of its voxels are not integers, for example {first}"
            raise InputError(what, file=path, remedy=remedy)
        if (values != whole).any():
            logger.warning("%s: its labels are not exactly integers; cortet rounds them", path)
        values = whole
    large = values.min() < -(2**31) or values.max() >= 2**31
    if large or (np.ptp(values) > _MOST_LABELS and len(np.unique(values)) > _MOST_LABELS):
        raise InputError(f"has more than {_MOST_LABELS:,} labels, or a label beyond 32 bits", file=path, remedy=remedy)
    return values.astype(np.int32)


def _tensors(values: NDArray[Any], affine: FloatArray, order: str, path: str | Path) -> NDArray[np.float32]:
    """Tensors as xx, yy, zz, xy, yz, xz in x, y and z: (i, j, k, 6); NaN where a voxel holds none.

    FSL's tensors are along the axes of the voxels; the first axis is reversed if these are right-handed
    (https://fsl.fmrib.ox.ac.uk/fsl/docs/#/diffusion/fdt: vectors of a radiological image). MRtrix's, and those whose
    header states the intent of NIfTI, are in x, y and z.
    """
    tensors = values[..., _ORDERS[order]].astype(np.float64)
    held = np.isfinite(tensors).all(axis=-1) & tensors.any(axis=-1)
    full = matrices(tensors[held])
    bad = float((np.linalg.eigvalsh(full)[:, 0] <= 0).mean()) if len(full) else 1.0
    if bad > 0.5:
        raise InputError(
            f"{bad:.0%} of its tensors have an eigenvalue that is not positive when read as {order}",
            file=path,
            remedy="name it NAME=FILE:mrtrix if MRtrix wrote it, NAME=FILE:tensors if FSL did",
        )
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
