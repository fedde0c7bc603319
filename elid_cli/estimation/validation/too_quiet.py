"""A residual well below what the sensors' noise alone would leave is a fault, and no success.

Either the noise is estimated too high (a log that was smoothed, repeated samples), or a prediction has seen what it
predicts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elid_cli.errors import in_words
from elid_cli.estimation.judgement import EQUATIONS, RowNoise
from elid_cli.estimation.result import Identification
from elid_cli.model.regressor import Kind

LEAST = 0.7
"""Part of the sensors' noise below which a residual is a fault …"""
MARGIN = 3.0
"""… by so many deviations of a residual's rms over the independent instants that the fit leaves."""
MATTERS = 1e-4
"""Part of the torque below which such noise is smoothing's own error: of a log without noise."""
FEWEST = 30.0
"""Independent instants per row from which that is judged."""


def too_quiet(found: Identification, noise: Sequence[RowNoise]) -> tuple[str, ...]:
    """Return a sentence for each kind of row with residuals that are too small for their sensors' noise.

    Parameters
    ----------
    found
        The identification: instants, rate, cut-off, rank.
    noise
        Noise of every row.
    """
    rate, cutoff = float(_setting(found, "rate")), float(_setting(found, "cutoff"))
    independent = float(_setting(found, "instants")) * min(1.0, 2.0 * cutoff / rate) if rate > 0 else 0.0
    left = independent - found.rank / max(len(noise), 1)
    noise = [item for item in noise if item.joint in found.error]
    if left < FEWEST:
        return ()
    taken = float(np.sqrt(independent / left))  # a fit takes its parameters' share of the noise away
    high = 1.0 - MARGIN / float(np.sqrt(2.0 * left))
    quiet: dict[Kind, list[RowNoise]] = {}
    for item in noise:
        if item.floor > MATTERS * found.error[item.joint].torque_rms and item.ratio * taken < LEAST * high:
            quiet.setdefault(item.rows, []).append(item)
    why = "a drive's torque that chatters counts as noise"
    return tuple(
        f"{in_words([item.joint for item in items])}: the residual of the {EQUATIONS[rows]} is "
        f"{in_words([f'{item.ratio:.2g}' for item in items])} of what the sensors' noise alone would leave: the noise "
        f"is estimated too large ({why}), or the prediction uses the torque that it predicts"
        for rows, items in quiet.items()
    )


def _setting(found: Identification, name: str) -> str:
    return str(found.settings.get(name, 0.0))
