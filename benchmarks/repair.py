"""What does repair do to broken surfaces: how far does it go, and what does it cost?

    python benchmarks/repair.py FILE... [--cell-size 1.0] [--config limits.yaml] [--keep FOLDER]

One row per file: what was repaired, or why it was refused, then the whole line at one cell size, without smoothing.
CPU seconds of `repair` are those of all threads, without reading.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from _frame import Row, Table, alone, command, config_of, mesh

from cortet.config import Config
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.placement import placed
from cortet.meshes import TriSurface
from cortet.pipeline import warm_up
from cortet.stages.repair import repair

FILE_COLUMNS = (
    *("surface", "h_mm", "outcome", "displacement_max_mm", "file_to_surface_max_mm", "surface_to_file_max_mm"),
    *("volume_change", "area_change", "repair_cpu_s", "certified", "tets", "q_max", "line_cpu_s", "steps", "why_not"),
)


def repaired(surface: TriSurface, config: Config, row: dict[str, Any]) -> TriSurface | None:
    """The repaired surface, what was done being added to the row; None where it was refused."""
    began = time.process_time()
    try:
        made, report = repair(surface, config.repair, source=None, allow_genus=config.gate.allow_genus)
    except CortetError as error:
        row |= {"outcome": "refused", "why_not": str(error), "repair_cpu_s": time.process_time() - began}
        return None
    row |= {
        "outcome": "repaired" if report.repaired else "as given",
        "displacement_max_mm": report.displacement_max_mm,
        "file_to_surface_max_mm": report.file_to_surface_mm.max,
        "surface_to_file_max_mm": report.surface_to_file_mm.max,
        "volume_change": report.relative_volume_change,
        "area_change": report.relative_area_change,
        "repair_cpu_s": time.process_time() - began,
        "steps": "; ".join(f"{step.count} {step.done}" for step in report.steps),
    }
    return made


def of_file(file: Path, cell_size: float, limits: Path | None, keep: Path | None) -> Row:
    """Repair and mesh one file in this process; its row."""
    logging.disable()
    warm_up()
    config = _config(limits, cell_size)
    row: dict[str, Any] = {}
    try:
        made = repaired(placed(read_surface(file, finite=False), config.placement()), config, row)
        if made is not None:
            _keep(made, keep, file.name)
            line = mesh(made, _without_placement(config), source=str(file))
            verdict = line.made.certificate
            row |= {"certified": "yes" if verdict.certified else "no", "why_not": "; ".join(verdict.reasons)}
            row |= {"line_cpu_s": line.used["cpu_seconds"]}
            row |= {"tets": len(line.made.mesh.cells), "q_max": verdict.quality.q.max}
    except CortetError as error:
        row |= {"certified": "no", "why_not": str(error)}
    return row


def _config(limits: Path | None, cell_size: float) -> Config:
    return config_of(cell_size, **(yaml.safe_load(limits.read_text(encoding="utf-8")) if limits else {}))


def _without_placement(config: Config) -> Config:
    """The configuration for a surface that is placed already."""
    return config.model_copy(update={"gate": config.gate.model_copy(update={"unit": "mm"})})


def _keep(surface: TriSurface, folder: Path | None, name: str) -> None:
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        write_surface(surface, folder / name.replace(" ", "-"))


def surfaces(
    surfaces: Sequence[Path],
    *,
    cell_size: float = 1.0,
    config: Path | None = None,
    keep: Path | None = None,
) -> None:
    """Repair and mesh each surface.

    Parameters
    ----------
    config
        YAML file with the limits of repair, and gate.unit.
    keep
        Folder for the surfaces.
    """
    table = Table(*FILE_COLUMNS)
    for file in surfaces:
        table.add({"surface": file.name, "h_mm": cell_size}, alone(of_file, file, cell_size, config, keep))


main = command(__doc__, surfaces)

if __name__ == "__main__":
    main()
