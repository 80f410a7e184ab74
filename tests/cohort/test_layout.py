"""Names of files: BIDS-derivative, one for each thing, and none that two jobs share."""

from __future__ import annotations

from pathlib import Path

from cortet.cohort.layout import Layout, file_of, filled
from cortet.cohort.sheet import Case

LAYOUT = Layout("out")
CASE = Case("01", "a", "L", 24.0, Path("x.surf.gii"))
JOB = {"folder": "sub-01/ses-a", "case": "sub-01_ses-a_hemi-L", "res": "600", "mesher": "lattice"}


def test_a_mesh_is_named_by_cell_size_mesher_setting_and_stage():
    here = "out/sub-01/ses-a/mesh/sub-01_ses-a_hemi-L_res-600um"
    assert filled(LAYOUT.mesh("Solver"), JOB) == f"{here}_desc-latticeSolver_tetmesh.vtu"
    assert filled(LAYOUT.mesh("Cleaned"), JOB | {"setting": "Cgal"}) == f"{here}_desc-latticeCgalCleaned_tetmesh.vtu"
    assert filled(LAYOUT.mesh("Generated"), JOB | {"setting": "Cgal"}) == f"{here}_desc-latticeGenerated_tetmesh.vtu"
    assert file_of(LAYOUT.certificate, CASE, 600, "lattice") == f"{here}_desc-latticeSolver_certificate.json"
