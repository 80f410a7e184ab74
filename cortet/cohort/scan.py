"""Read the hemispheres of a data release, with their ages, as rows of a cohort sheet."""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from cortet.cohort.ages import ages_at_scan
from cortet.cohort.sheet import HEMISPHERES, WHITE, Case, filled_in
from cortet.config import Scan
from cortet.errors import InputError


def scan(directory: Path, patterns: Scan | None = None, say: Callable[[str], object] = lambda _: None) -> list[Case]:
    """The hemispheres of a dHCP-like release, sorted by name.

    A case whose age is in no table has none. `say` is called with remarks on where ages come from and what is not read.

    Raises
    ------
    InputError : no surface matches, or a table cannot be read
    """
    patterns = patterns or Scan()
    found: dict[tuple[str, str | None, str | None], Path] = {}
    folders: dict[str, str] = {}
    for pattern in patterns.surfaces:
        for path, values in _matches(directory, pattern):
            hemi = values.get("hemi")
            if hemi is None or hemi.lower() in HEMISPHERES:
                participant = _label(values["participant"], folders, directory, say)
                key = (participant, values.get("session"), hemi and HEMISPHERES[hemi.lower()])
                found.setdefault(key, path)
    if not found:
        raise InputError(
            "no surfaces found",
            file=directory,
            remedy="check the folder, or set cohort.scan.surfaces; looked for " + ", ".join(patterns.surfaces),
        )
    sessions = list(dict.fromkeys((participant, session) for participant, session, _ in found))
    tables = {key: _age_tables(directory, *key, patterns) for key in sessions}
    named = "age_columns" in patterns.model_fields_set
    ages, told = ages_at_scan(sessions, tables, patterns.age_columns, named=named)
    for sentence in told:
        say(sentence)
    cases = []
    for (participant, session, hemi), path in sorted(found.items(), key=lambda item: [part or "" for part in item[0]]):
        surface, inner = _around(path) if patterns.pial else (path, {})
        sphere = _beside(path, patterns.spheres)
        fields = {name: file for name, ends in patterns.fields.items() if (file := _beside(path, ends))}
        volumes = _volumes_of(directory, {"participant": participant, "session": session, "hemi": hemi}, patterns)
        age = ages.get((participant, session))
        cases.append(
            Case(participant, session, hemi, age, surface, inner=inner, sphere=sphere, fields=fields, volumes=volumes)
        )
    return cases


def _age_tables(directory: Path, participant: str, session: str | None, patterns: Scan) -> list[tuple[str, Path]]:
    """Name and file of the tables that may hold the age of a session; the first tables count most."""
    labels = {"participant": participant, "session": session}
    return [(name, directory / filled_in(name, labels)) for name in (patterns.sessions, patterns.participants)]


def _label(name: str, folders: dict[str, str], directory: Path, say: Callable[[str], object]) -> str:
    """A participant's label, only letters and digits as BIDS requires; `folders` holds label -> name of the folder."""
    label = re.sub("[^A-Za-z0-9]", "", name)
    if folders.setdefault(label, name) != name:
        raise InputError(
            f"{folders[label]} and {name} would both be sub-{label}",
            file=directory,
            remedy="rename one: labels of BIDS have letters and digits alone",
        )
    if label != name:
        say(f"{name} is called sub-{label}")
    return label


def _beside(path: Path, endings: Sequence[str]) -> Path | None:
    """The file beside a surface, such as its sphere: the first that exists, by these ends of names."""
    begin = re.sub(r"[A-Za-z]+(\.surf\.gii)?$", "", path.name)
    for ending in endings:
        if found := sorted(path.parent.glob(glob.escape(begin) + ending)):
            return found[0]
    return None


def _volumes_of(directory: Path, labels: dict[str, str | None], patterns: Scan) -> dict[str, str]:
    """The volumes of a case: of each name the first file that exists."""
    known = {name: value for name, value in labels.items() if value is not None}
    found = {}
    for name, several in patterns.volumes.items():
        usable = [pattern for pattern in several if set(re.findall(r"\{([^{}]*)\}", pattern)) <= known.keys()]
        files = [directory / filled_in(pattern, known) for pattern in usable]
        if existing := [file for file in files if file.is_file()]:
            found[name] = str(existing[0])
    return found


def _around(path: Path) -> tuple[Path, dict[str, Path]]:
    """The pial surface beside a white surface, with the white one as inner surface; else the white surface alone."""
    pial = path.with_name(re.sub(r"(wm|white)(\.surf\.gii)?$", r"pial\2", path.name))
    return (pial, {WHITE: path}) if pial != path and pial.is_file() else (path, {})


def _matches(directory: Path, pattern: str) -> Iterator[tuple[Path, dict[str, str]]]:
    """Files below `directory` that fit a pattern, with the values of its placeholders."""
    if "{participant}" not in pattern or not pattern.strip() or Path(pattern).is_absolute() or "\0" in pattern:
        raise InputError(
            f"cohort.scan.surfaces: {pattern!r} finds nothing",
            remedy="give a pattern below the folder with the placeholder {participant}",
        )
    parts = re.split(r"\{(participant|session|hemi)\}", pattern)
    expression, seen = "", set[str]()
    for text, name in zip(parts[::2], [*parts[1::2], ""], strict=True):
        anyhow = name == "participant" and pattern.startswith("{participant}/")
        form = r"(?!sub-|fsaverage)[A-Za-z0-9][A-Za-z0-9_.-]*" if anyhow else "[A-Za-z0-9]+"
        label = f"(?P={name})" if name in seen else f"(?P<{name}>{form})"
        expression += re.escape(text) + (label if name else "")
        seen.add(name)
    for path in sorted(directory.glob("*".join(parts[::2]))):
        if match := re.fullmatch(expression, path.relative_to(directory).as_posix()):
            yield path, match.groupdict()
