"""A receipt records with what parameters a job made its files.

Snakemake remembers parameters in the folder where it was started. It knows nothing of an output folder that was moved,
or that another folder's run wrote to, and it takes a file with an older time for an older file. Receipts lie in the
output folder, and parameters include the SHA-256 of the user's files. So a result is used again only if it was made
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
from cortet.formats.hashing import sha256

#: folder of the receipts in the output folder
FOLDER = ".cortet"
#: parameters that say where a file lies. The file's content decides whether a job runs again, not its place.
_LOCATIONS = frozenset({"source", "sphere_file", "space", "paths", "files", "given", "cohort", "log"})


def receipt_path(output: Path, log: Path) -> Path:
    """The receipt of the job that writes to `log`, a file below `output`/logs."""
    return output / FOLDER / log.relative_to(output / "logs").with_suffix(".json")


def fingerprint(parameters: Mapping[str, Any]) -> str:
    """SHA-256 of the parameters of a job, those that say where files lie left out."""
    return hashlib.sha256(json.dumps(_essential(parameters), sort_keys=True, default=str).encode()).hexdigest()


def write_receipt(path: Path, parameters: Mapping[str, Any]) -> None:
    """Record that a job with these parameters is done."""
    write_json({"parameters_sha256": fingerprint(parameters)}, path)


def is_current(path: Path, parameters: Mapping[str, Any]) -> bool:
    """Whether a receipt says that its job was done with these parameters; false where there is none."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and record.get("parameters_sha256") == fingerprint(parameters)


def content(paths: Mapping[str, str | Path]) -> dict[str, str | None]:
    """SHA-256 of each file; None of one that cannot be read, of which the job that needs it will complain.

    A file is read once per process, unless its size, its times or its place on the disk have changed since.
    """
    return {name: _hash(Path(path)) for name, path in paths.items()}


def require_unchanged(paths: Mapping[str, str | Path], planned: Mapping[str, str | None]) -> None:
    """Raise StageError where a file is no longer the one that the run was planned with.

    Parameters
    ----------
    paths : files that a job has read, by name
    planned : of `content`, when the run was planned
    """
    for name, path in paths.items():
        if planned.get(name) != _hash(Path(path)):
            raise StageError("has changed since this run was planned", file=path, remedy="start the run again")


def require_same_input(file: str | Path, report: Mapping[str, Any], wanted: Mapping[str, str | None]) -> None:
    """Raise StageError where a stage worked from other files than a mesh is certified for.

    Parameters
    ----------
    file : of the stage's report
    report : what it holds
    wanted : `content` of the files of the case; a report on one of its surfaces names that surface's only
    """
    found = report.get("input_sha256")
    if found is None or not found.items() <= wanted.items():
        raise StageError(
            "is about another version of the input than the one that is there now",
            file=file,
            remedy="start the run again",
        )


def _essential(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _essential(one) for key, one in value.items() if key not in _LOCATIONS}
    return [_essential(one) for one in value] if isinstance(value, (list, tuple)) else value


def _hash(path: Path) -> str | None:
    try:
        stat = path.stat()
        return _hash_of(path, (stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns))
    except (OSError, InputError):
        return None


@cache
def _hash_of(path: Path, _state: tuple[int, ...]) -> str:
    return sha256(path)
