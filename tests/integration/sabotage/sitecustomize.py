"""Every Python process of a run loads this module when the folder it is in is on PYTHONPATH.

`SABOTAGE` holds a folder and, by what is done, the names of rules with a part of the names of their first outputs:

    kill    kill -9 of the job when its last output is about to get its name, the first time
    wait    the same moment, until the file `go` is in the folder
    hang    the same moment, for good, inside C code that keeps the interpreter
    fill    the disk of the outputs is filled when the job opens its first output for writing
    late    the outputs of the job are not to be seen for 1 s after its end, as over a network

What was done leaves a file `<done>-<rule>-<first output>` in the folder, which says whether the last output was there.
"""

import atexit
import contextlib
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

PLAN = json.loads(os.environ.get("SABOTAGE", "{}"))


def _at_an_open(event: str, arguments: tuple[object, ...]) -> None:
    job = getattr(sys.modules.get("__main__"), "snakemake", None) if event == "open" else None
    if job is None or not hasattr(job, "rule") or not str(arguments[0]).endswith(Path(job.output[0]).name):
        return
    if any(rule == job.rule and part in job.output[0] for rule, part in PLAN.get("fill", [])):
        with Path(job.output[0]).with_name("filler").open("wb") as file, contextlib.suppress(OSError):
            while file.write(bytes(4096)):
                file.flush()


def _at_a_rename(event: str, arguments: tuple[object, ...]) -> None:
    job = getattr(sys.modules.get("__main__"), "snakemake", None) if event == "os.rename" else None
    if job is None or not hasattr(job, "rule"):
        return
    outputs = [Path(output).absolute() for output in job.output]
    if Path(os.fsdecode(arguments[1])).absolute() != outputs[-1]:
        return
    for what in ("kill", "wait", "hang", "late"):
        for rule, part in PLAN.get(what, []):
            mark = Path(PLAN["folder"]) / f"{what}-{job.rule}-{outputs[0].name}"
            if rule in ("*", job.rule) and part in outputs[0].name and not mark.exists():
                mark.write_text("there" if outputs[-1].exists() else "not there")
                _do(what, outputs)


def _do(what: str, outputs: list[Path]) -> None:
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    elif what == "hang":
        ctypes.PyDLL(None).sleep(3600)
    elif what == "late":
        atexit.register(_hide, outputs)
    else:
        while not (Path(PLAN["folder"]) / "go").exists():
            time.sleep(0.1)


def _hide(outputs: list[Path]) -> None:
    for output in outputs:
        hidden = Path(PLAN["folder"]) / output.name
        shutil.move(output, hidden)
        subprocess.Popen(["sh", "-c", 'sleep 1; mv "$0" "$1"', hidden, output], start_new_session=True)


if PLAN:
    sys.addaudithook(_at_a_rename)
    sys.addaudithook(_at_an_open)
