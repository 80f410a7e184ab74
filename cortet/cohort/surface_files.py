"""Errors of the surfaces that a cohort sheet names; jobs that read them load nothing else of the cohort."""

from __future__ import annotations

from pathlib import Path

from cortet.errors import InputError
from cortet.formats.gifti import hemisphere_of
from cortet.formats.untrusted import ELSEWHERE, content_is_elsewhere


def missing_surface(source: object, *, column: str) -> InputError:
    """The error for a surface of the sheet that is missing."""
    if content_is_elsewhere(str(source)):
        return InputError(ELSEWHERE, file=source, remedy=f"datalad get {source}")
    return InputError("no such file", file=source, remedy=f"mend the column {column} of the cohort sheet")


def require_hemisphere(path: str | Path, hemi: str | None) -> None:
    """Raise InputError if the file of a surface or sphere states another hemisphere than its row."""
    named = hemisphere_of(path)
    if hemi and named and named != hemi:
        raise InputError(
            f"is of hemisphere {named}, as its AnatomicalStructurePrimary says, but its row says {hemi}",
            file=path,
            remedy="mend the column hemi of the cohort sheet, or name the file of the other hemisphere",
        )
