"""Read the hemispheres of a data release, with their ages, as rows of a cohort sheet."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from cortet.cohort.ages import ages_at_scan
from cortet.cohort.bids import DESCRIPTION, is_own_output
from cortet.cohort.sheet import HEMISPHERES, WHITE, Case, is_file_name
from cortet.config import Scan
from cortet.errors import InputError, counted
from cortet.formats.ownership import json_of
from cortet.formats.untrusted import content_is_elsewhere, elsewhere, is_there

#: any entities of BIDS, such as `_ses-1_acq-T1w_hemi-L`
_ENTITIES = "(?:_[A-Za-z0-9]+-[A-Za-z0-9+.]+)*"
#: the space that a name states, and those that are the subject's own: the subject lies there as in the scanner
_SPACE = re.compile(r"_(space-([A-Za-z0-9+.]+))(?=_)")
_OWN_SPACES = {
    *("t1w", "t2w", "flair", "dwi", "bold", "anat", "orig"),
    *("native", "individual", "scanner", "fsnative", "fslr"),
}
#: between the session and the base in the name of a folder of FreeSurfer's longitudinal stream
_LONGITUDINAL = ".long."
#: example subject that FreeSurfer has in its folder of subjects
_EXAMPLE = "bert"
#: folder of a dataset that holds the results of pipelines, and folders whose parent is the dataset that theirs is from
_DERIVATIVES = "derivatives"
_WITHIN_A_DATASET = (_DERIVATIVES, "sourcedata")
#: most files that a remark names
_MOST_NAMES = 5
#: participant, session and hemisphere
_Key = tuple[str, str | None, str | None]
#: what names a white surface in `sub-1_hemi-L_wm.surf.gii`, `lh.white` or `1.L.white.native.surf.gii`
_WHITE = re.compile(r"(?<![A-Za-z0-9])(wm|white|smoothwm)(?=(\.[A-Za-z0-9_]+)*$)")


def scan(directory: Path, patterns: Scan | None = None, say: Callable[[str], object] = lambda _: None) -> list[Case]:
    """The hemispheres of a dHCP-like release, sorted by name.

    A raw dataset has those of the one pipeline with surfaces among its derivatives, and a derivative has the ages of
    the datasets that it is from. A case whose age is in no table has none. `say` is called with remarks on where ages
    come from and what is not read.
    """
    patterns = patterns or Scan()
    directory = _with_surfaces(directory, patterns, say)
    found = _surfaces(directory, patterns, say)
    datasets = _datasets_of(directory)
    sessions = list(dict.fromkeys((participant, session) for participant, session, _ in found))
    tables = {
        (participant, session): [
            (name, dataset / _filled(name, {"participant": participant, "session": session}))
            for dataset in datasets
            for name in (patterns.sessions, patterns.participants)  # the first tables count most
        ]
        for participant, session in sessions
    }
    ages, told = ages_at_scan(sessions, tables, patterns.age_columns)
    for sentence in told:
        say(sentence)
    cases = []
    for (participant, session, hemi), path in sorted(found.items(), key=lambda item: [part or "" for part in item[0]]):
        surface, inner = _around(path) if patterns.pial else (path, {})
        sphere = _beside(path, patterns.spheres)
        fields = {name: file for name, ends in patterns.fields.items() if (file := _beside(path, ends))}
        labels = {"participant": participant, "session": session, "hemi": hemi}
        volumes = _volumes_of(directory, labels, patterns, say)
        age = ages.get((participant, session))
        cases.append(
            Case(participant, session, hemi, age, surface, inner=inner, sphere=sphere, fields=fields, volumes=volumes)
        )
    _say_which(cases, say, pial=patterns.pial)
    return cases


def _with_surfaces(directory: Path, patterns: Scan, say: Callable[[str], object]) -> Path:
    """The folder with the surfaces of a dataset: itself or, without any, the only one of its derivatives that has some.

    Raises InputError if the surfaces of several pipelines are there.
    """
    around = directory if directory.absolute().name == _DERIVATIVES else directory / _DERIVATIVES
    if not around.is_dir() or _has_surfaces(directory, patterns):
        return directory
    folders = [folder for folder in around.iterdir() if folder.is_dir() and not is_own_output(folder)]
    own: dict[str, Path] = {}  # a link such as `latest` to a pipeline is none of its own
    for folder in sorted(folders, key=lambda folder: (folder.is_symlink(), folder)):
        own.setdefault(os.path.realpath(folder), folder)
    pipelines = [folder for folder in own.values() if _has_surfaces(folder, patterns)]
    if len(pipelines) > 1:
        what = f"{len(pipelines)} pipelines have surfaces: {', '.join(folder.name for folder in pipelines)}"
        raise InputError(what, file=around, remedy=f"choose one, and give its folder, such as {pipelines[0]}")
    if pipelines:
        say(f"surfaces are read from {pipelines[0]}")
    return pipelines[0] if pipelines else directory


def _has_surfaces(directory: Path, patterns: Scan) -> bool:
    return any(True for pattern in patterns.surfaces for _ in _matches(directory, pattern))


def _datasets_of(directory: Path) -> list[Path]:
    """A dataset, those that it is from, as its description names them, and those that it lies in.

    `file:` and relative addresses of the description lead to a folder; others, such as a DOI, do not.
    """
    about = json_of(directory / DESCRIPTION)
    links, named = about.get("DatasetLinks"), about.get("SourceDatasets")
    addresses = [*links.values()] if isinstance(links, dict) else []
    addresses += [one.get("URL") for one in named if isinstance(one, dict)] if isinstance(named, list) else []
    local = [re.fullmatch(r"(?:file:(?://[^/]*)?)?([^:]+)", str(address)) for address in addresses]
    folders = [directory / unquote(match[1]) for match in local if match and is_file_name(match[1])]
    folders += [folder.parent for folder in directory.absolute().parents if folder.name in _WITHIN_A_DATASET]
    datasets = {os.path.realpath(directory): directory}
    for folder in folders:
        if folder.is_dir():
            datasets.setdefault(os.path.realpath(folder), folder)
    return list(datasets.values())


def _surfaces(directory: Path, patterns: Scan, say: Callable[[str], object]) -> dict[_Key, Path]:
    """The surface of each hemisphere: of the first pattern that finds one, of several that with fewest entities.

    One in the space of a template is taken where there is no other and, of pairs, a white one without a pial one.
    What is not taken is said.
    """

    def rank(candidate: tuple[int, Path]) -> tuple[object, ...]:
        number, path = candidate
        no_pair = patterns.pial and not is_there(_pial_of(path))
        return bool(_template_of(path)), number, no_pair, path.name.count("_"), path

    def named(*paths: Path) -> str:
        names = [path.relative_to(directory).as_posix() for path in paths[:_MOST_NAMES]]
        return ", ".join(names + [f"and {len(paths) - _MOST_NAMES} more"] * (len(paths) > _MOST_NAMES))

    found = {
        key: sorted(candidates, key=rank) for key, candidates in _candidates(directory, patterns.surfaces, say).items()
    }
    examples = [key for key in found if key[0] == _EXAMPLE]
    if 0 < len(examples) < len(found):
        say(f"{_EXAMPLE} is left out: it is FreeSurfer's example subject")
        found = {key: candidates for key, candidates in found.items() if key not in examples}
    taken = {key: candidates[0][1] for key, candidates in found.items()}
    beside: list[Path] = []
    for (number, first), *others in found.values():
        alike = [path for other, path in others if other == number]
        beside += [path for other, path in others if other != number]
        if alike:
            words = f"{len(alike) + 1} surfaces of one hemisphere: {named(first, *alike)}"
            say(f"{words}; cortet uses the first (see cohort.scan.surfaces)")
    if beside:
        say(f"not used, because the hemisphere has another surface: {named(*beside)} (see cohort.scan.surfaces)")
    if placed := [path for path in taken.values() if _template_of(path)]:
        words = f"surfaces in template space ({_template_of(placed[0])}): {named(*placed)}"
        say(f"{words}; they do not have the subject's size and position")
    names = dict.fromkeys(_WHITE.sub("pial", pattern) for pattern in patterns.surfaces)
    pials = _candidates(directory, [name for name in names if name not in patterns.surfaces], lambda _: None)
    left = sorted(min(candidates)[1] for key, candidates in pials.items() if key not in taken)
    if taken and left:
        say(f"hemispheres left out because they have a pial surface but no white surface: {named(*left)}")
    if not taken:
        raise _none_found(directory, patterns, left)
    return taken


def _candidates(
    directory: Path, surfaces: Sequence[str], say: Callable[[str], object]
) -> dict[_Key, list[tuple[int, Path]]]:
    """The files of each participant, session and hemisphere that fit patterns, each with the number of its pattern."""
    found: dict[_Key, list[tuple[int, Path]]] = {}
    folders: dict[str, str] = {}
    # FreeSurfer's longitudinal stream: the base of a subject is an average over its sessions, and no session
    bases = sorted({path.name.partition(_LONGITUDINAL)[2] for path in directory.glob(f"*{_LONGITUDINAL}*")})
    bases = [name for name in bases if (directory / name).is_dir()]
    if bases:
        say(f"longitudinal bases are left out, since they average over sessions: {', '.join(bases[:_MOST_NAMES])}")
    for number, pattern in enumerate(surfaces):
        for path, values in _matches(directory, pattern):
            if path.relative_to(directory).parts[0] in bases:
                continue
            hemi = values.get("hemi")
            if hemi is None or hemi.lower() in HEMISPHERES:
                participant = _label(values["participant"], folders, directory, say)
                key = (participant, values.get("session"), hemi and HEMISPHERES[hemi.lower()])
                found.setdefault(key, []).append((number, path))
    return found


def _template_of(path: Path) -> str:
    """The entity of the space of a file, such as `space-MNI152`, unless it is the subject's own; empty without one."""
    space = _SPACE.search(path.name)
    return "" if space is None or space[2].lower() in _OWN_SPACES else space[1]


def _none_found(directory: Path, patterns: Scan, pials: Sequence[Path]) -> InputError:
    """The error for a folder without white surfaces, with what is there instead."""
    what = "no surfaces found"
    first, *others = patterns.surfaces or ["nothing"]
    more = f", and {len(others)} more patterns" if others else ""
    remedy = f"check the folder, or set cohort.scan.surfaces; cortet looked for {first}{more}"
    if _is_subject(directory, patterns):
        what = "is the folder of one subject"
        remedy = f"give the folder that holds all subjects: {directory.absolute().parent}"
    elif pials:
        what = f"no white surfaces found, only {counted(len(pials), 'pial surface')}, for example {pials[0]}"
        remedy = "add white surfaces; or name pial surfaces in cohort.scan.surfaces, to mesh in one region"
    return InputError(what, file=directory, remedy=remedy)


def _is_subject(directory: Path, patterns: Scan) -> bool:
    """Whether a folder is that of one subject: patterns fit its surfaces from the folder around it."""
    within = directory.absolute()
    found = (path for pattern in patterns.surfaces for path, _ in _matches(within.parent, pattern))
    return any(path.is_relative_to(within) for path in found)


def _say_which(cases: Sequence[Case], say: Callable[[str], object], *, pial: bool) -> None:
    """Say which surfaces are taken, white or pial, and which lie beside them."""
    white = [case for case in cases if not case.inner and _WHITE.search(Path(case.surface).name)]
    beside = [case for case in white if is_there(_pial_of(Path(case.surface)))]
    both = len(cases) - len(white) if pial else 0
    if both:
        say(f"cortet uses pial and white surfaces of {both} of {len(cases)} cases; their meshes have a region cortex")
    if white:
        words = (
            f"cortet uses only the white surface of {len(white)} of {len(cases)} cases; "
            "their meshes contain white matter without the cortex"
        )
        if beside:
            words += f"; {len(beside)} of them have a pial surface (--pial uses both)"
        elif pial:
            words += f"; there is no pial surface for {', '.join(case.name for case in white)}"
        say(words)
    if registered := sum(case.sphere is not None for case in cases):
        words = f"registered spheres: {registered}; cortet uses them to resample the surfaces onto the common mesh"
        say(f"{words} (resample.enabled: false keeps their vertices)")
    for case in cases:
        for path in (case.surface, *case.inner.values()):
            if content_is_elsewhere(path):
                say(str(elsewhere(path)))


def _label(name: str, folders: dict[str, str], directory: Path, say: Callable[[str], object]) -> str:
    """A participant's label, only letters and digits as BIDS requires; `folders` holds label -> name of the folder."""
    label = re.sub("[^A-Za-z0-9]", "", name)
    if (other := folders.setdefault(label.lower(), name)) != name:
        if other.lower() == name.lower():
            remedy = "rename one: some file systems ignore case"
            raise InputError(f"{other} and {name} differ only in upper and lower case", file=directory, remedy=remedy)
        remedy = "rename one: BIDS labels contain only letters and digits"
        raise InputError(f"{other} and {name} would both be sub-{label}", file=directory, remedy=remedy)
    if label != name:
        say(f"{name} becomes sub-{label}")
    return label


def _beside(path: Path, endings: Sequence[str]) -> Path | None:
    """The file beside a surface, such as its sphere: the first that exists, by these ends of names."""
    kind = _WHITE.search(path.name)
    begin = path.name[: kind.start()] if kind else re.sub(r"[A-Za-z]+(\.surf\.gii)?(\.gz)?$", "", path.name)
    for ending in endings:
        if found := sorted(path.parent.glob(glob.escape(begin) + ending)):
            return found[0]
    return None


def _volumes_of(
    directory: Path, labels: dict[str, str | None], patterns: Scan, say: Callable[[str], object]
) -> dict[str, str]:
    """The volumes of a case: of each name the first file that exists; one that is only a link is left out, and said."""
    known = {name: value for name, value in labels.items() if value is not None}
    found = {}
    for name, several in patterns.volumes.items():
        usable = [pattern for pattern in several if set(re.findall(r"\{([^{}]*)\}", pattern)) <= known.keys()]
        files = [directory / _filled(pattern, known) for pattern in usable]
        if existing := [file for file in files if file.is_file()]:
            found[name] = str(existing[0])
        elif away := [file for file in files if content_is_elsewhere(file)]:
            say(f"{elsewhere(away[0])}, so the volume {name} is left out")
    return found


def _filled(pattern: str, values: Mapping[str, Any]) -> str:
    """A pattern with its placeholders `{name}` filled in; nothing else in it has a meaning."""
    remedy = f"use {', '.join(f'{{{name}}}' for name in values)}"
    for name in re.findall(r"\{([^{}]*)\}", pattern):
        if name not in values:
            raise InputError(f"{pattern!r} contains the unknown placeholder {name!r}", remedy=remedy)
    filled = re.sub(r"\{([^{}]*)\}", lambda match: str(values[match[1]]), pattern)
    if not is_file_name(filled):
        raise InputError(f"{pattern!r} becomes {filled!r}, which cannot be a file name", remedy=remedy)
    return filled


def _around(path: Path) -> tuple[Path, dict[str, Path]]:
    """The pial surface beside a white surface, with the white one as inner surface; else the white surface alone.

    A pial surface that is a link counts, even if its content is elsewhere: the white one alone would be another mesh.
    """
    pial = _pial_of(path)
    return (pial, {WHITE: path}) if pial != path and is_there(pial) else (path, {})


def _pial_of(path: Path) -> Path:
    """The name that the pial surface beside a white one has."""
    return path.with_name(_WHITE.sub("pial", path.name))


def _matches(directory: Path, pattern: str) -> Iterator[tuple[Path, dict[str, str]]]:
    """Files below `directory` that fit a pattern, with the values of its placeholders."""
    if "{participant}" not in pattern or not pattern.strip() or Path(pattern).is_absolute() or "\0" in pattern:
        raise InputError(
            f"cohort.scan.surfaces: {pattern!r} is not a valid pattern",
            remedy="give a pattern relative to the folder, with the placeholder {participant}",
        )
    parts = re.split(r"\{(participant|session|hemi|entities)\}", pattern)
    expression, seen = "", set[str]()
    for text, name in zip(parts[::2], [*parts[1::2], ""], strict=True):
        anyhow = name == "participant" and pattern.startswith("{participant}/")
        form = r"(?!sub-|fsaverage|cvs_avg35)[A-Za-z0-9][A-Za-z0-9_.-]*" if anyhow else "[A-Za-z0-9]+"
        form = _ENTITIES if name == "entities" else form
        label = f"(?P={name})" if name in seen else f"(?P<{name}>{form})"
        expression += re.escape(text) + (label if name else "")
        seen.add(name)
    # a surface of FreeSurfer that was converted lies beside its own; the last star also finds links that lead nowhere
    expression += r"(\.surf\.gii)?(\.gz)?"
    for path in sorted(directory.glob(re.sub(r"\*+", "*", "*".join(parts[::2])) + "*")):
        if match := re.fullmatch(expression, path.relative_to(directory).as_posix()):
            values = match.groupdict()
            named = dict(one.split("-", 1) for one in (values.pop("entities", "") or "").split("_") if one)
            own = {name: named[key] for name, key in (("session", "ses"), ("hemi", "hemi")) if key in named}
            if all(values.get(name, value) == value for name, value in own.items()):  # else a file in a wrong folder
                yield path, values | own
