"""What we start ends with us."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cortet.cohort.failures import failure_path

ROOT = Path(__file__).parents[2]


def is_running(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


def wait_until(condition) -> bool:
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return bool(condition())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends children with their parent")
def test_a_program_ends_with_the_process_that_called_it(tmp_path):
    pid = tmp_path / "pid"
    code = f"from cortet.formats import child; child.run(['sh', '-c', 'echo $$ > {pid}; exec sleep 300'])"
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as parent:
        assert wait_until(lambda: pid.exists() and pid.read_text().strip())
        sleeper = int(pid.read_text())
        assert is_running(sleeper)
        parent.kill()
    assert wait_until(lambda: not is_running(sleeper))


JOB = """
import os, sys, tempfile
from types import SimpleNamespace
sys.path.insert(0, "scripts")
from pathlib import Path
from _job import start

snakemake = SimpleNamespace(
    threads=1, log=[sys.argv[1]], rule="clean", wildcards={}, params={}, resources={}, output=[], input=[]
)
start(snakemake)
with open(sys.argv[2], "w") as file:
    file.write(tempfile.mkdtemp())
os.kill(os.getpid(), int(sys.argv[3])) if int(sys.argv[3]) else None
"""


@pytest.mark.parametrize("end", [0, signal.SIGTERM, signal.SIGKILL])
def test_temporary_files_of_a_job_go_with_it_or_with_the_next_attempt(end, tmp_path):
    told, log = tmp_path / "told", tmp_path / "job.log"

    def run(end: int) -> Path:
        environment = {**os.environ, "TMPDIR": str(tmp_path)}
        command = [sys.executable, "-c", JOB, str(log), str(told), str(int(end))]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == -end, done.stderr
        return Path(told.read_text()).parent

    folder = run(end)
    assert folder.parent == tmp_path and folder.name.startswith("cortet-job-")
    assert failure_path(log).exists() is folder.exists() is (end != 0)
    assert run(0) == folder and not folder.exists() and not failure_path(log).exists()
