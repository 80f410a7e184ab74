"""One run at a time writes to an output folder."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from cortet.cohort.app import require_plain_python
from cortet.cohort.bids import require_own_output
from cortet.cohort.lock import NAME, hold, is_held_by_parent, require_free
from cortet.config import load
from cortet.errors import InputError

HOLD = """
import subprocess, sys, time
from pathlib import Path
from cortet.cohort.lock import hold
file = hold(Path(sys.argv[1]))
child = subprocess.Popen(["sleep", "60"], stdout=subprocess.DEVNULL)
print(child.pid, flush=True)
time.sleep(60)
"""


def holder(folder: Path) -> tuple[subprocess.Popen[str], int]:
    """A process that has the lock of a folder, and the number of its child."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, folder], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


def test_a_second_run_is_told_who_is_first_and_kill_9_leaves_nothing_to_remove(tmp_path):
    folder = tmp_path / "new" / "out"
    first, child = holder(folder)
    owner = f"another run is writing to this folder: process {first.pid} on .*, started in {Path.cwd()}"
    with pytest.raises(InputError, match=owner):
        hold(folder)
    with pytest.raises(InputError, match=owner):
        require_free(folder)
    first.kill()
    first.wait()
    require_free(folder)
    with hold(folder):  # though a child of the process that was killed lives on
        assert str(os.getpid()) in (folder / NAME).read_text()
    os.kill(child, signal.SIGKILL)


def test_asking_whether_a_folder_is_free_writes_nothing_and_the_text_of_a_lock_counts_for_nothing(tmp_path):
    require_free(tmp_path / "new")
    require_free(tmp_path)
    assert not list(tmp_path.iterdir())
    text = f"process {os.getppid()} on {socket.gethostname()}, started in /somewhere"
    (tmp_path / NAME).write_text(text)
    assert not is_held_by_parent(tmp_path)
    require_free(tmp_path)
    assert (tmp_path / NAME).read_text() == text


def test_an_output_folder_with_braces_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(InputError, match=r"has braces in its name, which Snakemake reads as wildcards"):
        require_own_output(tmp_path / "out{x}", tmp_path / "bids")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="output = 'out{x}': braces in the name of the output folder"):
        load({"output": "out{x}"})


@pytest.mark.parametrize("folder", ["my env", "env (1)", "it's", 'so "named"', "a$b"])
def test_a_python_that_snakemake_cannot_call_is_refused(folder):
    """Snakemake issue 2645."""
    require_plain_python("/home/josé/env-1.2/bin/python")
    with pytest.raises(InputError, match="Snakemake cannot run jobs with a Python whose path has"):
        require_plain_python(f"/home/{folder}/bin/python")
