"""What does repair do to broken surfaces, and to handles of labels: how far does it go, and what does it cost?

    python benchmarks/repair.py FILE... [--cell-size 1.0] [--config limits.yaml] [--keep FOLDER]
    python benchmarks/repair.py --breakages GOOD_SURFACE... [--config limits.yaml] [--keep FOLDER]
    python benchmarks/repair.py labels VOLUME:LABELS... [--mni152 FILE]

One row per file: what was repaired, or why it was refused, then the whole line at one cell size, without smoothing.
With `--breakages`, good surfaces are broken in known ways (`breakages.py`), and distances are those to the good one,
both ways. CPU seconds of `repair` are those of all threads, without reading.

`labels` cuts or closes handles on the voxels: one row per component of at least 1,000. `furthest` is how far the
surface is from the boundary of the voxels, in voxels, and `as they are` that of the surface with its handles. With
`--mni152`, the labels of MNI152 are written first, from the templates at 1 mm that nilearn ships (`pip install
--no-deps nilearn`): 1 grey and 2 white matter, each above one half, and 3 what else is inside the brain.
"""

from __future__ import annotations

import importlib.util
import logging
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import nibabel as nib
import numpy as np
import yaml
from _frame import Row, Table, alone, command, config_of, mesh
from breakages import BREAKAGES

from cortet.config import Config
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.placement import placed
from cortet.formats.volumes import read_labels, write_volume
from cortet.geometry.label_surface import AS_THEY_ARE, Handles, label_surfaces
from cortet.geometry.topology import enclosed_volume
from cortet.measure.fidelity import summary
from cortet.measure.lost import distances_to
from cortet.meshes import TriSurface
from cortet.pipeline import warm_up
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
            line = mesh(made, _without_placement(config), source=file)
            verdict = line.made.certificate
            row |= {"certified": "yes" if verdict.certified else "no", "why_not": "; ".join(verdict.reasons)}
            row |= {"line_cpu_s": line.used["cpu_seconds"]}
            row |= {"tets": len(line.made.mesh.cells), "q_max": verdict.quality.q.max}
    except CortetError as error:
        row |= {"certified": "no", "why_not": str(error)}
    return row


def broken(file: Path, name: str, limits: Path | None, keep: Path | None) -> dict[str, Any]:
    """Break a good surface, repair it, and compare it with the good one."""
    config = _config(limits, 1.0)
    good, _ = gate(placed(read_surface(file), config.placement()), source=file)
    row: dict[str, Any] = {"surface": file.name, "breakage": name}
    try:
        surface = BREAKAGES[name](good)
    except ValueError as error:
        return row | {"outcome": "not broken", "why_not": str(error)}
    made = repaired(surface, config, row)
    if made is None:
        return row
    _keep(surface, keep, f"{file.name.split('.')[0]}_{name}_broken.surf.gii")
    _keep(made, keep, f"{file.name.split('.')[0]}_{name}_repaired.surf.gii")
    there, back = summary(distances_to(made, good)), summary(distances_to(good, made))
    volumes = [enclosed_volume(one.points, one.faces) for one in (made, good)]
    return row | {
        "good_to_repaired_mean_mm": there.mean,
        "good_to_repaired_max_mm": there.max,
        "repaired_to_good_mean_mm": back.mean,
        "repaired_to_good_max_mm": back.max,
        "volume_against_good": volumes[0] / volumes[1] - 1,
    }


def _config(limits: Path | None, cell_size: float) -> Config:
    return config_of(cell_size, **(yaml.safe_load(limits.read_text(encoding="utf-8")) if limits else {}))


def _without_placement(config: Config) -> Config:
    """The configuration for a surface that is placed already."""
    return config.model_copy(update={"gate": config.gate.model_copy(update={"unit": "mm", "affine": None})})


def _keep(surface: TriSurface, folder: Path | None, name: str) -> None:
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        write_surface(surface, folder / name.replace(" ", "-"))


def surfaces(
    surfaces: Sequence[Path],
    *,
    breakages: bool = False,
    cell_size: float = 1.0,
    config: Path | None = None,
    keep: Path | None = None,
) -> None:
    """Print one of the two tables.

    breakages : the surfaces are good: break them first
    config : YAML file with the limits of repair, and gate.unit or gate.affine
    keep : folder for the surfaces
    """
    logging.disable()
    table = Table(*(BREAKAGE_COLUMNS if breakages else FILE_COLUMNS))
    if breakages:
        for file, name in product(surfaces, BREAKAGES):
            table.add(broken(file, name, config, keep))
        return
    for file in surfaces:
        table.add({"surface": file.name, "h_mm": cell_size}, alone(of_file, file, cell_size, config, keep))


# --- handles of labels -----------------------------------------------------------------------------------------------

LABEL_COLUMNS = ("labels", "voxels", "handles", "left", "changed", "changed_share", "furthest", "furthest_as_they_are")
LABEL_COLUMNS += ("faces", "faces_as_they_are", "cpu_seconds", "cpu_seconds_as_they_are")
#: components of fewer voxels are left out
SMALLEST = 1000
#: templates of nilearn: amounts of grey and white matter, and the image of the brain without skull
_TISSUES = ("gm", "wm", "t1")
#: share of the brightest voxel above which nilearn takes the image for brain
_BRAIN = 0.2


def write_mni152(path: Path) -> None:
    """Grey (1) and white matter (2) of MNI152, and what else is brain (3), at 1 mm; nilearn need not be able to run."""
    spec = importlib.util.find_spec("nilearn")
    if spec is None or not spec.submodule_search_locations:
        sys.exit("nilearn is not installed: pip install --no-deps nilearn")
    folder = Path(spec.submodule_search_locations[0]) / "datasets/data"
    images = [nib.load(folder / f"mni_icbm152_{tissue}_tal_nlin_sym_09a_converted.nii.gz") for tissue in _TISSUES]
    grey, white, brain = (image.get_fdata() / image.get_fdata().max() for image in images)
    labels = np.where(white > 0.5, 2, np.where(grey + white > 0.5, 1, np.where(brain > _BRAIN, 3, 0)))
    write_volume(labels.astype(np.uint8), images[0].affine, path)


def labels(volumes: Sequence[str], *, mni152: Path | None = None) -> None:
    """One row per component of VOLUME:LABELS.

    mni152 : write the labels of MNI152 there first
    """
    if mni152:
        write_mni152(mni152)
    table = Table(*LABEL_COLUMNS)
    for text in volumes:
        volume, keys = read_labels(text)
        mask = np.isin(volume.values, keys)
        found, seconds = [], []
        for handles in (Handles(0), AS_THEY_ARE):
            began = time.process_time()
            found.append(label_surfaces(mask, volume.affine, smallest=SMALLEST, handles=handles)[0])
            seconds.append(time.process_time() - began)
        for made, as_is in zip(*found, strict=True):
            voxels = round(made.volume / abs(np.linalg.det(volume.affine[:3, :3])))
            table.add(
                {
                    "labels": text,
                    "voxels": voxels,
                    "handles": made.handles,
                    "left": made.left,
                    "changed": made.changed,
                    "changed_share": made.changed / voxels,
                    "furthest": made.furthest,
                    "furthest_as_they_are": as_is.furthest,
                    "faces": len(made.surface.faces),
                    "faces_as_they_are": len(as_is.surface.faces),
                    "cpu_seconds": seconds[0],
                    "cpu_seconds_as_they_are": seconds[1],
                },
            )


main = command(__doc__, surfaces, labels)

if __name__ == "__main__":
    main()
