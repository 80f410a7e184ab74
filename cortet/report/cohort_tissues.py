"""One table of the tissue in all meshes of a cohort, by the volumes of its cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.formats.tables import Column, names
from cortet.formats.tsv import read_tsv
from cortet.report.table_files import Table, write
from cortet.solver_files.volumes import TISSUE_COLUMNS

VERSION: int = 1

#: which mesh a row is about
_MESH = (
    Column("case", "Name of the case; its files begin with it", heading="Case"),
    Column("scan_age", "Gestational age at scan", "weeks", heading="Age (weeks)", form="g"),
    Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
    Column("mesher", "Mesher of stage S1"),
)
#: columns of `cohort_tissues.tsv`
TISSUES = Table("Tissue in every mesh, by the labels of its volumes", (*_MESH, *TISSUE_COLUMNS), group=("case",))


def write_tissues(
    files: Sequence[str | Path], meshes: Sequence[Mapping[str, Any]], outputs: Iterable[str | Path]
) -> None:
    """Write `TISSUES` in the forms of `table_files.write`.

    Parameters
    ----------
    files : the `volumes.tsv` of each mesh
    meshes : its case, scan_age, cell_size_mm and mesher, in the order of the files
    """
    tables = [read_tsv(Path(file)).assign(**mesh) for file, mesh in zip(files, meshes, strict=True)]
    columns = names(TISSUES.columns)
    rows = pd.concat(tables)[columns] if tables else pd.DataFrame(columns=columns)
    write(TISSUES, rows.reset_index(drop=True), *outputs)
