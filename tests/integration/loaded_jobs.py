"""Runs the Python scripts of jobs, each in a fork of one process that has loaded the libraries they use.

Loading takes most of the time of a tiny job. Nothing of the project is loaded: a job may be one of another checkout.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import selectors
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

LIBRARIES = [
    "snakemake.iocontainers",
    "snakemake.logging",
    "numpy",
    "pandas",
    "nibabel",
    "numba",
    "numba.core.registry",
    "numba.np.ufunc.parallel",
    "yaml",
    "uuid",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "scipy.sparse.linalg",
    "scipy.spatial",
    "matplotlib.axes",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
    "matplotlib.figure",
    "matplotlib.font_manager",
    "matplotlib.image",
    "pyvista",
    "pyvista.plotting",
]


@contextmanager
def served() -> Iterator[str]:
    """Have a process beside this one that jobs are forks of; its address, which is no file."""
    address = f"\0jobs-of-{os.getpid()}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen(64)
        given = listener.fileno()
        # threads of BLAS would be started by every fork; results do not depend on their number
        alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        server = subprocess.Popen(
            [sys.executable, "-P", __file__, str(given)], stdin=subprocess.PIPE, pass_fds=[given], env=alone
        )
    with server:  # its input is closed in the end, and it is waited for
        yield address


def run(script: str, address: str, environment: dict[str, str], bench_record: Any) -> int:
    """Exit status of `python SCRIPT` in the working folder of this process, which is Snakemake."""
    from snakemake.benchmark import benchmarked

    printed = [f"/proc/{os.getpid()}/fd/{descriptor}" for descriptor in (1, 2)]
    asked = {"script": script, "folder": str(Path.cwd()), "environment": environment, "printed": printed}
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(address)
        with connection.makefile("rw") as line:
            line.write(f"{json.dumps(asked)}\n")
            line.flush()
            process = int(line.readline())
            with benchmarked(process if bench_record else False, bench_record):
                return int(line.readline())


def _asked(listener: socket.socket) -> dict[str, Any]:
    """What to be; returns in a fork of this process for each job, and never in this process itself."""
    ready = selectors.DefaultSelector()
    ready.register(listener, selectors.EVENT_READ)
    ready.register(sys.stdin, selectors.EVENT_READ)
    while True:
        if any(key.fileobj is sys.stdin for key, _ in ready.select()):
            sys.exit()  # the process that started this one ends
        connection, _ = listener.accept()
        if not os.fork():
            with connection.makefile("rw") as line:
                asked: dict[str, Any] = json.loads(line.readline())
                if not (job := os.fork()):
                    connection.close()
                    return asked
                print(job, file=line, flush=True)
                print(os.waitstatus_to_exitcode(os.waitpid(job, 0)[1]), file=line, flush=True)
            os._exit(0)
        connection.close()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


def become(folder: str, path: list[str], environment: dict[str, str], printed: list[str]) -> None:
    """Be a process that was started in a folder and an environment, and finds its first modules in a path."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for descriptor, file in enumerate([os.devnull, *printed]):
        os.dup2(os.open(file, os.O_RDWR | os.O_CREAT | os.O_APPEND), descriptor)
    sys.path[:0] = [*path, *filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))]


def _load() -> None:
    for library in LIBRARIES:
        importlib.import_module(library)
    from numba.core import registry

    registry.cpu_target.typing_context.refresh()
    registry.cpu_target.target_context.refresh()
    gc.freeze()  # a fork need not look for garbage in what was loaded, and so copies no memory for it


if __name__ == "__main__":
    _load()
    request = _asked(socket.socket(fileno=int(sys.argv[1])))
    script = request.pop("script")
    become(path=[str(Path(script).parent)], **request)
    parallel: Any = sys.modules["numba.np.ufunc.parallel"]  # Numba has counted its threads before it knew the job
    sys.modules["numba"].config.reload_config()
    parallel.NUM_THREADS = parallel.get_thread_count()
    with suppress(ImportError):  # as Python does at its start
        importlib.import_module("sitecustomize")
    main = sys.modules["__main__"] = ModuleType("__main__")
    main.__file__, sys.argv = script, [script]
    exec(compile(Path(script).read_bytes(), script, "exec", dont_inherit=True), main.__dict__)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    os._exit(0)  # without giving libraries up, which takes longer than most of these jobs
