"""Handles of labels, cut or closed on the voxels: how many, how much that changes, and what it costs.

    python benchmarks/label_handles.py VOLUME:LABELS... [--mni152 FILE]

One row per component of at least 1,000 voxels. `furthest` is how far the surface is from the boundary of the voxels, in
voxels, and `as they are` that of the surface with its handles; CPU seconds are those of all threads. With `--mni152`,
the labels of MNI152 are written first, from the templates at 1 mm that nilearn ships (`pip install --no-deps nilearn`):
1 grey and 2 white matter, each above one half, and 3 what else is inside the brain.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from pathlib import Path

import nibabel as nib
import numpy as np
from rows import print_row

from cortet.formats.volumes import read_labels, write_volume
from cortet.geometry.label_surface import AS_THEY_ARE, Handles, label_surfaces

COLUMNS = ("labels", "voxels", "handles", "left", "changed", "changed_share", "furthest", "furthest_as_they_are")
COLUMNS += ("faces", "faces_as_they_are", "cpu_seconds", "cpu_seconds_as_they_are")
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


def main() -> None:
    """One row per component."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("labels", nargs="+", metavar="VOLUME:LABELS")
    parser.add_argument("--mni152", type=Path, metavar="FILE", help="write the labels of MNI152 there first")
    options = parser.parse_args()
    if options.mni152:
        write_mni152(options.mni152)
    print("\t".join(COLUMNS))
    for text in options.labels:
        volume, keys = read_labels(text)
        mask = np.isin(volume.values, keys)
        found, seconds = [], []
        for handles in (Handles(0), AS_THEY_ARE):
            began = time.process_time()
            found.append(label_surfaces(mask, volume.affine, smallest=SMALLEST, handles=handles)[0])
            seconds.append(time.process_time() - began)
        for made, as_is in zip(*found, strict=True):
            voxels = round(made.volume / abs(np.linalg.det(volume.affine[:3, :3])))
            print_row(
                COLUMNS,
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


if __name__ == "__main__":
    main()
