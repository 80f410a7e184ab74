"""Which cases of a sheet are chosen: by name or number, or for folding by a column."""

from __future__ import annotations

from collections.abc import Sequence

from cortet.cohort.sheet import MISSING, NO, YES, Case
from cortet.config.section import Cases
from cortet.errors import InputError

#: column of the sheet that says which cases are folded
FOLD = "fold"
#: most names of cases that a message lists
_MOST_NAMES = 5


def chosen(cases: Sequence[Case], which: Cases) -> list[Case]:
    """Some of the cases: all, those that are named, or a number of them spread evenly over the order of ages."""
    if which == "all":
        return list(cases)
    if isinstance(which, int):
        by_age = sorted(cases, key=lambda case: (case.scan_age or 0, case.name))
        count = min(which, len(by_age))
        ranks = [round(i * (len(by_age) - 1) / max(count - 1, 1)) for i in range(count)]
        return [by_age[rank] for rank in ranks]
    known = {case.name: case for case in cases}
    if unknown := [name for name in which if name not in known]:
        raise InputError(
            f"the sheet includes no case {', '.join(unknown)}", remedy=f"it includes {', '.join(known) or 'none'}"
        )
    return [known[name] for name in which]


def folded(cases: Sequence[Case], which: Cases | None) -> list[Case]:
    """The cases that are folded: the configuration chooses them, or else the column `fold` if there is one.

    A fold starts at an age, so cases without an age are skipped unless they are asked for by name or column.
    """
    if isinstance(which, (str, int)):
        return chosen([case for case in cases if case.scan_age is not None], which)
    asked = [case for case in cases if _says_yes(case)] if which is None else chosen(cases, which)
    if ageless := [case.name for case in asked if case.scan_age is None]:
        raise InputError(
            f"{', '.join(ageless)}: selected for folding, but the starting age is unknown",
            remedy="give scan_age in gestational weeks in the cohort sheet, or do not fold the case",
        )
    return asked


def _says_yes(case: Case) -> bool:
    """Whether the column `fold` says yes for a case; a sheet without it folds none."""
    value = case.extra.get(FOLD, "no")
    if value in MISSING:
        return False
    if value.lower() not in YES | NO:
        raise InputError(
            f"column {FOLD} of {case.name}: {value!r} is neither yes nor no", remedy="use yes or no; n/a counts as no"
        )
    return value.lower() in YES


def ageless_notice(cases: Sequence[Case], *, smoothed: bool, folded: bool) -> list[str]:
    """What is not done with the cases of unknown age, in words; empty if they are treated as all others.

    Parameters
    ----------
    smoothed, folded : whether cases of known age are smoothed by it, and folded
    """
    lacks = " or ".join(word for word, is_so in (("smooth", smoothed), ("fold", folded)) if is_so)
    names = [case.name for case in cases if case.scan_age is None]
    shown = ", ".join([*names[:_MOST_NAMES], *(["..."] if len(names) > _MOST_NAMES else [])])
    told = (
        f"cortet will not {lacks} {len(names)} of {len(cases)} cases because their gestational age is unknown: {shown} "
        "(ignore this for adults; otherwise add scan_age in weeks to participants.tsv or the sheet)"
    )
    return [told] if names and lacks else []
