"""A cohort: a folder of surfaces becomes a sheet, and the sheet a plan of the whole workflow."""

from pathlib import Path

import pandas as pd

from cortet.cli import main
from cortet.formats.gifti import write_surface
from cortet.phantoms import phantom

for name, age in (("01", 24), ("02", 28)):
    folder = Path(f"dhcp/sub-{name}/anat")
    folder.mkdir(parents=True, exist_ok=True)
    write_surface(phantom(age, subdivisions=3), folder / f"sub-{name}_hemi-L_white.surf.gii")
Path("dhcp/participants.tsv").write_text("participant_id\tscan_age\nsub-01\t24\nsub-02\t28\n")
main(["cohort", "scan", "dhcp", "-o", "cohort.tsv", "--force"])
print(pd.read_csv("cohort.tsv", sep="\t")[["participant_id", "hemi", "scan_age", "surface"]].to_string(index=False))
# then: snakemake --cores 2 --config cohort='{sheet: cohort.tsv}'

assert len(pd.read_csv("cohort.tsv", sep="\t")) == 2
