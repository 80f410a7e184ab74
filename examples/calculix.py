"""A growing cortex in CalculiX: export, job, run, result."""

import shutil
import subprocess
from pathlib import Path

import cortet
from cortet.cli import main
from cortet.phantoms import phantom

made = cortet.mesh(phantom(22, subdivisions=4), cell_size=3.5, ga=22, progress=False)
made.save("brain.inp", force=True)
main(["job", "brain.inp", "-o", "calculix-job", "--growth", "0.02", "--force"])
assert "*EXPANSION" in Path("calculix-job/job.inp").read_text()
if shutil.which("ccx"):
    subprocess.run(["ccx", "job"], cwd="calculix-job", check=True, capture_output=True)
    print("CalculiX wrote", *sorted(path.name for path in Path("calculix-job").glob("job.*")))
    assert "STRESS" in Path("calculix-job/job.frd").read_text(errors="replace")
