"""What is written for a mesh, and under which names, for Python and the command line alike.

A rule of the workflow writes one of these files, by the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from cortet.config import Config
from cortet.formats import format_of
from cortet.formats.atomic import atomic_folder, write_record
from cortet.formats.certificates import sealed
from cortet.formats.ownership import delete_made, files_of, is_ours, json_of, may_write
from cortet.formats.tables import write_table
from cortet.formats.volumes import TISSUE_COLUMNS, Volume
from cortet.measure.certify import Certificate
from cortet.meshes import TetMesh, TriSurface, region_names
from cortet.solver_files.export import export_made
from cortet.solver_files.meshed import (
    Origin,
    certificate_path,
    meshed_files,
    require_own_stem,
    uncertified_path,
    write_meshed,
)
from cortet.solver_files.sidecar import sidecar_path
from cortet.solver_files.volumes import label_names


@dataclass(frozen=True, eq=False)
class Made:
    """A mesh, and all that is written of it."""

    mesh: TetMesh
    certificate: Certificate
    #: the surface that was meshed: the given one, repaired and smoothed
    surface: TriSurface
    #: mm
    cell_size: float
    #: where it comes from, as far as that is known: files, gestational age, hemisphere
    origin: Origin = field(default_factory=Origin)
    config: Config = field(default_factory=Config)
    #: files that it was made from; they are never overwritten
    inputs: tuple[Path, ...] = ()
    #: a row for each label of each volume, as `formats.volumes.TISSUE_COLUMNS`
    tissue_rows: tuple[Mapping[str, Any], ...] = ()
    #: its volumes, as they were read
    volumes: Mapping[str, Volume] = field(default_factory=dict)
    #: region -> surface that was given, in mm, the outermost first
    native: Mapping[str, TriSurface] = field(default_factory=dict)


class Files(NamedTuple):
    """The files of a mesh; the names of the others begin with its stem."""

    mesh: Path
    certificate: Path
    #: region -> surface that was meshed
    surfaces: dict[str, Path]
    #: table of the labels of its volumes, where it has some
    tissues: Path | None

    @property
    def all(self) -> list[Path]:
        """All but the mesh, with its sidecar."""
        tissues = [self.tissues] if self.tissues else []
        return [self.certificate, *self.surfaces.values(), *tissues, sidecar_path(self.mesh)]


def file_of(path: Path, *, certified: bool) -> Path:
    """The file of a mesh where `path` is asked for: the name of one that is not certified says so."""
    return path if certified else uncertified_path(path)


def files(path: Path, inner: Iterable[str], *, certified: bool, volumes: bool) -> Files:
    """The files of a mesh with some inner regions, and with or without volumes, where `path` is asked for."""
    file = file_of(path, certified=certified)
    table = file.with_name(f"{file.name.removesuffix(file.suffix)}.volumes.tsv")
    return Files(file, certificate_path(file), meshed_files(region_names(inner), file), table if volumes else None)


def deliver(
    made: Made,
    path: Path,
    *,
    force: bool = False,
    uncertified: bool = False,
    views: Callable[[Callable[[Path], Path]], None] = lambda _: None,
) -> list[str]:
    """Write a mesh with its certificate, the surface that was meshed, and a table of its labels (`files`).

    A mesh that is not certified gets another name, so that the files of an earlier mesh stay; of such a mesh, only the
    others are written unless `uncertified` is true.

    Parameters
    ----------
    force : replace the companions of another mesh
    views : writes pictures and pages; gets a function that gives the temporary name of each

    Returns
    -------
    What the format cannot hold, in words.
    """
    config, origin, certificate = made.config, made.origin, sealed(asdict(made.certificate))
    out = files(path, made.surface.inner, certified=made.certificate.certified, volumes=bool(made.tissue_rows))
    if not force:
        digest = made.certificate.mesh_sha256
        require_own_stem(out.mesh, origin.given, cell_size=made.cell_size, mesh_sha256=digest)
    for file in out.all:
        may_write(file)

    def temporary(file: Path) -> Path:
        return folder / file.name if file.parent.absolute() == out.certificate.parent.absolute() else file

    told: list[str] = []
    # files of an earlier mesh of this name are not to be taken for this one's
    with atomic_folder(out.certificate, replaced=(out.certificate, sidecar_path(out.mesh))) as folder:
        write_meshed(made.surface, temporary(out.mesh))
        if out.tissues:
            write_table(TISSUE_COLUMNS, made.tissue_rows, temporary(out.tissues))
        views(temporary)
        write_record(certificate, temporary(out.certificate))
        if made.certificate.certified or uncertified:
            told = export_made(
                made.mesh,
                made.surface,
                out.mesh,
                certificate=certificate,
                uncertified=uncertified,
                origin=replace(origin, meshed=out.surfaces),
                sets=config.export.sets(origin.kind),
                labels=label_names(made.volumes),
                arguments=config.export_arguments(format_of(out.mesh).name),
                temporary=folder,
            )
    if made.certificate.certified:
        _delete_failed(uncertified_path(path))
    return told


def _delete_failed(path: Path) -> None:
    """Delete an earlier mesh that was not certified, with its certificate; nothing if any of its files was edited."""
    records = [file for file in (sidecar_path(path), certificate_path(path)) if file.exists()]
    others = [path.with_name(name) for record in records for name in files_of(record)]
    if json_of(certificate_path(path)).get("certified") is False and all(map(is_ours, [*records, *others])):
        for record in records:
            delete_made(record)
