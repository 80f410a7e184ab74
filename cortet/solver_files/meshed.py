"""The surface that was meshed: its file is beside the mesh, and the sidecar of the mesh names it.

It differs from the surface that the user gave if repair, smoothing or separation changed it. A mesh can only be checked
against the surface that it fills.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from cortet.errors import DamagedFileError, InputError
from cortet.formats.certificates import OF_SOLVERS, OF_UNCERTIFIED, certificate_of, is_edited
from cortet.formats.gifti import hemisphere_of, kind_of, read_surface, write_surface
from cortet.formats.hashing import input_sha256
from cortet.formats.ownership import json_of, mesh_of
from cortet.geometry.nesting import nested, sheets
from cortet.measure.electrodes import ElectrodeRecord
from cortet.meshes import BRAIN, OUTERMOST, TriSurface, region_names
from cortet.solver_files.sidecar import read_sidecar, sidecar_path
from cortet.solver_files.volumes import sources
from cortet.stages import STAGES

logger = logging.getLogger(__name__)

#: end of the stem of a file whose mesh is not certified
UNCERTIFIED = "_uncertified"
#: a hemisphere
Hemisphere = Literal["L", "R"]


def write_meshed(surface: TriSurface, mesh: Path) -> dict[str, Path]:
    """Write the surface that was meshed, and its inner surfaces, beside the mesh; returns the files by region.

    Parameters
    ----------
    surface : as `pipeline.Meshed.surface`; float32 coordinates in the files
    mesh : file of the mesh, whose stem the names begin with
    """
    files = meshed_files(region_names(surface.inner), mesh)
    for region, one in zip(files, sheets(surface), strict=True):
        write_surface(one, files[region])
    return files


def meshed_files(regions: Iterable[str], mesh: Path) -> dict[str, Path]:
    """Names of the files of the surfaces that were meshed, by region; they begin with the stem of the mesh's file.

    Parameters
    ----------
    regions : the one inside the outer surface first
    """
    named = {region: f"-{region}" if number else "" for number, region in enumerate(regions)}
    return {region: mesh.with_name(f"{mesh.stem}.meshed{of}.surf.gii") for region, of in named.items()}


def certificate_path(mesh: Path) -> Path:
    """The certificate beside a mesh; its name begins with the stem of the mesh's file."""
    return mesh.with_name(f"{mesh.stem}.certificate.json")


def uncertified_path(mesh: Path) -> Path:
    """The name of a mesh that is not certified: `x_uncertified.vtu` for `x.vtu`."""
    return mesh if is_named_uncertified(mesh) else mesh.with_name(f"{mesh.stem}{UNCERTIFIED}{mesh.suffix}")


def refuse_uncertified_name(mesh: Path) -> None:
    """Raise InputError for a mesh that is to be certified and whose name would say that it is not."""
    if is_named_uncertified(mesh):
        what = f"ends with {UNCERTIFIED}, by which cortet names meshes that are not certified"
        raise InputError(what, file=mesh, remedy="give another name")


def is_named_uncertified(mesh: Path) -> bool:
    """Whether the name of a mesh says that it is not certified."""
    return mesh.stem.endswith(UNCERTIFIED)


def cell_size_of(mesh: Path) -> float | None:
    """Cell size, mm, that the certificate beside a mesh records, of a command or of the workflow; None without one."""
    stages = parameters_of(mesh)
    size: float | None = stages.get("generate", stages.get("certify", {})).get("cell_size")
    if size is not None and (isinstance(size, bool) or not isinstance(size, int | float)):
        raise DamagedFileError(f"its certificate has the cell size {size!r}", file=mesh)
    return size


def parameters_of(mesh: Path) -> dict[str, Any]:
    """Stage -> its parameters, by `certificate_beside`.

    Raises
    ------
    DamagedFileError : the certificate holds parameters of another form
    """
    found = certificate_beside(mesh).get("parameters") or {}
    if not isinstance(found, dict) or not all(isinstance(stage, dict) for stage in found.values()):
        what = "cannot be read as a certificate: its parameters have another form"
        raise DamagedFileError(what, file=certificate_path(mesh))
    return found


def certificate_file(mesh: Path) -> Path:
    """The certificate beside a mesh, of a command or of the workflow, whether it exists or not."""
    stem = mesh.stem.removesuffix("_tetmesh").removesuffix("_sets")
    for label in (STAGES["solver_ready"].label, OF_UNCERTIFIED):
        stem = stem.replace(label, OF_SOLVERS)
    of_workflow = mesh.with_name(f"{stem}_certificate.json")
    return of_workflow if of_workflow.exists() else certificate_path(mesh)


def certificate_beside(mesh: Path) -> dict[str, Any]:
    """Content of `certificate_file`; empty if it is missing, was edited, or is of another mesh by the sidecar."""
    path = certificate_file(mesh)
    if is_edited(path):
        logger.warning("%s: was edited or damaged, so it counts for nothing; `cortet certify` makes another one", path)
        return {}
    found = json_of(path)
    return found if mesh_of(sidecar_path(mesh)) in (None, found.get("mesh_sha256")) else {}


def electrodes_of(mesh: Path) -> tuple[ElectrodeRecord, ...]:
    """The contacts of electrodes on a mesh, by `certificate_beside`; DamagedFileError if they have another form."""
    try:
        return TypeAdapter(tuple[ElectrodeRecord, ...]).validate_python(
            certificate_beside(mesh).get("electrodes") or ()
        )
    except ValidationError as error:
        what = "cannot be read as a certificate: its electrodes have another form"
        raise DamagedFileError(what, file=certificate_file(mesh)) from error


def why_uncertified(mesh: Path) -> list[str]:
    """Why the certificate beside a mesh fails it, in words; empty without one, and for a certified mesh."""
    if is_edited(certificate_file(mesh)):
        return ["its certificate is damaged or edited"]
    content = certificate_of(certificate_file(mesh))
    return [] if content.get("certified", True) else list(content["reasons"])


def repair_of(mesh: Path, surface: Path | None) -> dict[str, Any]:
    """The report of `repair` on the surface that a mesh is checked against; empty if it was not the one meshed.

    Parameters
    ----------
    surface : file of the surface, from `meshed_surface`
    """
    recorded = (read_sidecar(mesh).get("made_from") or {}).get("meshed") or {}
    meshed = [(mesh.parent / one["file"]).resolve() for one in recorded.values()]
    reports = certificate_beside(mesh).get("reports")
    if surface is None or surface.resolve() not in meshed or not isinstance(reports, dict):
        return {}
    found: dict[str, Any] = reports.get("repair") or {}
    return found


def require_own_stem(
    mesh: Path, given: Mapping[str, str | Path], *, cell_size: float, mesh_sha256: str | None = None
) -> None:
    """Raise InputError if another mesh has the same stem as the mesh to be made.

    The names of certificate and meshed surface begin with the stem, so those of the new mesh would replace the others.
    The same mesh in another format shares them.

    Parameters
    ----------
    mesh : file that is to be written
    given : region -> file of the surface that it is made from
    cell_size : mm
    mesh_sha256 : of `hashing.mesh_sha256`; None before the mesh is made
    """
    size, digest = cell_size_of(mesh) or cell_size, json_of(certificate_path(mesh)).get("mesh_sha256")
    beside = mesh.parent.iterdir() if mesh.parent.is_dir() else ()
    for other in (file for file in beside if file.stem == mesh.stem and file.name != mesh.name):
        record = (read_sidecar(other).get("made_from") or {}).get("given")
        if not record:
            continue
        if {region: one["sha256"] for region, one in record.items()} != {
            region: input_sha256(file) for region, file in given.items()
        }:
            differs = "a mesh of another surface"
        elif size != cell_size:
            differs = f"a mesh of cell size {size:g} mm"
        elif mesh_sha256 and digest and digest != mesh_sha256:
            differs = "a mesh of other parameters"
        else:
            continue
        raise InputError(
            f"would overwrite the certificate and the meshed surface of {other.name}, which is {differs}",
            file=mesh,
            remedy="give another name, or delete the other mesh and its sidecar",
        )


@dataclass(frozen=True)
class Origin:
    """Where a mesh comes from, as far as it is known: what its sidecar records."""

    #: region -> file of the surface that the user gave, and of the surface that was meshed
    given: Mapping[str, str | Path] = field(default_factory=dict)
    meshed: Mapping[str, Path] = field(default_factory=dict)
    #: name -> file of a field of the surface, and `FILE` or `FILE:KIND` of a volume
    fields: Mapping[str, str | Path] = field(default_factory=dict)
    volumes: Mapping[str, str] = field(default_factory=dict)
    #: gestational age of the brain, weeks; its hemisphere and the kind of surface if no given file says them
    age: float | None = None
    hemisphere: Hemisphere | None = None
    kind: str | None = None

    def made_from(self, folder: Path, temporary: Path | None = None) -> dict[str, Any]:
        """The entries of a sidecar in a folder, to which names of files are relative.

        Parameters
        ----------
        temporary : folder in which the surfaces that were meshed are until they get their names
        """
        brain = next((self.given[region] for region in (OUTERMOST, BRAIN) if region in self.given), None)
        known = {
            "hemisphere": self.hemisphere or (hemisphere_of(brain) if brain else None),
            "gestational_age": None if self.age is None else float(self.age),
            "surface": self.kind or (kind_of(brain) if brain else None),
            "volumes": sources(self.volumes) or None,
        }
        surfaces = {
            which: {
                region: {
                    "file": Path(os.path.relpath(file, folder)).as_posix(),
                    "sha256": input_sha256(temporary / Path(file).name if temporary and which == "meshed" else file),
                }
                for region, file in files.items()
            }
            for which, files in {"given": self.given, "meshed": self.meshed}.items()
        }
        return {**surfaces, **{name: value for name, value in known.items() if value is not None}}


def moved(record: Mapping[str, Any] | None, source: Path, target: Path) -> dict[str, Any] | None:
    """The entry of `made_from` for a sidecar in another folder."""
    if not record:
        return None
    surfaces = {
        kind: {
            region: {**one, "file": Path(os.path.relpath(source / one["file"], target)).as_posix()}
            for region, one in record.get(kind, {}).items()
        }
        for kind in ("given", "meshed")
    }
    return {**record, **surfaces}


def recorded_file(mesh: Path, record: Mapping[str, str]) -> Path:
    """The file of a surface that the sidecar of a mesh records; InputError if it is missing or has changed since."""
    file = mesh.parent / record["file"]
    if not file.is_file() or input_sha256(file) != record["sha256"]:
        raise InputError(
            f"is missing, or differs from the record in the sidecar of {mesh.name}",
            file=file,
            remedy="restore it, name the surface (`cortet project`: --surface), or mesh the surface again",
        )
    return file


def meshed_surface(mesh: Path, given: Path | None, inner: Mapping[str, Path]) -> tuple[TriSurface, Path]:
    """The surface against which a mesh is checked, with its inner surfaces; and its file.

    It is the surface that was meshed if the sidecar of the mesh names it and the surfaces given here, if any, are those
    given then. Otherwise it is the surface given here.

    Parameters
    ----------
    mesh : file of the mesh
    given : file of a surface
    inner : region -> file of a surface within it
    """
    record = read_sidecar(mesh).get("made_from")
    named = ({region_names(inner)[0]: given} if given else {}) | dict(inner)
    if record and not record.get("meshed"):
        record = None
    if record and all(
        input_sha256(file) == record.get("given", {}).get(region, {}).get("sha256") for region, file in named.items()
    ):
        files = {region: recorded_file(mesh, one) for region, one in record["meshed"].items()}
        given = files.pop(next(iter(files)))
        inner = files
    if given is None:
        raise InputError("no sidecar records which surface was meshed", file=mesh, remedy="also name the surface")
    return nested(read_surface(given), {region: read_surface(file) for region, file in inner.items()}), given
