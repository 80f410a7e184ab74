"""In which space the coordinates of a surface are, and by which matrix they get to the scanner's, where images are.

FreeSurfer's surfaces lie in the axes of a volume ("surface RAS"). Its footer, or the metadata `VolGeom...` of a GIfTI,
state where that volume lies (https://surfer.nmr.mgh.harvard.edu/fswiki/CoordinateSystems).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from nibabel.nifti1 import xform_codes

from cortet.errors import InputError
from cortet.meshes import ANATOMICAL, CoordinateFrame

logger = logging.getLogger(__name__)

#: relative change of lengths up to which a matrix is a rigid motion; spaces to which brains are normalised
_RIGID, _TEMPLATES = 0.01, ("NIFTI_XFORM_TALAIRACH", "NIFTI_XFORM_MNI_152")
#: least stretch by a matrix from an unknown space to a template; an adult brain has 0.9 to 1.2, a child's more
_LEAST_STRETCH = 0.7
_UNKNOWN = "NIFTI_XFORM_UNKNOWN"
#: most that a matrix may move coordinates, mm: a scanner is smaller. Least by which two ways to the scanner differ, mm
_FAR, _APART = 1e4, 0.01
#: axes of FreeSurfer's coordinates, by row, along the axes of the voxels
_SURFACE_RAS = np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
#: Workbench records commands; this one moves coordinates, and leaves metadata as they were
_MOVED = re.compile(r"-surface-apply-(affine|warpfield)")
#: metadata of FreeSurfer, by row of an affine: axes of the volume, and its centre
_VOLUME = [f"VolGeom{axis}_{to}" for to in "RAS" for axis in "XYZC"]
_REMEDY = "export the surface again as GIfTI (.surf.gii) in mm, with an identity matrix or without the {}"


class System(NamedTuple):
    """A coordinate system as a GIfTI file states it: names of spaces, and the 16 numbers of the matrix."""

    dataspace: str
    xformspace: str
    matrix: Sequence[float]


def of_gifti(systems: Sequence[System], about: Mapping[str, str], provenance: str, path: str | Path) -> CoordinateFrame:
    """The coordinate system of a pointset: of several the one that leads to the scanner, else one that is there.

    Parameters
    ----------
    about : metadata of the pointset
    provenance : metadata of the file, in which Workbench records its commands

    Raises
    ------
    InputError : a name is not known, the matrix is not an affine, or it implies that the coordinates are not mm; or two
        systems lead to different locations in one space of the scanner
    """
    stated = [_frame(system, path) for system in systems]
    _require_one_way(stated, path)
    frame = min(stated, key=lambda one: (not one.leads_to_scanner, not one.is_placed), default=CoordinateFrame())
    if len(stated) > 1:
        named = "; ".join(f"{one.dataspace} to {one.xformspace}" for one in stated)
        used = f"{frame.dataspace} to {frame.xformspace}"
        logger.warning("%s: has several coordinate systems (%s); cortet uses %s", path, named, used)
    if not frame.is_placed and (own := _of_volume(about, path)).is_placed:
        if frame.dataspace == _UNKNOWN and not _MOVED.search(provenance):
            logger.info("%s: cortet places it in scanner space by its VolGeom metadata", path)
            frame = own
        else:
            placed = frame.dataspace != _UNKNOWN
            why = f"are in {frame.dataspace}" if placed else "were transformed by Workbench"
            logger.warning("%s: cortet ignores the VolGeom metadata: the coordinates %s", path, why)
    _check(frame, path, "matrix")
    return frame


def of_volume(axes: Any, centre: Any, path: str | Path, source: str) -> CoordinateFrame:
    """The frame of coordinates in FreeSurfer's axes of a volume; the identity, with a warning, if it is implausible.

    The number and the width of its voxels do not matter: the origin is the centre of the volume, whatever they are.

    Parameters
    ----------
    axes : (3, 3), in each column the direction of an axis of the voxels, in the scanner's space
    centre : (3,) mm, of the volume
    source : what states them, for messages
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.asarray(axes, float) @ _SURFACE_RAS.T, centre
    if not (np.any(axes) and np.isfinite(matrix).all() and (np.abs(matrix[:3, 3]) <= _FAR).all()):
        what = f"{np.asarray(axes).tolist()} around {np.asarray(centre).tolist()} mm"
        logger.warning("%s: cortet ignores the volume axes in %s, which are invalid: %s", path, source, what)
        return CoordinateFrame()
    frame = CoordinateFrame(_UNKNOWN, ANATOMICAL[0], tuple((matrix + 0.0).ravel().tolist()))
    _check(frame, path, source)
    return frame


def _of_volume(about: Mapping[str, str], path: str | Path) -> CoordinateFrame:
    """The frame by the metadata `VolGeom...`; the identity without them, or if they are incomplete (with a warning)."""
    if not any(key in about for key in _VOLUME):
        return CoordinateFrame()
    try:
        numbers = np.reshape([float(about[key]) for key in _VOLUME], (3, 4))
    except (KeyError, ValueError) as error:
        logger.warning("%s: cortet ignores the VolGeom metadata, which are incomplete: %s", path, error)
        return CoordinateFrame()
    return of_volume(numbers[:, :3], numbers[:, 3], path, "VolGeom metadata")


def _frame(system: System, path: str | Path) -> CoordinateFrame:
    """A system as a frame; one that says nothing has the identity."""
    try:
        dataspace, xformspace = (_space(name) for name in system[:2])
        whole = np.reshape(system.matrix, (4, 4))
        if not whole.any() or not all(name.startswith("NIFTI") for name in system[:2]):
            if not np.array_equal(whole, np.eye(4)):
                logger.warning("%s: cortet ignores a system without matrix or named spaces: %s", path, system)
            return CoordinateFrame(dataspace, dataspace)
        if not (np.isfinite(whole).all() and np.allclose(whole[3], [0, 0, 0, 1], atol=1e-6)):
            raise ValueError("the matrix is not an affine")
    except (KeyError, ValueError) as error:
        what = f"its coordinate system cannot be read: {error} ({system})"
        raise InputError(what, file=path, remedy=_REMEDY.format("coordinate system")) from None
    if dataspace == xformspace and not np.allclose(whole, np.eye(4), atol=1e-6):
        logger.warning("%s: its matrix maps %s to itself, so cortet ignores it", path, dataspace)
    return CoordinateFrame(dataspace, xformspace, tuple(whole.ravel().tolist()))


def _space(name: str) -> str:
    """The name of a space; NIfTI's number of it stands for the name, and no name for the unknown space."""
    code: Any = int(name) if name.isdigit() else name or _UNKNOWN
    return str(xform_codes.niistring[code])


def _require_one_way(stated: Sequence[CoordinateFrame], path: str | Path) -> None:
    """Raise InputError if the systems of one pointset lead to different locations in one space of the scanner."""
    ways: dict[str, CoordinateFrame] = {}
    for one in stated:
        space = one.xformspace if one.leads_to_scanner else one.dataspace
        other = ways.setdefault(space, one)
        if space in ANATOMICAL and np.abs(one.to_scanner - other.to_scanner).max() > _APART:
            what = f"its coordinate systems contradict each other: they map to different locations in {space}"
            raise InputError(what, file=path, remedy="remove whichever is wrong")


def _check(frame: CoordinateFrame, path: str | Path, source: str) -> None:
    """Raise InputError if the matrix of the coordinates implies that they are not mm, or leads out of the scanner.

    Coordinates stay as they are stored, in the space of the data; the matrix maps them to another space (GIfTI 1.0,
    section 2.3.4). A rigid motion changes no length. A matrix to a template does, but the stored brain is in mm. Any
    other matrix implies that the stored coordinates must be scaled or sheared to become mm.
    """
    linear = np.reshape(frame.matrix, (4, 4))[:3, :3]
    far = frame.leads_to_scanner and np.abs(frame.to_scanner[:3, 3]).max() > _FAR
    stretches = np.linalg.svd(linear, compute_uv=False)
    low, high, mirrored = stretches[-1], stretches[0], np.linalg.det(linear) < 0
    rigid = np.allclose(stretches, 1, atol=_RIGID) and not mirrored
    # FreeSurfer up to 7.3 names the space of its coordinates UNKNOWN, and gives the way to Talairach's
    least = _LEAST_STRETCH if frame.dataspace == _UNKNOWN else 0
    normalised = frame.xformspace in _TEMPLATES and frame.dataspace != frame.xformspace and low > least
    if far or not (rigid or (normalised and not (mirrored and least))):
        raise InputError(
            f"the {source} maps {frame.dataspace} to {frame.xformspace} by a transform that is not rigid or leaves "
            f"the scanner: lengths change by factors of {low:.4g} to {high:.4g}{', mirrored' if mirrored else ''}",
            file=path,
            remedy=_REMEDY.format(source),
        )
