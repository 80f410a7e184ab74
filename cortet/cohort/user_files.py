"""The user's files of a run, of which the content decides whether a job runs again, not the name or the time.

Jobs that read these files load nothing else of the cohort.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from cortet.errors import InputError, StageError
from cortet.formats.hashing import companions, input_sha256
from cortet.formats.untrusted import content_is_elsewhere, elsewhere


def missing_surface(source: object, *, column: str) -> InputError:
    """The error for a surface that is missing; `column` of the sheet names it."""
    if content_is_elsewhere(str(source)):
        return elsewhere(str(source))
    what = "is not a file" if Path(str(source)).exists() else "no such file"
    return InputError(what, file=source, remedy=f"correct the column {column} of the cohort sheet")


def require_hemisphere(path: str | Path, hemi: str | None) -> None:
    """Raise InputError if the file of a surface or sphere states another hemisphere than its row."""
    from cortet.formats.gifti import hemisphere_of  # loads what a plan does without

    named = hemisphere_of(path)
    if hemi and named and named != hemi:
        raise InputError(
            f"is hemisphere {named} according to its AnatomicalStructurePrimary, but hemisphere {hemi} in the cohort "
            "sheet",
            file=path,
            remedy="correct the column hemi of the cohort sheet, or name the file of the other hemisphere",
        )


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
            raise StageError("has changed since this run was planned", file=path, remedy="restart the run")


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
