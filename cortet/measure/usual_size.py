"""The usual size of a healthy fetal or neonatal hemisphere by gestational age."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cortet.meshes import FloatArray

#: volume within the inner cortical surface of a healthy hemisphere: Gompertz's law, mL, 1/week and weeks, fitted to
#: eight fetuses of 22 to 34 weeks and four newborns of 38 to 42 (CRL atlas, FetoMorph, dHCP atlas:
#: `folding/data/real_brains.tsv`), which differ from it by 7 %. Newborns of earlier weeks are smaller than fetuses
VOLUME = (105.3, 0.1552, 25.26)
#: its area, cm2, likewise; the data differ from it by 5 %
AREA = (381.3, 0.0813, 31.07)
#: the volume of its convex hull, mL, likewise; the data differ from it by 5 %
HULL = (180.4, 0.1224, 27.58)
#: volume within the pial surface over that within the inner one: 1.20 to 1.22 in 8 pairs of 28 to 42 weeks
_PIAL = 1.22
#: weeks for which the law of the volume holds, and part by which infants grow beyond it in each later week
_AGES, _LATER = (20.0, 45.0), 0.1
#: factor from the usual volume at an age beyond which a surface gets a remark. Healthy brains of one age differ by a
#: third at most; the volume doubles from 22 to 26 weeks
UNUSUAL_TIMES = 1.5
#: smallest over largest extent of a body below which it is half a brain: halves have 0.36 to 0.53, whole brains 0.65
#: and more
_NARROW = 0.6


def usual(law: tuple[float, float, float], ages: FloatArray) -> FloatArray:
    """Usual values at ages (k,) by a law of Gompertz: `VOLUME`, `AREA` or `HULL`."""
    largest, rate, latest = law
    return largest * np.exp(-np.exp(-rate * (ages - latest)))


def unusual_volume(
    volume_ml: float, extents: Sequence[float], age: float, hemisphere: str | None, *, times: float
) -> str:
    """What is unusual about a volume at an age, as the end of a sentence; empty if nothing is.

    Parameters
    ----------
    volume_ml : within the inner cortical or the pial surface
    extents : of the surface along three axes, mm: half a brain is narrow
    age : gestational age, weeks
    hemisphere : L or R; None: a whole brain, or not known
    times : factor from the usual volume beyond which one is unusual
    """
    known = float(np.clip(age, *_AGES))
    of_law = float(usual(VOLUME, np.array(known)))
    inner = of_law * (1 + _LATER * max(age - known, 0))
    least = 0 if age < known else of_law / times
    is_half = hemisphere is not None or min(extents) < _NARROW * max(extents)
    if least <= volume_ml <= inner * _PIAL * times * (1 if is_half else 2):
        return ""
    return (
        f"{volume_ml:.3g} mL, but a hemisphere of {age:g} weeks usually has {inner:.0f} mL inside its white surface "
        f"and {inner * _PIAL:.0f} mL inside its pial surface"
    )
