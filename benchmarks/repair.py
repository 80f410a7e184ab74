"""What repair does to broken surfaces: how far it goes from the file, and whether the mesh is certified then.

    python benchmarks/repair.py FILE... [--cell-size 1.0] [--config limits.yaml] [--keep FOLDER]
    python benchmarks/repair.py --breakages GOOD_SURFACE... [--config limits.yaml] [--keep FOLDER]

One row per file: what was repaired, or why it was refused, then the whole line at one cell size, without smoothing.
With `--breakages`, good surfaces are broken in known ways (`breakages.py`), and distances are those to the good one,
both ways. CPU seconds of `repair` are those of all threads with kernels compiled, without reading.
"""

from __future__ import annotations

import argparse
import logging
import time
from pathlib import Path
from typing import Any

import yaml
from breakages import BREAKAGES
from rows import in_own_process, print_row

from cortet.config import Config, load
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.placement import placed
from cortet.geometry.topology import enclosed_volume
from cortet.measure.certify import certify
from cortet.measure.fidelity import summary
from cortet.measure.lost import distances_to
from cortet.meshes import TetMesh, TriSurface
from cortet.phantom import phantom
from cortet.pipeline import run
from cortet.stages.gate import gate
from cortet.stages.repair import repair

FILE_COLUMNS = (
    *("surface", "h_mm", "outcome", "displacement_max_mm", "file_to_surface_max_mm", "surface_to_file_max_mm"),
    *("volume_change", "area_change", "repair_cpu_s", "certified", "tets", "q_max", "line_cpu_s", "steps", "why_not"),
)
BREAKAGE_COLUMNS = (
    *("surface", "breakage", "outcome", "good_to_repaired_mean_mm", "good_to_repaired_max_mm"),
    *("repaired_to_good_mean_mm", "repaired_to_good_max_mm", "volume_against_good", "repair_cpu_s", "steps", "why_not"),
)


def repaired(surface: TriSurface, config: Config, row: dict[str, Any]) -> TriSurface | None:
    """The repaired surface, what was done being added to the row; None where it was refused."""
    began = time.process_time()
    try:
        made, report = repair(surface, **config.arguments("repair", {"source": None}))
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


def measure(file: Path, cell_size: float, options: argparse.Namespace, answer) -> None:  # type: ignore[no-untyped-def]
    """Repair and mesh one file in this process, and send back its row."""
    logging.disable()
    config = _config(options, cell_size)
    list(run(phantom(24.0, subdivisions=3), load({"generate": {"cell_size": 4.0}})))  # compiles
    row: dict[str, Any] = {"surface": file.name, "h_mm": cell_size}
    try:
        given = placed(read_surface(file, finite=False), config.placement())
        made = repaired(given, config, row)
        if made is not None:
            _keep(made, options.keep, file.name)
            began = time.process_time()
            for step in run(made, _without_placement(config), source=file):
                mesh, surface = step.result, step.surface
            assert isinstance(mesh, TetMesh)  # the line ends with a mesh
            row["line_cpu_s"] = time.process_time() - began
            verdict = certify(mesh, surface, **config.arguments("certify", {"cell_size": cell_size}))
            row |= {"certified": "yes" if verdict.certified else "no", "why_not": "; ".join(verdict.reasons)}
            row |= {"tets": len(mesh.cells), "q_max": verdict.quality.q.max}
    except CortetError as error:
        row |= {"certified": "no", "why_not": str(error)}
    answer.send(row)


def broken(file: Path, name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Break a good surface, repair it, and compare it with the good one."""
    config = _config(options, 1.0)
    good, _ = gate(placed(read_surface(file), config.placement()), source=file)
    row: dict[str, Any] = {"surface": file.name, "breakage": name}
    try:
        surface = BREAKAGES[name](good)
    except ValueError as error:
        return row | {"outcome": "not broken", "why_not": str(error)}
    made = repaired(surface, config, row)
    if made is None:
        return row
    _keep(surface, options.keep, f"{file.name.split('.')[0]}_{name}_broken.surf.gii")
    _keep(made, options.keep, f"{file.name.split('.')[0]}_{name}_repaired.surf.gii")
    there, back = summary(distances_to(made, good)), summary(distances_to(good, made))
    volumes = [enclosed_volume(one.points, one.faces) for one in (made, good)]
    return row | {
        "good_to_repaired_mean_mm": there.mean,
        "good_to_repaired_max_mm": there.max,
        "repaired_to_good_mean_mm": back.mean,
        "repaired_to_good_max_mm": back.max,
        "volume_against_good": volumes[0] / volumes[1] - 1,
    }


def _config(options: argparse.Namespace, cell_size: float) -> Config:
    data = yaml.safe_load(options.config.read_text(encoding="utf-8")) if options.config else {}
    return load({**data, "generate": {**data.get("generate", {}), "cell_size": cell_size}})


def _without_placement(config: Config) -> Config:
    """The configuration for a surface that is placed already."""
    return config.model_copy(update={"gate": config.gate.model_copy(update={"unit": "mm", "affine": None})})


def _keep(surface: TriSurface, folder: Path | None, name: str) -> None:
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        write_surface(surface, folder / name.replace(" ", "-"))


def main() -> None:
    """Print one of the two tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--breakages", action="store_true", help="the surfaces are good: break them first")
    parser.add_argument("--cell-size", type=float, default=1.0)
    parser.add_argument("--config", type=Path, help="YAML file with the limits of repair, and gate.unit or gate.affine")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the surfaces there")
    options = parser.parse_args()
    columns = BREAKAGE_COLUMNS if options.breakages else FILE_COLUMNS
    print(*columns, sep="\t")
    logging.disable()
    for file in options.surfaces:
        if options.breakages:
            for name in BREAKAGES:
                print_row(columns, broken(file, name, options))
        else:
            print_row(columns, in_own_process(measure, file, options.cell_size, options))


if __name__ == "__main__":
    main()
