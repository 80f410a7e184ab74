"""A receipt records the parameters with which a job made its files.

Snakemake remembers parameters in the folder where it was started. It does not know of an output folder that was moved,
or that a run from another folder wrote to, and it takes a file with an older time for an older file. Receipts lie in
the output folder, and parameters include the SHA-256 of the user's files. So a result is used again only if it was made
from the same content, with the same parameters, by the same versions of the code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cortet.errors import InputError, StageError
from cortet.formats.atomic import write_json
from cortet.formats.hashing import companions, input_sha256

#: folder of the receipts in the output folder
FOLDER = ".cortet"
#: parameters that say where a file is; whether a job runs again depends on the file's content, not on its path
_LOCATIONS = frozenset({"source", "sphere_file", "space", "paths", "files", "given", "cohort", "log"})


def receipt_path(output: Path, log: Path) -> Path:
    """The receipt of the job that writes to `log`, a file below `output`/logs."""
    return output / FOLDER / log.relative_to(output / "logs").with_suffix(".json")


def fingerprint(parameters: Mapping[str, Any]) -> str:
    """SHA-256 of the parameters of a job, except for paths of files."""
    return hashlib.sha256(json.dumps(_essential(parameters), sort_keys=True, default=str).encode()).hexdigest()


def write_receipt(path: Path, parameters: Mapping[str, Any]) -> None:
    """Record that a job with these parameters is done."""
    write_json({"parameters_sha256": fingerprint(parameters)}, path)


def is_current(path: Path, parameters: Mapping[str, Any]) -> bool:
    """Whether a receipt says that its job was done with these parameters; false if there is no receipt."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and record.get("parameters_sha256") == fingerprint(parameters)


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
