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
_TAKE_OUT = (
    "apply the matrix to the coordinates and store the identity; where coordinates are mm as they stand, take the "
    "matrix out of the file"
)
_OF_VOLUME = "mend {}, or take the volume out of the file: the coordinates are then used as they are"
_AGAIN = "export the surface again as GIfTI (.surf.gii)"


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
        named = ", ".join(f"{one.dataspace} to {one.xformspace}" for one in stated)
        logger.warning("%s: states %s: %s is taken", path, named, f"{frame.dataspace} to {frame.xformspace}")
    if not frame.is_placed and (own := _of_volume(about, path)).is_placed:
        if frame.dataspace != _UNKNOWN:
            logger.warning("%s: its VolGeom metadata are ignored, as its coordinates are in %s", path, frame.dataspace)
        elif _MOVED.search(provenance):
            logger.warning("%s: its VolGeom metadata are ignored, as Workbench has moved the coordinates since", path)
        else:
            logger.info("%s: placed in the scanner by its VolGeom metadata", path)
            frame = own
    _check(frame, path)
    return frame


def of_volume(axes: Any, centre: Any, path: str | Path, source: str) -> CoordinateFrame:
    """The frame of coordinates in FreeSurfer's axes of a volume; that of nothing, which is said, if it is absurd.

    The number and the width of its voxels do not matter: the origin is the centre of the volume, whatever they are.

    Parameters
    ----------
    axes : (3, 3), in each column the direction of an axis of the voxels, in the scanner's space
    centre : (3,) mm, of the volume
    source : what states them, for messages
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.asarray(axes, float) @ _SURFACE_RAS.T, centre
    why = "has axes of 0" if not np.any(axes) else "has axes that are not finite" if not np.isfinite(axes).all() else ""
    if not (np.abs(centre) <= _FAR).all():
        why = f"lies at {np.asarray(centre).tolist()} mm"
    if why:
        logger.warning("%s: the volume in %s %s, so cortet ignores it and keeps the coordinates", path, source, why)
        return CoordinateFrame()
    frame = CoordinateFrame(_UNKNOWN, ANATOMICAL[0], tuple((matrix + 0.0).ravel().tolist()))
    _check(frame, path, _OF_VOLUME.format(source))
    return frame


def _of_volume(about: Mapping[str, str], path: str | Path) -> CoordinateFrame:
    """The frame by the metadata `VolGeom...`; that of nothing without them, or if they are not complete (said)."""
    values: list[float] = []
    keys = [f"VolGeom{axis}_{to}" for to in "RAS" for axis in "XYZC"]
    if not any(key in about for key in keys):
        return CoordinateFrame()
    for key in keys:
        try:
            values.append(float(about[key]))
        except (KeyError, ValueError):
            why = f"{key} is {repr(about[key]) if key in about else 'missing'}"
            logger.warning("%s: cortet ignores the VolGeom metadata, as %s, and keeps the coordinates", path, why)
            return CoordinateFrame()
    numbers = np.reshape(values, (3, 4))
    return of_volume(numbers[:, :3], numbers[:, 3], path, "its VolGeom metadata")


def _frame(system: System, path: str | Path) -> CoordinateFrame:
    """A system as a frame; one that says nothing has the identity."""
    dataspace, xformspace = (_space(name, path) for name in system[:2])
    values = np.asarray(system.matrix, float)
    if values.size != 16:
        what = f"coordinate transform of {values.size} numbers instead of 16"
        raise InputError(what, file=path, remedy=_AGAIN)
    whole = values.reshape(4, 4)
    if not np.isfinite(whole).all():
        raise InputError("coordinate transform with numbers that are not finite", file=path, remedy=_AGAIN)
    named = all(name.strip().startswith("NIFTI") for name in system[:2])
    if not whole.any() or not named:
        if not np.array_equal(whole, np.eye(4)):
            why = "the matrix of its coordinates is 0" if named else f"its spaces are {system[0]!r} and {system[1]!r}"
            logger.warning("%s: %s, so cortet applies no transform", path, why)
        return CoordinateFrame(dataspace, dataspace)
    if not np.allclose(whole[3], [0, 0, 0, 1], atol=1e-6):
        what = f"the last row of the matrix of its coordinates is {whole[3].tolist()}, not 0 0 0 1"
        raise InputError(what, file=path, remedy=_AGAIN)
    if dataspace == xformspace and not np.allclose(whole, np.eye(4), atol=1e-6):
        logger.warning("%s: its matrix maps %s to itself, so cortet ignores it", path, dataspace)
    return CoordinateFrame(dataspace, xformspace, tuple(whole.ravel().tolist()))


def _space(name: str, path: str | Path) -> str:
    """The name of a space; NIfTI's number of it stands for the name, and no name for the unknown space."""
    name = name.strip()
    try:
        code: Any = int(name) if name.isdigit() else name
        return str(xform_codes.niistring[code]) if name else _UNKNOWN
    except KeyError:
        raise InputError(f"the space {name!r} is not known", file=path, remedy=_AGAIN) from None


def _require_one_way(stated: Sequence[CoordinateFrame], path: str | Path) -> None:
    """Raise InputError if the systems of one pointset lead to different locations in one space of the scanner."""
    ways: dict[str, CoordinateFrame] = {}
    for one in stated:
        space = one.xformspace if one.leads_to_scanner else one.dataspace
        if space in ANATOMICAL:
            other = ways.setdefault(space, one)
            apart = np.abs(one.to_scanner - other.to_scanner).max()
            if apart > _APART:
                what = f"{other.dataspace} to {other.xformspace} and {one.dataspace} to {one.xformspace}"
                raise InputError(
                    f"its coordinate systems {what} contradict each other: locations in {space} differ by up to "
                    f"{apart:.4g} mm",
                    file=path,
                    remedy="remove the one that is wrong",
                )


def _check(frame: CoordinateFrame, path: str | Path, remedy: str = _TAKE_OUT) -> None:
    """Raise InputError if the matrix of the coordinates implies that they are not mm, or leads out of the scanner.

    Coordinates stay as they are stored, in the space of the data; the matrix maps them to another space (GIfTI 1.0,
    section 2.3.4). A rigid motion changes no length. A matrix to a template does, but the stored brain is in mm. Any
    other matrix implies that the stored coordinates must be scaled or sheared to become mm.
    """
    linear = np.reshape(frame.matrix, (4, 4))[:3, :3]
    if frame.leads_to_scanner and (moved := np.abs(frame.to_scanner[:3, 3]).max()) > _FAR:
        what = f"the matrix to {frame.xformspace} moves its coordinates by {moved:.4g} mm"
        raise InputError(what, file=path, remedy=remedy)
    stretches = np.linalg.svd(linear, compute_uv=False)
    low, high, mirrored = stretches[-1], stretches[0], np.linalg.det(linear) < 0
    rigid = np.allclose(stretches, 1, atol=_RIGID) and not mirrored
    # FreeSurfer up to 7.3 names the space of its coordinates UNKNOWN, and gives the way to Talairach's
    least = _LEAST_STRETCH if frame.dataspace == _UNKNOWN else 0
    normalised = frame.xformspace in _TEMPLATES and frame.dataspace != frame.xformspace and low > least
    if rigid or (normalised and not (mirrored and least)):
        return
    raise InputError(
        f"the matrix from its coordinates ({frame.dataspace}) to {frame.xformspace} is not a rigid motion: lengths "
        f"change by {low:.4g} to {high:.4g}" + (", mirrored" if mirrored else ""),
        file=path,
        remedy=remedy,
    )
