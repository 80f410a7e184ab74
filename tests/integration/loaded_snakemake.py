"""Runs Snakemake as often as it is asked to, each time in a fork of one process that has loaded it.

Loading takes most of the time of a dry run. Nothing of the project is loaded: a run may be one of another checkout.
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


def run(arguments: list[str], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """What `python -m snakemake ARGUMENTS` does in a folder and an environment."""
    with tempfile.TemporaryDirectory() as aside:
        printed = [Path(aside) / name for name in ("stdout", "stderr")]
        asked = {"folder": str(folder), "arguments": arguments, "environment": environment}
        asked |= {"printed": [str(path) for path in printed]}
        server = _server()
        assert server.stdin and server.stdout
        server.stdin.write(f"{json.dumps(asked)}\n")
        server.stdin.flush()
        status = int(server.stdout.readline())
        return subprocess.CompletedProcess(arguments, status, *(path.read_text() for path in printed))


@cache
def _server() -> subprocess.Popen[str]:
    """The process that has Snakemake loaded; it ends with the one that runs tests."""
    command = [sys.executable, "-P", __file__]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)  # which closes its input
    return server


def _serve() -> None:
    import snakemake.cli

    for line in sys.stdin:
        if not (process := os.fork()):
            _become(**json.loads(line))
            snakemake.cli.main(sys.argv[1:])
        sys.stdout.write(f"{os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])}\n")
        sys.stdout.flush()


def _become(folder: str, arguments: list[str], environment: dict[str, str], printed: list[str]) -> None:
    """Be a process that was started with these arguments."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for descriptor, path in enumerate([os.devnull, *printed]):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND), descriptor)
    sys.path[:0] = [folder, *filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))]
    sys.argv = ["snakemake", *arguments]


if __name__ == "__main__":
    _serve()
