"""Runs Snakemake as often as it is asked to, each time in a fork of one process that has loaded it.

Loading takes most of the time of a dry run. Nothing of the project is loaded: a run may be one of another checkout.
Its jobs are forks of a process that has loaded libraries (`loaded_jobs`).
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any


def run(arguments: list[str], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """What `python -m snakemake ARGUMENTS` does in a folder and an environment."""
    with tempfile.TemporaryDirectory() as aside:
        printed = [str(Path(aside) / name) for name in ("stdout", "stderr")]
        of_process = {"folder": str(folder), "environment": environment, "printed": printed}
        server = _server()
        assert server.stdin and server.stdout
        server.stdin.write(f"{json.dumps([arguments, of_process])}\n")
        server.stdin.flush()
        status = int(server.stdout.readline())
        return subprocess.CompletedProcess(arguments, status, *(Path(path).read_text() for path in printed))


@cache
def _server() -> subprocess.Popen[str]:
    """The process that has Snakemake loaded; it ends with the one that runs tests."""
    command = [sys.executable, "-P", __file__]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)  # which closes its input
    return server


def _serve(jobs: Any, address: str) -> None:
    import snakemake.cli
    from snakemake.script import PythonScript

    def execute(script: Any, name: str, edit: bool = False) -> None:
        # the second is for Numba, which is loaded before the job can say it
        environment = os.environ | dict.fromkeys(["OMP_NUM_THREADS", "NUMBA_NUM_THREADS"], str(script.threads))
        if status := jobs.run(name, address, environment, script.bench_record):
            raise subprocess.CalledProcessError(status, name)

    PythonScript.execute_script = execute
    for line in sys.stdin:
        if not (process := os.fork()):
            arguments, of_process = json.loads(line)
            jobs.become(path=[of_process["folder"]], **of_process)
            sys.argv = ["snakemake", *arguments]
            snakemake.cli.main(arguments)
        sys.stdout.write(f"{os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    import loaded_jobs

    del sys.path[0]
    with loaded_jobs.served() as served_at:
        _serve(loaded_jobs, served_at)
