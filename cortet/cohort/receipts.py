"""A receipt says with which parameters the files of a job were made, and with which they are asked for now.

Snakemake remembers parameters in the folder where it was started. It does not know of an output folder that was moved,
or that a run from another folder wrote to. Receipts lie in the output folder, and parameters include the SHA-256 of the
user's files. A receipt is an input of its job. While a run is planned, the receipt of a job that must run gets a
time that is later than that of any file, and any other one an old time.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cortet.errors import InputError, StageError
from cortet.formats.atomic import write_json
from cortet.formats.hashing import companions, input_sha256

#: folder of the receipts in the output folder
FOLDER = ".cortet"
_NAME = "receipt.json"
#: what a run leaves of itself in that folder
RUN = "run.json"
#: parameters that say where a file is; whether a job runs again depends on the file's content, not on its path
_LOCATIONS = frozenset({"source", "sphere_file", "space", "paths", "files", "given", "cohort", "log"})
#: time of a receipt whose files were made with what is asked for, seconds since the epoch
_LONG_AGO = 946_684_800
#: time of any other receipt, later than that of any file, even of one from a machine whose clock was wrong: 2100
_LATE = 4_102_444_800
#: stands in a receipt for files that must be made again, whatever they were made with
_AGAIN = "again"


def receipt_path(output: Path, log: Path) -> Path:
    """The receipt of the job that writes to `log`, a file below `output`/logs.

    Each has a folder of its own: Snakemake lists a folder once, and would not see a receipt that is written later.
    """
    return output / FOLDER / log.relative_to(output / "logs").with_suffix("") / _NAME


def fingerprint(parameters: Mapping[str, Any]) -> str:
    """SHA-256 of the parameters of a job, except for paths of files."""
    return hashlib.sha256(json.dumps(_essential(parameters), sort_keys=True, default=str).encode()).hexdigest()


def ask(
    path: Path, rule: str, wildcards: Mapping[str, str], parameters: Mapping[str, Any], *, again: bool = False
) -> str:
    """Write what is asked of a job into its receipt; the fingerprint of it.

    Parameters
    ----------
    again : whether the job must run in any case

    Raises
    ------
    InputError : the receipt cannot be written
    """
    old = read(path)
    made = _AGAIN if again else old.get("made")
    new = {"rule": rule, "wildcards": dict(wildcards), "asked": fingerprint(parameters), "made": made}
    if not is_current(new):  # Snakemake compares content, too, so that is new as well
        write_json({**new, "planned": time.time_ns()}, path)
        os.utime(path, (_LATE, _LATE))
        return str(new["asked"])
    if new != old:
        write_json(new, path)
    if path.stat().st_mtime != _LONG_AGO:
        os.utime(path, (_LONG_AGO, _LONG_AGO))
    return str(new["asked"])


def begin(path: Path) -> str:
    """Record that a job begins, so that its files are not yet made; the fingerprint to `finish` it with."""
    record = read(path)
    write_json({**record, "made": None}, path)
    return str(record["asked"])


def finish(path: Path, asked: str) -> None:
    """Record that a job has made its files."""
    record = {key: value for key, value in read(path).items() if key != "planned"}
    write_json({**record, "made": asked}, path)
    os.utime(path, (_LONG_AGO, _LONG_AGO))


def forget(path: Path) -> None:
    """Let a job run again the next time that its files are asked for."""
    if record := read(path):
        write_json({**record, "made": _AGAIN}, path)


def is_current(record: Mapping[str, Any]) -> bool:
    """Whether the files of a job were made with what is asked for."""
    return bool(record) and record["made"] == record["asked"]


def read(path: Path) -> dict[str, Any]:
    """Content of a receipt: `rule`, `wildcards`, `asked` and `made`; empty if there is none, or a damaged one."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) and {"rule", "wildcards", "asked", "made"} <= set(record) else {}


def run_record(output: Path) -> dict[str, Any]:
    """What the last run left of itself in an output folder (`report.over_all.remember_run`); empty if nothing."""
    try:
        record = json.loads((output / FOLDER / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def unfinished(output: Path) -> Iterator[tuple[dict[str, Any], Path]]:
    """Receipts of the jobs that have begun and not succeeded, and the logs of these jobs."""
    for path in sorted((output / FOLDER).rglob(_NAME)):
        log = output / "logs" / f"{path.parent.relative_to(output / FOLDER)}.log"
        record = read(path)
        if record and record["made"] is None and log.exists():
            yield record, log


def content(paths: Mapping[str, str | Path]) -> dict[str, str | None]:
    """SHA-256 of each file; None if a file cannot be read, which the job that needs it will report.

    A file is read once per process, unless its size, times or inode have changed since.
    """
    return {name: _hash(Path(path)) for name, path in paths.items()}


def require_unchanged(paths: Mapping[str, str | Path], planned: Mapping[str, str | None]) -> None:
    """Raise StageError if a file has changed since the run was planned.

    Parameters
    ----------
    paths : files that a job has read, by name
    planned : result of `content` when the run was planned
    """
    for name, path in paths.items():
        if planned.get(name) != _hash(Path(path)):
            raise StageError("has changed since this run was planned", file=path, remedy="start the run again")


def require_same_input(file: str | Path, report: Mapping[str, Any], wanted: Mapping[str, str | None]) -> None:
    """Raise StageError if a stage used other files than those for which a mesh is certified.

    Parameters
    ----------
    file : file of the stage's report
    report : content of that file
    wanted : `content` of the files of the case; a report on one of its surfaces names that surface's only
    """
    found = report.get("input_sha256")
    if found is None or not found.items() <= wanted.items():
        raise StageError(
            "is about another version of the input than the present one",
            file=file,
            remedy="start the run again",
        )


def _essential(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _essential(one) for key, one in value.items() if key not in _LOCATIONS}
    return [_essential(one) for one in value] if isinstance(value, (list, tuple)) else value


def _hash(path: Path) -> str | None:
    try:
        state = _state(path)
        return _hash_of(path, state, *map(_state, _companions(path, state)))
    except (OSError, InputError):
        return None


def _state(path: Path) -> tuple[int, ...]:
    stat = path.stat()
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns


@cache
def _companions(path: Path, _state: tuple[int, ...]) -> list[Path]:
    return companions(path)


@cache
def _hash_of(path: Path, *_states: tuple[int, ...]) -> str:
    return input_sha256(path)
