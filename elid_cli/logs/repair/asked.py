"""Parts of a log that its user wants left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError


def without(
    spans: Sequence[tuple[float, float]], t: Array, dt: float, known: NDArray[np.bool_], name: str, repairs: list[str]
) -> NDArray[np.bool_]:
    """Return `known`, (N,), without the samples in these spans; say what was left out.

    `t` are their times, `dt` apart, s, (N,).

    Raises
    ------
    UsageError
        If a span holds no sample.
    """
    if not spans:
        return known
    known = known.copy()
    for start, stop in spans:
        inside = (t >= start - dt / 2) & (t <= stop + dt / 2)
        if not inside.any():
            raise UsageError(
                f"{name}: no sample to leave out from {start:g} to {stop:g} s", detail=f"the log ends at {t[-1]:.4g} s"
            )
        known &= ~inside
    said = ", ".join(f"{start:g} to {stop:g} s" for start, stop in spans)
    repairs.append(f"left out as asked: {said}")
    return known
