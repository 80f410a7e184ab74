"""Which cases of a sheet are chosen: by name, number or column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cortet.cohort.sheet import MISSING, NO, YES, Case
from cortet.config.section import Cases
from cortet.errors import InputError

#: column of the sheet that says which cases are folded
FOLD = "fold"
#: most names of cases that a message lists
_MOST_NAMES = 5


def chosen(cases: Sequence[Case], which: Cases | Mapping[str, str]) -> list[Case]:
    """Some of the cases: all, those that are named, a number of them spread evenly over the order of ages, or those for
    which a column says yes.
    """
    if which == "all":
        return list(cases)
    if isinstance(which, Mapping):
        return [case for case in cases if _says_yes(case, which["column"])]
    if isinstance(which, int):
        by_age = sorted(cases, key=lambda case: (case.scan_age or 0, case.name))
        count = min(which, len(by_age))
        places = [round(i * (len(by_age) - 1) / max(count - 1, 1)) for i in range(count)]
        return [by_age[place] for place in places]
    known = {case.name: case for case in cases}
    if unknown := [name for name in which if name not in known]:
        raise InputError(
            f"the sheet includes no case {', '.join(unknown)}", remedy=f"it includes {', '.join(known) or 'none'}"
        )
    return [known[name] for name in which]


def folded(cases: Sequence[Case], which: Cases | Mapping[str, str] | None) -> list[Case]:
    """The cases that are folded: the configuration chooses them, or else the column `fold` if there is one.

    A fold starts at an age, so cases without an age are skipped unless they are asked for by name or column.
    """
    if which is None:
        which = {"column": FOLD} if any(FOLD in case.extra for case in cases) else []
    if isinstance(which, (str, int)):
        return chosen([case for case in cases if case.scan_age is not None], which)
    asked = chosen(cases, which)
    if ageless := [case.name for case in asked if case.scan_age is None]:
        raise InputError(
            f"{', '.join(ageless)}: selected for folding, but the starting age is unknown",
            remedy="give scan_age in gestational weeks in the cohort sheet, or do not fold the case",
        )
    return asked


def _says_yes(case: Case, column: str) -> bool:
    """Whether a column of the sheet says yes for a case."""
    if column not in case.extra:
        raise InputError(
            f"the sheet has no yes/no column {column}",
            remedy=f"add it, or name one of the further columns: {', '.join(case.extra) or 'none'}",
        )
    value = case.extra[column]
    if value in MISSING:
        return False
    if value.lower() not in YES | NO:
        raise InputError(
            f"column {column} of {case.name}: {value!r} is neither yes nor no", remedy="use yes or no; n/a counts as no"
        )
    return value.lower() in YES


def ageless_notice(cases: Sequence[Case], *, smoothed: bool, folded: bool) -> list[str]:
    """What is not done with the cases of unknown age, in words; empty if they are treated as all others.

    Parameters
    ----------
    smoothed, folded : whether cases of known age are smoothed by it, and folded
    """
    lacks = " or ".join(word for word, is_so in (("smoothed", smoothed), ("folded", folded)) if is_so)
    names = [case.name for case in cases if case.scan_age is None]
    shown = ", ".join([*names[:_MOST_NAMES], *(["..."] if len(names) > _MOST_NAMES else [])])
    told = (
        f"{len(names)} not {lacks} because the gestational age is unknown: {shown} (adults need none; "
        "for others give scan_age in weeks in participants.tsv or the sheet)"
    )
    return [told] if names and lacks else []
