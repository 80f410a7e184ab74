"""Proof that a GPU folds as the CPU does, for `cortet doctor`."""

from __future__ import annotations


def prove_gpu() -> str:
    """Whether a GPU takes the same steps as the CPU; without a GPU, having the package is enough."""
    import numpy as np

    from cortet.doctor import expect, star
    from cortet.errors import InputError
    from cortet.folding.device import device_name
    from cortet.folding.run import advance_to, beginning, prepared
    from cortet.folding.state import Settings

    try:
        name = device_name()
    except InputError as error:
        return error.what
    ends = []
    for device in ("cpu", "cuda"):
        run = prepared(star()[0], Settings(22.0, end=22.05, device=device))
        moment = beginning(run)
        advance_to(run, moment, run.end)
        ends.append(moment.state.x)
    difference = float(np.abs(ends[0] - ends[1]).max())
    expect(difference < 1e-12, f"{name}: nodes end {difference:g} from where they do on the CPU")
    return f"{name} takes the steps of the CPU, to {difference:.0e}"
